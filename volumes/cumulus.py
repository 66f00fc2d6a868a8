"""A fair-weather cumulus some 500 m across, modelled and not simulated.

Shape.  Spheres budding off spheres, four generations, each child on its
parent's upper side and 0.33 to 0.55 of its radius: that is the cauliflower.
With r_s, c_s the radius and centre of sphere s the signed depth below the
surface is, in steps,
    d(p) = max_s (r_s - |q - c_s|),        q = p + warp(p),
where warp is a vector of gradient fbm that bends the spheres out of round.
The underside is cut level (the condensation height), the cut itself uneven.

Edge.  Three scales of inverted cellular noise push bumps out of the surface and
leave creases between them, as Schneider & Vos 2015 erode their clouds,
    d ← d + Σ_o a_o (0.55 - F1(p / l_o)),
and fine gradient fbm frays the rim; it counts for more on the lower flanks,
where a cloud evaporates, than on the crown, where it grows:
    d ← d - f(p) |fbm(p)|.
Density [1] climbs from 0 to 1 over a few steps, w(p) of them:
    density = smoothstep(0, w, d) (0.75 + 0.25 smooth large noise),
w from 2 on the crown to 9 where it frays, and a little thinner towards the base.

Units: the lengths here are in steps of a model lattice MODEL, 2.5 m each, which
is sampled at CELLS voxels of H metres; y is up, the base near y = 0.
"""

import math

import numpy as np
from numba import njit, prange

import noise
import vdbout

MODEL = (256, 176, 224)
CELLS = (320, 220, 280)
H = 2.0  # [m]
CORNER = (-160 * H, -16 * H, -140 * H)  # [m]
SEED = 20
BASE = 14.0  # height of the level underside
REACH = 14.0  # how far outside the bare spheres anything can appear [steps]
THRESHOLD = 0.01

# Body of the cloud: centre x, y, z and radius [steps], placed by hand: a main
# tower, a lower shoulder on each side, small heaps along the base.
BODY = ((128, 44, 112, 46), (118, 84, 108, 37), (132, 112, 114, 25),
        (84, 36, 104, 35), (172, 38, 118, 36), (166, 62, 108, 25), (92, 58, 128, 27),
        (112, 34, 152, 31), (148, 34, 70, 31), (54, 26, 112, 22), (204, 26, 110, 21),
        (98, 26, 66, 22), (168, 26, 158, 23))
CHILDREN = (11, 10, 8)  # per sphere, by generation


def spheres():
    """All generations as rows of (x, y, z, radius) [steps]."""
    random = np.random.default_rng(SEED)
    parents = [np.array(body, float) for body in BODY]
    everyone = list(parents)
    for count in CHILDREN:
        born = []
        for parent in parents:
            for _ in range(count):
                towards = random.normal(size=3)
                towards /= np.linalg.norm(towards)
                if towards[1] < -0.2:
                    towards[1] = -towards[1]
                radius = parent[3] * random.uniform(0.33, 0.55)
                centre = parent[:3] + towards * parent[3] * random.uniform(0.8, 0.95)
                born.append(np.array([*centre, radius]))
        # A child buried in another's flesh would only cost time.
        solid = np.array(everyone)
        parents = [b for b in born
                   if np.max(solid[:, 3] - np.linalg.norm(solid[:, :3] - b[:3], axis=1)) < 0.6 * b[3]]
        everyone += parents
    return np.array(everyone)


def buckets(balls, cells, width):
    """For each block of `width` steps, which spheres come within REACH of it:
    (start of each block's list, the lists end to end)."""
    blocks = [math.ceil(n / width) for n in cells]
    lists = []
    for corner in np.ndindex(*blocks):
        low = np.array(corner) * width
        gap = np.maximum(np.maximum(low - balls[:, :3], balls[:, :3] - low - width), 0.0)
        lists.append(np.flatnonzero(np.linalg.norm(gap, axis=1) < balls[:, 3] + REACH))
    start = np.concatenate(([0], np.cumsum([len(a) for a in lists])))
    return start.reshape(-1), np.concatenate(lists), blocks


@njit(cache=True)
def _smoothstep(low, high, x):
    t = min(max((x - low) / (high - low), 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@njit(parallel=True, cache=True)
def _fill(balls, start, members, blocks, width, scale, out):
    """Density of every voxel; `scale` steps of the model per voxel of `out`."""
    nx, ny, nz = out.shape
    for i in prange(nx):
        for j in range(ny):
            for k in range(nz):
                x, y, z = (i + 0.5) * scale, (j + 0.5) * scale, (k + 0.5) * scale
                block = (int(x / width) * blocks[1] + int(y / width)) * blocks[2] + int(z / width)
                if start[block] == start[block + 1]:
                    continue
                s = 1.0 / 38.0
                qx = x + 7.0 * noise.fbm(x * s, y * s, z * s, 3, 0.5, 101)
                qy = y + 7.0 * noise.fbm(x * s, y * s, z * s, 3, 0.5, 202)
                qz = z + 7.0 * noise.fbm(x * s, y * s, z * s, 3, 0.5, 303)
                depth = -REACH
                for n in range(start[block], start[block + 1]):
                    ball = balls[members[n]]
                    dx, dy, dz = qx - ball[0], qy - ball[1], qz - ball[2]
                    depth = max(depth, ball[3] - math.sqrt(dx * dx + dy * dy + dz * dz))
                broad = noise.fbm(x / 45.0, y / 45.0, z / 45.0, 3, 0.5, 404)
                depth = min(depth, y - BASE + 6.0 * broad)
                if depth <= -REACH:
                    continue
                if depth < 2.0 * REACH:
                    for o in range(3):
                        size = 16.0 / (1 << o)
                        depth += 0.42 * size * (0.55 - noise.worley(qx / size, qy / size, qz / size, 505 + o))
                fray = _smoothstep(0.15, 0.75, 0.55 - (y - BASE) / 150.0 + 1.3 * broad)
                fine = noise.fbm(x / 13.0, y / 13.0, z / 13.0, 4, 0.62, 606)
                depth -= (1.5 + 12.0 * fray) * abs(fine)
                edge = _smoothstep(0.0, 2.0 + 7.0 * fray, depth)
                inside = 0.75 + 0.25 * _smoothstep(-0.4, 0.4, broad)
                base = 0.6 + 0.4 * _smoothstep(BASE - 4.0, BASE + 24.0, y)
                out[i, j, k] = edge * inside * base


def density(cells=CELLS):
    """The density array; `cells` may be coarser for a trial."""
    balls, width = spheres(), 16
    start, members, blocks = buckets(balls, MODEL, width)
    out = np.zeros(cells, np.float32)
    _fill(balls, start, members, np.array(blocks), width, MODEL[0] / cells[0], out)
    return out / out.max()


def write(path, cells=CELLS):
    """cumulus.vdb: one grid, `density`."""
    values = density(cells)
    h = H * CELLS[0] / cells[0]
    grid = vdbout.grid("density", values, h, CORNER, values > THRESHOLD, {})
    vdbout.write(path, [grid], {"title": "cumulus"})
