#!/usr/bin/env python3
"""Writes the two volumes of the loading benchmark with OpenVDB's own tools.

    benches/make_volumes.py FOLDER

FOLDER/blosc_half.vdb   16-bit floats, Blosc and active mask: the usual half file of Houdini and Blender
FOLDER/zip.vdb          32-bit floats, zip and active mask

Both hold the same cloud: smooth noise inside a ball of 320 voxels, about 13 M active voxels.
Needs: apt-get install python3-openvdb libopenvdb-tools python3-numpy
"""
import os
import subprocess
import sys

import numpy as np
import pyopenvdb as vdb

N = 320


def cloud():
    rng = np.random.default_rng(20)
    total = np.zeros((N, N, N), np.float32)
    for cells, weight in ((10, 1.0), (40, 0.5), (160, 0.25)):
        coarse = rng.random((cells + 1,) * 3, dtype=np.float32)
        for axis in range(3):                       # linear interpolation, one axis after another
            at = np.linspace(0, cells, N, endpoint=False, dtype=np.float32)
            low = at.astype(int)
            shape = [1, 1, 1]
            shape[axis] = N
            part = (at - low).reshape(shape)
            coarse = np.take(coarse, low, axis) * (1 - part) + np.take(coarse, low + 1, axis) * part
        total += weight * coarse
    x = (np.arange(N, dtype=np.float32) + 0.5) / N * 2 - 1
    r = np.sqrt(x[:, None, None] ** 2 + x[None, :, None] ** 2 + x[None, None, :] ** 2)
    return np.where(r < 0.95, total * (1.05 - r), 0).astype(np.float32)


def main(folder):
    os.makedirs(folder, exist_ok=True)
    grid = vdb.FloatGrid()
    grid.copyFromArray(cloud())
    grid.name = "density"
    grid.transform = vdb.createLinearTransform(0.01)
    print(grid.activeVoxelCount(), "active voxels")
    half = grid.deepCopy()
    half.saveFloatAsHalf = True
    half.gridClass = vdb.GridClass.FOG_VOLUME
    vdb.write(os.path.join(folder, "blosc_half.vdb"), grids=[half])
    # Of a fog volume OpenVDB drops the zip bit, so this one has no class.
    plain = os.path.join(folder, "plain.vdb")
    vdb.write(plain, grids=[grid])
    subprocess.run(["vdb_tool", "-read", plain, "-write", "codec=zip",
                    os.path.join(folder, "zip.vdb")], check=True)
    os.remove(plain)


if __name__ == "__main__":
    main(sys.argv[1])
