"""Drifting haze and ground fog: thin media that fill a place, modelled and not simulated.

Gradient fbm n (see `noise`) is sampled at a point that another fbm has moved about, which folds
the pattern over as stirred air does (domain warping, Quilez 2002), on axes drawn out along the
wind x, sheared with height y [m]:
    q = ((x + SHEAR y) / l_x, y / l_y, z / l_z) + WARP (n1, n2, n3)(same / 2),
    wisps(q) = smoothstep(low, high, n(q)).
Between the wisps a share `floor` of the density is left. A profile over the height closes it:
    haze        h = 1 - smoothstep(0.55 H, H, y)                    lies up to the roof,
    ground fog  h = MIST + (1 - MIST) exp(-(y / s)^2), s = S (1 + 0.6 n(x / 9, z / 9)): banks over
                the ground in a mist that ends at H,
    density = h sides(x, z) (floor + (1 - floor) wisps),
where `sides` fades to 0 over the last EDGE metres at the box's sides. Values are rounded to
1/256, which halves the files and cannot be seen. The grid starts a voxel below the ground, so that
the density at a floor at y = 0 is interpolated between samples and not against nothing.

Units: metres; density 1 at the most.
"""

import math

import numpy as np
from numba import njit, prange

import noise
import vdbout

SHEAR = 0.35
WARP = 0.9
EDGE = 1.5
MIST = 0.3
THRESHOLD = 0.5 / 256.0

# name: cells, voxel [m], lengths l_x, l_y, l_z [m], low, high, floor, S [m] (0: haze), seed
HAZE = ("haze", (176, 80, 120), 0.1, (3.4, 1.5, 2.2), -0.12, 0.34, 0.10, 0.0, 71)
GROUND_FOG = ("ground_fog", (170, 36, 290), 0.2, (9.0, 2.4, 7.0), -0.20, 0.40, 0.22, 2.1, 83)


@njit(cache=True)
def _smoothstep(low, high, x):
    t = min(max((x - low) / (high - low), 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@njit(parallel=True, cache=True)
def _fill(out, h, corner, lengths, low, high, floor, bank, seed):
    nx, ny, nz = out.shape
    top = corner[1] + h * ny
    for i in prange(nx):
        for j in range(ny):
            for k in range(nz):
                x = corner[0] + (i + 0.5) * h
                y = corner[1] + (j + 0.5) * h
                z = corner[2] + (k + 0.5) * h
                a = (x + SHEAR * y) / lengths[0]
                b, c = y / lengths[1], z / lengths[2]
                qx = a + WARP * noise.fbm(0.5 * a, 0.5 * b, 0.5 * c, 3, 0.5, seed + 1000)
                qy = b + WARP * noise.fbm(0.5 * a, 0.5 * b, 0.5 * c, 3, 0.5, seed + 2000)
                qz = c + WARP * noise.fbm(0.5 * a, 0.5 * b, 0.5 * c, 3, 0.5, seed + 3000)
                wisps = _smoothstep(low, high, noise.fbm(qx, qy, qz, 5, 0.52, seed))
                if bank > 0.0:
                    s = bank * (1.0 + 0.6 * noise.fbm(x / 9.0, 0.5, z / 9.0, 2, 0.5, seed + 4000))
                    profile = MIST + (1.0 - MIST) * math.exp(-(max(y, 0.0) / s) ** 2)
                    profile *= 1.0 - _smoothstep(0.8 * top, top - h, y)
                else:
                    profile = 1.0 - _smoothstep(0.55 * top, top - h, y)
                gap = min(min(i + 0.5, nx - i - 0.5), min(k + 0.5, nz - k - 0.5)) * h
                sides = _smoothstep(0.0, EDGE, gap)
                out[i, j, k] = profile * sides * (floor + (1.0 - floor) * wisps)


def write(folder, kind, coarse):
    """haze.vdb or ground_fog.vdb: one grid, `density`; x and z centred on 0."""
    name, cells, h, lengths, low, high, floor, bank, seed = kind
    if coarse:
        cells, h = tuple(n // 2 for n in cells), 2.0 * h
    corner = (-0.5 * cells[0] * h, -h, -0.5 * cells[2] * h)
    out = np.zeros(cells, np.float32)
    _fill(out, h, np.array(corner), np.array(lengths), low, high, floor, bank, seed)
    values = np.round(256.0 * out / out.max()) / 256.0
    grid = vdbout.grid("density", values, h, corner, values > THRESHOLD, {})
    vdbout.write(folder / f"{name}.vdb", [grid], {"title": name})
