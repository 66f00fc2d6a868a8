"""Arrays to OpenVDB grids to files, as a Houdini or Blender exporter would.

A grid holds one sample per voxel AT the index point; sample (i, j, k) of an array
sits at the centre of its cell, so with cell size h [m] and the array's lower
corner at `corner` [m]
    world = corner + h (index + 1/2).
Values are stored as half floats (relative step 2^-11), voxels under a threshold
are inactive with the background value 0, whole leaves of them do not exist, and
the blocks are compressed with Blosc under an active mask (the library's default).
"""

import numpy as np
import pyopenvdb as vdb


def grid(name, values, h, corner, active, notes):
    """A half-float grid, (x, y, z) or (x, y, z, 3), active where `active` is true.

    notes: metadata to attach, name to string or number."""
    kept = np.where(active.reshape(active.shape + (1,) * (values.ndim - 3)), values, 0)
    kept = np.ascontiguousarray(kept, dtype=np.float32)
    out = vdb.Vec3SGrid() if values.ndim == 4 else vdb.FloatGrid()
    out.copyFromArray(kept)
    out.pruneInactive()
    out.transform = vdb.createLinearTransform(voxelSize=h)
    out.transform.translate([c + 0.5 * h for c in corner])
    out.name = name
    out.creator = f"vpm-vdb volumes/generate.py, OpenVDB {'.'.join(map(str, vdb.LIBRARY_VERSION))}"
    if values.ndim == 3:
        out.gridClass = vdb.GridClass.FOG_VOLUME
    else:
        # Stays as it is under rotation of the grid only if told to turn along.
        out.vectorType = vdb.VectorType.CONTRAVARIANT_RELATIVE
    out.saveFloatAsHalf = True
    for key, value in notes.items():
        out[key] = value
    return out


def write(path, grids, notes):
    """One file; `notes` become its file-level metadata."""
    vdb.write(str(path), grids=grids, metadata=notes)


def describe(path):
    """Rows of what a reader finds: (grid, type, active voxels, box, voxel, range)."""
    for g in vdb.readAll(str(path))[0]:
        low, high = g.evalMinMax()
        box = " ".join(f"{a}..{b}" for a, b in zip(*g.evalActiveVoxelBoundingBox()))
        yield (g.name, g.valueTypeName, g.activeVoxelCount(), box,
               g.transform.voxelSize()[0], low, high)
