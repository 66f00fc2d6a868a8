#!/usr/bin/env python3
"""Writes the meshes of the example scenes: python3 make_meshes.py [NAME ...]

Needs numpy. Deterministic: the same files byte for byte on every run of the same numpy.
Metres, y up, every mesh stands on y = 0 and faces +z; all are closed and face outwards, so that
any of them may be glass or hold a medium.

Organic shapes (bust, figure, car) are implicit: a function f(p) that is negative inside, built
from ellipsoids and capsules joined by the polynomial smooth minimum (Quilez 2013)
    smin(a, b, k) = min(a, b) - h^2 k / 4,  h = max(k - |a - b|, 0) / k,
polygonised by surface nets (Gibson 1998): one vertex per grid cell that the surface crosses, then
pulled onto f = 0 by Newton steps; normals are the gradient of f. Machined shapes (ring, lamp,
truss, wall) are swept or extruded directly.
"""

import os
import sys

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))


# ---------------------------------------------------------------------------------------------
# Implicit shapes: functions of an (n, 3) array of points.

def vec(*xyz):
    return np.array(xyz, dtype=np.float64)


def length(p):
    return np.sqrt((p * p).sum(axis=-1))


def ellipsoid(p, center, radii):
    """Bound on the distance, exact at the surface."""
    q = (p - vec(*center)) / vec(*radii)
    k0, k1 = length(q), length(q / vec(*radii))
    return k0 * (k0 - 1.0) / np.maximum(k1, 1e-12)


def capsule(p, a, b, ra, rb=None):
    """A round stick whose radius goes from ra to rb."""
    a, b = vec(*a), vec(*b)
    rb = ra if rb is None else rb
    t = np.clip(((p - a) @ (b - a)) / ((b - a) @ (b - a)), 0.0, 1.0)
    return length(p - a - t[:, None] * (b - a)) - (ra + t * (rb - ra))


def box(p, center, half, r=0.0):
    q = np.abs(p - vec(*center)) - (vec(*half) - r)
    return length(np.maximum(q, 0.0)) + np.minimum(q.max(axis=-1), 0.0) - r


def cylinder(p, center, axis, radius, half, r=0.0):
    q = p - vec(*center)
    along = np.abs(q[:, axis]) - (half - r)
    across = length(np.delete(q, axis, axis=1)) - (radius - r)
    d = np.stack([along, across], axis=1)
    return length(np.maximum(d, 0.0)) + np.minimum(d.max(axis=1), 0.0) - r


def torus(p, center, axis, major, minor):
    q = p - vec(*center)
    ring = length(np.delete(q, axis, axis=1)) - major
    return np.hypot(ring, q[:, axis]) - minor


def smin(a, b, k):
    h = np.maximum(k - np.abs(a - b), 0.0) / k
    return np.minimum(a, b) - h * h * k * 0.25


def smax(a, b, k):
    return -smin(-a, -b, k)


def mirror(p):
    """Folds x onto its positive half: everything after is symmetric."""
    return np.stack([np.abs(p[:, 0]), p[:, 1], p[:, 2]], axis=1)


# ---------------------------------------------------------------------------------------------
# Polygonisation.

def in_slabs(f, points, size=200_000):
    return np.concatenate([f(points[i:i + size]) for i in range(0, len(points), size)])


def gradient(f, p, h):
    g = np.empty_like(p)
    for k in range(3):
        step = np.zeros(3)
        step[k] = h
        g[:, k] = (in_slabs(f, p + step) - in_slabs(f, p - step)) / (2.0 * h)
    return g


def surface_nets(f, low, high, h):
    """Vertices, normals and triangles of f = 0 in a box, on a grid of spacing h."""
    axes = [np.arange(a - h, b + 2 * h, h) for a, b in zip(low, high)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    shape = grid.shape[:3]
    value = in_slabs(f, grid.reshape(-1, 3)).reshape(shape)
    inside = value < 0.0

    # Mean of the crossings along a cell's twelve edges.
    cells = tuple(n - 1 for n in shape)
    total, count = np.zeros(cells + (3,)), np.zeros(cells)
    corner = lambda a, o: a[o[0]:cells[0] + o[0], o[1]:cells[1] + o[1], o[2]:cells[2] + o[2]]
    for k in range(3):
        for i in (0, 1):
            for j in (0, 1):
                o = np.insert([i, j], k, 0)
                e = np.insert([i, j], k, 1)
                a, b = corner(value, o), corner(value, e)
                crossed = (a < 0.0) != (b < 0.0)
                t = np.where(crossed, a / np.where(crossed, a - b, 1.0), 0.0)[..., None]
                x = corner(grid, o) * (1.0 - t) + corner(grid, e) * t
                total += np.where(crossed[..., None], x, 0.0)
                count += crossed
    used = count > 0
    index = np.full(cells, -1, dtype=np.int64)
    index[used] = np.arange(used.sum())
    vertices = total[used] / count[used][:, None]

    # A quad around every grid edge that crosses, wound by the direction of the crossing.
    quads = []
    for k in range(3):
        u, v = (k + 1) % 3, (k + 2) % 3
        step = np.eye(3, dtype=int)
        n = list(shape)
        n[k] -= 1
        edge = np.stack(np.meshgrid(*[np.arange(m) for m in n], indexing="ij"), -1).reshape(-1, 3)
        edge = edge[(edge[:, u] > 0) & (edge[:, v] > 0)]
        edge = edge[(edge[:, u] < shape[u] - 1) & (edge[:, v] < shape[v] - 1)]
        a = inside[tuple(edge.T)]
        b = inside[tuple((edge + step[k]).T)]
        for chosen, order in ((a & ~b, 1), (~a & b, -1)):
            e = edge[chosen]
            around = [e - step[u] - step[v], e - step[v], e, e - step[u]][::order]
            quads.append(np.stack([index[tuple(c.T)] for c in around], axis=1))
    quads = np.concatenate(quads)

    for _ in range(4):
        g = gradient(f, vertices, 0.05 * h)
        move = in_slabs(f, vertices)[:, None] * g / np.maximum((g * g).sum(1), 1e-6)[:, None]
        far = np.maximum(length(move) / (0.3 * h), 1.0)[:, None]
        vertices = vertices - move / far
    normals = gradient(f, vertices, 0.25 * h)
    normals /= np.maximum(length(normals), 1e-12)[:, None]

    # The shorter diagonal.
    p = vertices[quads]
    first = length(p[:, 0] - p[:, 2]) <= length(p[:, 1] - p[:, 3])
    triangles = np.concatenate([
        quads[first][:, [0, 1, 2]], quads[first][:, [0, 2, 3]],
        quads[~first][:, [0, 1, 3]], quads[~first][:, [1, 2, 3]],
    ])
    return vertices, normals, triangles


# ---------------------------------------------------------------------------------------------
# Swept and extruded parts: lists of (vertices, normals or None, triangles).

def tube(path, radii, sides=12):
    """A round bar along a path, closed at both ends; flat shading at the caps by doubled rims."""
    path = np.asarray(path, dtype=np.float64)
    radii = np.broadcast_to(np.asarray(radii, dtype=np.float64), len(path))
    tangents = np.gradient(path, axis=0)
    tangents /= length(tangents)[:, None]
    side = np.cross(tangents[0], [0.31, 0.17, 0.93])
    rings, normals = [], []
    turn = 2.0 * np.pi * np.arange(sides) / sides
    for point, tangent, radius in zip(path, tangents, radii):
        side = side - (side @ tangent) * tangent
        side /= np.linalg.norm(side)
        up = np.cross(tangent, side)
        n = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * up
        rings.append(point + radius * n)
        normals.append(n)
    count = len(path)
    i = (np.arange(count - 1)[:, None] * sides + np.arange(sides)).reshape(-1)
    j = (np.arange(count - 1)[:, None] * sides + (np.arange(sides) + 1) % sides).reshape(-1)
    walls = np.concatenate([np.stack([i, j, i + sides], 1), np.stack([j, j + sides, i + sides], 1)])
    vertices, triangles = [np.concatenate(rings)], [walls]
    shades = [np.concatenate(normals)]
    for ring, center, direction in ((0, path[0], -tangents[0]), (count - 1, path[-1], tangents[-1])):
        first = sum(len(v) for v in vertices)
        vertices += [rings[ring], center[None]]
        shades.append(np.broadcast_to(direction, (sides + 1, 3)))
        a = first + np.arange(sides)
        b = first + (np.arange(sides) + 1) % sides
        c = np.full(sides, first + sides)
        triangles.append(np.stack([b, a, c], 1) if ring == 0 else np.stack([a, b, c], 1))
    return np.concatenate(vertices), np.concatenate(shades), np.concatenate(triangles)


def prism(outline, z0, z1):
    """A convex polygon (counter-clockwise seen from +z) extruded from z0 to z1; no normals."""
    outline = np.asarray(outline, dtype=np.float64)
    n = len(outline)
    level = lambda z: np.column_stack([outline, np.full(n, z)])
    i = np.arange(n)
    j = (i + 1) % n
    fan = np.stack([np.zeros(n - 2, int), np.arange(1, n - 1), np.arange(2, n)], 1)
    triangles = np.concatenate([
        fan[:, ::-1], fan + n, np.stack([i, j, i + n], 1), np.stack([j, j + n, i + n], 1),
    ])
    return np.concatenate([level(z0), level(z1)]), None, triangles


def join(parts):
    vertices, normals, triangles, first = [], [], [], 0
    for v, n, t in parts:
        vertices.append(v)
        normals.append(n)
        triangles.append(t + first)
        first += len(v)
    shaded = all(n is not None for n in normals)
    return np.concatenate(vertices), np.concatenate(normals) if shaded else None, np.concatenate(triangles)


# ---------------------------------------------------------------------------------------------
# Files.

def check(name, vertices, triangles):
    """Closed and outwards, by the rule of the renderer: directed edges cancel, volume is positive."""
    _, weld = np.unique(vertices.astype("<f4") + np.float32(0), axis=0, return_inverse=True)
    t = weld.reshape(-1)[triangles]
    edges = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    edges = edges[edges[:, 0] != edges[:, 1]]
    low, high = edges.min(1), edges.max(1)
    keys, where = np.unique(low * (len(vertices) + 1) + high, return_inverse=True)
    balance = np.bincount(where.reshape(-1), np.where(edges[:, 0] < edges[:, 1], 1, -1), len(keys))
    assert not balance.any(), f"{name} is not closed: {np.count_nonzero(balance)} open edges"
    p = vertices[triangles]
    volume = (np.cross(p[:, 0], p[:, 1]) * p[:, 2]).sum() / 6.0
    assert volume > 0.0, f"{name} faces inwards"
    return volume


def write_ply(name, mesh):
    vertices, normals, triangles = mesh
    # Corners that fell together in f32 leave triangles without area, and no gap.
    p = vertices.astype("<f4")[triangles]
    same = lambda i, j: (p[:, i] == p[:, j]).all(axis=1)
    triangles = triangles[~(same(0, 1) | same(1, 2) | same(2, 0))]
    volume = check(name, vertices, triangles)
    shaded = normals is not None
    fields = [(k, "<f4") for k in ("x y z nx ny nz" if shaded else "x y z").split()]
    data = np.concatenate([vertices, normals], axis=1) if shaded else vertices
    rows = np.ascontiguousarray(data.astype("<f4"))
    index, kind = ("<u2", "ushort") if len(vertices) < 65536 else ("<i4", "int")
    faces = np.empty(len(triangles), dtype=[("n", "u1"), ("i", index, 3)])
    faces["n"], faces["i"] = 3, triangles
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property float {k}" for k, _ in fields]
    header += [f"element face {len(triangles)}", f"property list uchar {kind} vertex_indices", "end_header"]
    path = os.path.join(HERE, name + ".ply")
    with open(path, "wb") as file:
        file.write(("\n".join(header) + "\n").encode())
        file.write(rows.tobytes())
        file.write(faces.tobytes())
    low, high = vertices.min(0), vertices.max(0)
    print(f"{name}.ply: {len(triangles)} triangles, {os.path.getsize(path)} bytes, "
          f"{np.round(low, 3)} to {np.round(high, 3)} m, {volume:.4g} m3")


# ---------------------------------------------------------------------------------------------
# The meshes.

def bust():
    """Head and shoulders on a turned plinth, 0.62 m tall, life size."""
    def f(p):
        q = mirror(p)
        # Skull, face, jaw and chin.
        d = ellipsoid(q, (0, 0.512, -0.018), (0.076, 0.086, 0.096))
        d = smin(d, ellipsoid(q, (0, 0.462, 0.028), (0.060, 0.088, 0.060)), 0.04)
        d = smin(d, capsule(q, (0.052, 0.432, -0.004), (0.016, 0.392, 0.064), 0.017, 0.015), 0.035)
        d = smin(d, ellipsoid(q, (0, 0.391, 0.072), (0.021, 0.017, 0.017)), 0.02)
        d = smin(d, ellipsoid(q, (0.040, 0.446, 0.058), (0.021, 0.022, 0.022)), 0.03)
        # Forehead and brows.
        d = smin(d, ellipsoid(q, (0.0, 0.515, 0.048), (0.052, 0.036, 0.034)), 0.03)
        d = smin(d, capsule(q, (0.012, 0.4895, 0.0845), (0.046, 0.4915, 0.0655), 0.0062, 0.0050), 0.014)
        # Eyes: a socket, a ball, an upper and a lower lid.
        d = smax(d, -ellipsoid(q, (0.0315, 0.4735, 0.0935), (0.0195, 0.0115, 0.0165)), 0.014)
        d = smin(d, ellipsoid(q, (0.0310, 0.4725, 0.0690), (0.0128, 0.0122, 0.0128)), 0.003)
        for middle, r in (((0.0305, 0.4792, 0.0800), 0.0030), ((0.0315, 0.4662, 0.0795), 0.0022)):
            d = smin(d, capsule(q, (0.0165, 0.4712, 0.0770), middle, 0.0020, r), 0.003)
            d = smin(d, capsule(q, middle, (0.0455, 0.4712, 0.0730), r, 0.0020), 0.003)
        # Nose.
        d = smin(d, capsule(q, (0, 0.484, 0.0845), (0, 0.443, 0.1080), 0.0065, 0.0098), 0.012)
        d = smin(d, ellipsoid(q, (0, 0.4405, 0.1090), (0.0098, 0.0085, 0.0100)), 0.006)
        d = smin(d, ellipsoid(q, (0.0115, 0.4385, 0.0965), (0.0078, 0.0072, 0.0105)), 0.006)
        d = smax(d, -ellipsoid(q, (0.0068, 0.4315, 0.1010), (0.0036, 0.0040, 0.0058)), 0.004)
        # Mouth.
        d = smin(d, ellipsoid(q, (0, 0.414, 0.0760), (0.027, 0.020, 0.016)), 0.02)
        d = smax(d, -capsule(q, (0, 0.4305, 0.0985), (0, 0.4210, 0.0985), 0.0028), 0.006)
        d = smin(d, capsule(q, (0.003, 0.4178, 0.0925), (0.0215, 0.4130, 0.0815), 0.0048, 0.0026), 0.005)
        d = smin(d, capsule(q, (0.0, 0.4070, 0.0905), (0.0175, 0.4105, 0.0820), 0.0062, 0.0030), 0.005)
        d = smax(d, -capsule(q, (0, 0.4125, 0.0990), (0.0235, 0.4120, 0.0850), 0.0013), 0.003)
        d = smax(d, -ellipsoid(q, (0, 0.3990, 0.0945), (0.016, 0.0042, 0.0060)), 0.008)
        # Ears: a shell with a hollow, a rim and a lobe.
        tilt = np.stack([q[:, 0] + 0.30 * (q[:, 2] + 0.012), q[:, 1] - 0.12 * (q[:, 2] + 0.012), q[:, 2]], 1)
        ear = ellipsoid(tilt, (0.0760, 0.466, -0.014), (0.0085, 0.0315, 0.0190))
        ear = smax(ear, -ellipsoid(tilt, (0.0850, 0.469, -0.011), (0.0085, 0.0210, 0.0110)), 0.005)
        ear = smin(ear, ellipsoid(tilt, (0.0740, 0.437, -0.008), (0.0060, 0.0085, 0.0075)), 0.008)
        d = smin(d, ear, 0.006)
        # Hair: waves over the skull behind a hairline, thicker at the crown and the nape.
        swirl = q[:, 1] * 95.0 + 1.9 * np.sin(q[:, 2] * 42.0) + 1.4 * np.sin(q[:, 0] * 55.0)
        waves = 0.0028 * np.sin(swirl) + 0.0016 * np.sin(q[:, 2] * 120.0 + 2.0 * np.sin(q[:, 1] * 60.0))
        hair = ellipsoid(q, (0, 0.518, -0.024), (0.0835, 0.0920, 0.1000))
        hair = smin(hair, ellipsoid(q, (0, 0.452, -0.072), (0.060, 0.050, 0.040)), 0.03) + waves
        line = q[:, 2] - (0.046 - 3.2 * (q[:, 0] - 0.02) ** 2) - 0.62 * (q[:, 1] - 0.545)
        side = 0.475 - q[:, 1] + np.maximum(q[:, 2] + 0.035, 0.0) * 0.9 - np.maximum(-0.035 - q[:, 2], 0) * 1.6
        d = smin(d, smax(smax(hair, line, 0.012), side, 0.015), 0.004)
        # Neck with its two cords and the throat.
        d = smin(d, capsule(q, (0, 0.430, -0.030), (0, 0.310, -0.034), 0.047, 0.055), 0.03)
        d = smin(d, capsule(q, (0.050, 0.425, -0.030), (0.014, 0.312, 0.020), 0.010, 0.009), 0.018)
        d = smin(d, ellipsoid(q, (0, 0.355, 0.016), (0.010, 0.014, 0.010)), 0.02)
        # Shoulders, chest and collar bones, cut below in an arc.
        body = capsule(q, (0.0, 0.292, -0.040), (0.150, 0.262, -0.045), 0.050, 0.046)
        body = smin(body, ellipsoid(p, (0, 0.225, -0.030), (0.165, 0.105, 0.078)), 0.05)
        body = smin(body, ellipsoid(q, (0.070, 0.232, 0.018), (0.078, 0.062, 0.044)), 0.05)
        body = smin(body, ellipsoid(p, (0, 0.240, 0.025), (0.050, 0.060, 0.040)), 0.03)
        body = smin(body, capsule(q, (0.016, 0.3020, 0.022), (0.130, 0.3030, -0.010), 0.0085, 0.0070), 0.016)
        bowl = length((p - vec(0, 0.345, -0.02)) * vec(0.86, 1.0, 1.15)) - 0.185
        body = smax(body, bowl, 0.012)
        body = smax(body, q[:, 0] - 0.178, 0.02)
        d = smin(d, body, 0.035)
        # Plinth, turned: foot, cove, stem.
        r = np.hypot(p[:, 0], p[:, 2] + 0.02)
        y = p[:, 1]
        stem = r - (0.046 + 0.030 * np.clip((0.085 - y) / 0.06, 0, 1) ** 2 + 0.024 * np.clip((y - 0.130) / 0.05, 0, 1) ** 2)
        plinth = np.maximum(np.maximum(stem * 0.8, y - 0.182), 0.02 - y)
        plinth = np.minimum(plinth, cylinder(p, (0, 0.014, -0.02), 1, 0.098, 0.014, 0.004))
        plinth = np.minimum(plinth, torus(p, (0, 0.034, -0.02), 1, 0.078, 0.009))
        plinth = np.minimum(plinth, torus(p, (0, 0.112, -0.02), 1, 0.050, 0.0075))
        return smin(d, plinth, 0.008)

    return surface_nets(f, (-0.20, 0.0, -0.15), (0.20, 0.63, 0.13), 0.0050)


def human(q, p, guitar):
    """A standing figure, 1.78 m, whose arms hold a guitar when asked to."""
    d = ellipsoid(p, (0, 1.665, 0.015), (0.078, 0.108, 0.095))
    d = smin(d, ellipsoid(p, (0, 1.605, 0.045), (0.048, 0.055, 0.055)), 0.04)
    d = smin(d, ellipsoid(p, (0, 1.635, 0.110), (0.012, 0.024, 0.016)), 0.02)
    hair = ellipsoid(p, (0, 1.690, -0.005), (0.090, 0.098, 0.105))
    hair = smin(hair, ellipsoid(p, (0, 1.580, -0.045), (0.080, 0.100, 0.055)), 0.04)
    d = smin(d, smax(hair, p[:, 2] - 0.045 - 0.4 * (p[:, 1] - 1.70), 0.03), 0.01)
    d = smin(d, capsule(p, (0, 1.60, -0.005), (0, 1.48, -0.02), 0.052, 0.060), 0.04)
    # Trunk.
    d = smin(d, capsule(q, (0.03, 1.435, -0.02), (0.165, 1.415, -0.025), 0.070, 0.060), 0.05)
    d = smin(d, ellipsoid(q, (0.065, 1.300, 0.0), (0.125, 0.155, 0.105)), 0.08)
    d = smin(d, ellipsoid(p, (0, 1.110, 0.0), (0.148, 0.170, 0.100)), 0.10)
    d = smin(d, ellipsoid(q, (0.060, 0.965, -0.01), (0.120, 0.110, 0.112)), 0.08)
    # Legs: one straight, one set aside.
    for hip, knee, ankle, toe in (
        ((0.095, 0.93, 0.0), (0.115, 0.50, 0.015), (0.125, 0.09, -0.02), (0.145, 0.045, 0.15)),
        ((-0.095, 0.93, 0.0), (-0.150, 0.51, 0.055), (-0.205, 0.09, 0.005), (-0.265, 0.045, 0.16)),
    ):
        d = smin(d, capsule(p, hip, knee, 0.090, 0.060), 0.05)
        d = smin(d, capsule(p, knee, ankle, 0.060, 0.042), 0.03)
        heel = (ankle[0], 0.05, ankle[2] - 0.015)
        d = smin(d, capsule(p, heel, toe, 0.048, 0.036), 0.03)
    # Arms.
    if guitar:
        right = ((-0.215, 1.405, -0.02), (-0.300, 1.150, 0.020), (-0.085, 1.075, 0.205), (-0.035, 1.055, 0.200))
        left = ((0.215, 1.405, -0.02), (0.335, 1.170, 0.080), (0.400, 1.285, 0.245), (0.385, 1.330, 0.225))
    else:
        right = ((-0.215, 1.405, -0.02), (-0.285, 1.130, -0.02), (-0.260, 0.890, 0.070), (-0.255, 0.820, 0.100))
        left = ((0.215, 1.405, -0.02), (0.360, 1.560, 0.030), (0.385, 1.830, 0.075), (0.380, 1.910, 0.085))
    for shoulder, elbow, wrist, hand in (right, left):
        d = smin(d, capsule(p, shoulder, elbow, 0.055, 0.043), 0.04)
        d = smin(d, capsule(p, elbow, wrist, 0.042, 0.030), 0.02)
        d = smin(d, capsule(p, wrist, hand, 0.036, 0.034), 0.02)
    return smax(d, 0.004 - p[:, 1], 0.01)


def figure():
    """A guitarist."""
    turn = np.radians(20.0)
    along = vec(np.cos(turn), np.sin(turn), 0.12)
    along /= np.linalg.norm(along)
    front = vec(-0.10, 0.0, 1.0)
    front -= (front @ along) * along
    front /= np.linalg.norm(front)
    frame = np.stack([along, np.cross(front, along), front], axis=1)
    center = vec(-0.085, 1.075, 0.155)

    def f(p):
        d = human(mirror(p), p, True)
        g = (p - center) @ frame
        body = np.minimum(ellipsoid(g, (-0.065, 0, 0), (0.150, 0.160, 0.400)), ellipsoid(g, (0.115, 0, 0), (0.115, 0.122, 0.400)))
        body = smin(ellipsoid(g, (-0.065, 0, 0), (0.150, 0.160, 0.400)), body, 0.05)
        body = smax(body, np.abs(g[:, 2]) - 0.024, 0.012)
        body = smax(body, -ellipsoid(g, (0.225, -0.105, 0.0), (0.060, 0.060, 0.200)), 0.02)
        neck = box(g, (0.43, 0, 0.018), (0.255, 0.026, 0.012), 0.008)
        head = box(g, (0.735, 0.008, 0.010), (0.065, 0.040, 0.010), 0.008)
        guitar = np.minimum(np.minimum(body, neck), head)
        return smin(d, guitar, 0.012)

    return surface_nets(f, (-0.55, 0.0, -0.20), (0.70, 1.80, 0.35), 0.0125)


def singer():
    """A singer with one arm up and a microphone stand."""
    def f(p):
        d = human(mirror(p), p, False)
        stand = capsule(p, (-0.16, 0.02, 0.30), (-0.13, 1.50, 0.27), 0.014)
        stand = np.minimum(stand, capsule(p, (-0.13, 1.50, 0.27), (-0.01, 1.585, 0.185), 0.014, 0.024))
        stand = np.minimum(stand, cylinder(p, (-0.16, 0.018, 0.30), 1, 0.14, 0.016, 0.006))
        return np.minimum(d, stand)

    return surface_nets(f, (-0.45, 0.0, -0.20), (0.50, 1.98, 0.48), 0.0125)


def car_shape(p):
    """Body of a saloon car: 4.4 m along z, nose towards +z; windows are cut in."""
    q = mirror(p)
    x, y, z = q[:, 0], q[:, 1], q[:, 2]
    # Lower body, drawn in at nose and tail, with a falling bonnet.
    half = 0.885 - 0.10 * np.clip((np.abs(z) - 1.35) / 0.85, 0, 1) ** 2
    deck = 0.93 - 0.145 * np.clip((z - 0.55) / 1.6, 0, 1) ** 1.3 - 0.05 * np.clip((-z - 1.25) / 0.9, 0, 1)
    tuck = 0.05 * np.clip((0.42 - y) / 0.25, 0, 1) ** 2 - 0.018 * np.clip(1.0 - np.abs(y - 0.66) / 0.10, 0, 1)
    body = smax(x - half + tuck, y - deck, 0.16)
    body = smax(body, np.abs(z + 0.02 * y) - 2.17 + 0.10 * np.clip((0.45 - y) / 0.3, 0, 1), 0.22)
    body = smax(body, 0.21 - y, 0.06)
    # Cabin: sides lean in, screens slope.
    lean = 0.845 - 0.36 * (y - 0.85)
    cabin = smax(x - lean, y - 1.43 + 0.045 * (z + 0.25) ** 2, 0.12)
    front = (z - 0.98) * 0.60 + (y - 0.86) * 0.80
    back = (-z - 1.78) * 0.66 + (y - 0.90) * 0.72
    cabin = smax(smax(cabin, front, 0.08), back, 0.10)
    cabin = smax(cabin, 0.6 - y, 0.05)
    return body, cabin, smin(body, cabin, 0.06)


def window(p, cabin):
    """Where the cabin is glass: negative inside the openings, on the cabin's skin."""
    q = mirror(p)
    x, y, z = q[:, 0], q[:, 1], q[:, 2]
    front = (z - 0.98) * 0.60 + (y - 0.86) * 0.80
    back = (-z - 1.78) * 0.66 + (y - 0.90) * 0.72
    band = np.maximum(0.945 - y, y - 1.352)
    pillars = np.maximum(np.maximum(front, back) + 0.085, 0.045 - np.abs(z + 0.33))
    sides = smax(smax(band, pillars, 0.05), 0.62 - x, 0.01)
    width = x - (0.745 - 0.36 * (y - 0.85))
    screens = smax(smax(band + 0.0, width, 0.05), np.minimum(-front - 0.05, -back - 0.05), 0.01)
    return np.minimum(sides, screens)


def car():
    def f(p):
        q = mirror(p)
        x, y, z = q[:, 0], q[:, 1], q[:, 2]
        body, cabin, d = car_shape(p)
        d = smax(d, -np.maximum(window(p, cabin), -cabin - 0.030), 0.012)
        # Wheel arches, wheels with hubs.
        for at in (1.36, -1.32):
            d = smax(d, -cylinder(q, (0.80, 0.335, at), 0, 0.385, 0.22), 0.02)
            wheel = cylinder(q, (0.775, 0.325, at), 0, 0.322, 0.105, 0.05)
            wheel = smax(wheel, -cylinder(q, (0.885, 0.325, at), 0, 0.205, 0.035), 0.015)
            spokes = np.cos(5.0 * np.arctan2(y - 0.325, z - at))
            disc = np.maximum(cylinder(q, (0.84, 0.325, at), 0, 0.20, 0.025, 0.01), -0.02 * spokes - 0.012)
            wheel = np.minimum(wheel, smin(disc, ellipsoid(q, (0.85, 0.325, at), (0.03, 0.05, 0.05)), 0.02))
            d = np.minimum(d, wheel)
        d = smax(d, 0.004 - y, 0.01)
        # Lamps, grille, door gaps, mirrors.
        d = smax(d, -box(q, (0.62, 0.655, 2.165), (0.150, 0.060, 0.055), 0.04), 0.012)
        d = smin(d, ellipsoid(q, (0.62, 0.655, 2.085), (0.125, 0.050, 0.060)), 0.01)
        d = smax(d, -box(q, (0.66, 0.745, -2.20), (0.170, 0.055, 0.050), 0.02), 0.010)
        d = smax(d, -box(q, (0.0, 0.50, 2.20), (0.42, 0.085, 0.060), 0.03), 0.012)
        for at in (0.76, -0.33, -1.10):
            seam = np.exp(-((z - at - 0.10 * (y - 0.6)) / 0.028) ** 2)
            d = d + 0.011 * seam * (np.clip((y - 0.34) / 0.06, 0, 1) * np.clip((0.91 - y) / 0.06, 0, 1))
        d = smin(d, ellipsoid(q, (0.930, 0.975, 0.62), (0.105, 0.065, 0.060)), 0.04)
        return d

    return surface_nets(f, (-1.08, 0.0, -2.25), (1.08, 1.50, 2.25), 0.034)


def car_windows():
    """The panes that fill the openings of car.ply, 90 mm thick, to be made of something darker."""
    def f(p):
        _, cabin, _ = car_shape(p)
        return smax(smax(window(p, cabin) - 0.004, np.abs(cabin + 0.055) - 0.045, 0.01), 0.90 - p[:, 1], 0.004)

    return surface_nets(f, (-0.95, 0.85, -2.0), (0.95, 1.50, 1.4), 0.028)


def ring():
    """A torus lying on the ground: radii 0.35 m and 0.09 m."""
    major, minor, n, m = 0.35, 0.09, 192, 64
    u, v = np.meshgrid(2 * np.pi * np.arange(n) / n, 2 * np.pi * np.arange(m) / m, indexing="ij")
    normals = np.stack([np.cos(v) * np.cos(u), np.sin(v), np.cos(v) * np.sin(u)], -1)
    center = np.stack([np.cos(u), np.zeros_like(u), np.sin(u)], -1) * major + vec(0, minor, 0)
    i, j = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")
    at = lambda a, b: ((a % n) * m + b % m).reshape(-1)
    a, b, c, d = at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)
    triangles = np.concatenate([np.stack([a, c, b], 1), np.stack([a, d, c], 1)])
    return (center + minor * normals).reshape(-1, 3), normals.reshape(-1, 3), triangles


def snapped(mesh, step):
    """Corners on multiples of a step [m]: triangles that would have no area in f32, once they stand
    some metres away, vanish here."""
    vertices, normals, triangles = mesh
    return np.round(vertices / step) * step, normals, triangles


def street_lamp():
    """A tapered pole of 6 m with an arm over +z; the light belongs under the hood, at
    (0, 5.78, 1.62)."""
    foot = tube([(0, 0, 0), (0, 0.30, 0), (0, 0.34, 0), (0, 0.42, 0)], [0.16, 0.14, 0.10, 0.085], 24)
    t = np.linspace(0, np.pi / 2, 14)
    arc = [(0, 5.2 + 0.75 * np.sin(a), 0.75 * (1 - np.cos(a))) for a in t]
    pole = [(0, y, 0) for y in np.linspace(0.38, 5.1, 8)] + arc + [(0, 5.96, 1.2), (0, 5.95, 1.45)]
    pole = tube(pole, np.linspace(0.080, 0.032, len(pole)), 24)
    hood = lambda p: smax(ellipsoid(p, (0, 5.80, 1.62), (0.14, 0.20, 0.30)), np.maximum(
        5.80 - p[:, 1], -ellipsoid(p, (0, 5.77, 1.62), (0.12, 0.17, 0.27))), 0.02)
    hood = surface_nets(hood, (-0.2, 5.7, 1.2), (0.2, 6.05, 2.0), 0.02)
    return join([foot, pole, snapped(hood, 2.0 ** -14)])


def truss():
    """Three metres of square stage truss along x, 0.3 m wide, its lower chords at y = 0.025."""
    parts, w, r = [], 0.15, 0.025
    corners = [(y, z) for y in (-w, w) for z in (-w, w)]
    low = w + r
    parts += [tube([(-1.5, y + low, z), (1.5, y + low, z)], r, 14) for y, z in corners]
    bays = np.linspace(-1.48, 1.48, 9)
    for i, (a, b) in enumerate(zip(bays, bays[1:])):
        ends = (a, b) if i % 2 == 0 else (b, a)
        for s in (-w, w):
            parts.append(tube([(ends[0], low - w, s), (ends[1], low + w, s)], 0.010, 8))
            parts.append(tube([(ends[1], low + s, -w), (ends[0], low + s, w)], 0.010, 8))
    for x in (bays[0], bays[-1]):
        for s in (-w, w):
            parts.append(tube([(x, low - w, s), (x, low + w, s)], 0.012, 8))
            parts.append(tube([(x, low + s, -w), (x, low + s, w)], 0.012, 8))
    return join(parts)


def puddles():
    """Water on a road 9 m wide and 64 m long, as plates 4 mm thick with wavy outlines."""
    random, parts, n = np.random.default_rng(5), [], 40
    turn = 2.0 * np.pi * np.arange(n) / n
    for _ in range(210):
        x, z = random.uniform(-4.2, 4.2), random.uniform(-50.0, 14.0)
        size, stretch = 0.16 + 0.7 * random.uniform() ** 2, random.uniform(1.2, 3.5)
        r = np.ones(n)
        for k in range(2, 7):
            r += random.uniform(0.0, 0.7 / k) * np.cos(k * turn + random.uniform(0.0, 2.0 * np.pi))
        rim = np.column_stack([
            np.clip(x + size * r * np.cos(turn), -4.48, 4.48), z + stretch * size * r * np.sin(turn)])
        level = lambda y: np.column_stack([rim[:, 0], np.full(n, y), rim[:, 1]])
        middles = np.array([[x, 0.0, z], [x, 0.004, z]])
        i, j = np.arange(n), (np.arange(n) + 1) % n
        fan = lambda a, b, c: np.stack([a, b, np.full(n, c)], 1)
        parts.append((np.concatenate([level(0.0), level(0.004), middles]), None, np.concatenate([
            fan(i, j, 2 * n), fan(j + n, i + n, 2 * n + 1),
            np.stack([i, i + n, j], 1), np.stack([j, i + n, j + n], 1)])))
    return join(parts)


def lit_windows():
    """The panes of a few sash windows along two house fronts, at x = -8 m and x = 8 m."""
    parts = []
    for side, z0, choice in ((-1, -1.5, (0, 3, 5, 8, 13)), (1, -6.0, (1, 2, 6, 9, 12))):
        for k in choice:
            floor, bay = k % 2, k // 2
            y, z = 1.5 + 3.0 * floor, z0 - 3.1 * bay
            for row in (0, 1):
                for column in (0, 1):
                    low, front = (y + 0.78 * row, z - 0.52 * column), 7.99
                    outline = [(low[0], low[1] - 0.48), (low[0] + 0.72, low[1] - 0.48),
                               (low[0] + 0.72, low[1]), (low[0], low[1])]
                    v, _, t = prism(outline, front, front + 0.1)
                    v = np.column_stack([side * v[:, 2], v[:, 0], v[:, 1]])
                    parts.append((v, None, t if side > 0 else t[:, ::-1]))
    return join(parts)


def window_wall():
    """A church wall, 9 m by 7 m by 0.5 m, with three pointed windows that have tracery."""
    parts, width, top, z0, z1 = [], 9.0, 7.0, -0.25, 0.25
    half, sill, spring = 0.75, 1.6, 4.2
    centers = (-2.7, 0.0, 2.7)
    slab = lambda x0, x1, y0, y1, a=z0, b=z1: parts.append(
        prism([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], a, b))
    edges = [-width / 2] + [c + s * half for c in centers for s in (-1, 1)] + [width / 2]
    for x0, x1 in zip(edges[0::2], edges[1::2]):
        slab(x0, x1, 0.0, top)
    for c in centers:
        slab(c - half, c + half, 0.0, sill)
        # A pointed arch: two arcs of radius 2 half, each about the other's foot.
        x = c + half * np.linspace(-1, 1, 25)
        y = spring + np.sqrt(np.maximum((2 * half) ** 2 - (np.abs(x - c) + half) ** 2, 0.0))
        for a, b, ya, yb in zip(x, x[1:], y, y[1:]):
            parts.append(prism([(a, ya), (b, yb), (b, top), (a, top)], z0, z1))
        # Mullion, bars, and two small arches.
        slab(c - 0.05, c + 0.05, sill, spring + 0.9, -0.08, 0.08)
        for h in np.linspace(sill, spring, 6)[1:-1]:
            slab(c - half, c + half, h - 0.018, h + 0.018, -0.03, 0.03)
        for s in (-1, 1):
            m = c + s * half / 2
            t = np.linspace(0, np.pi, 17)
            curve = [(m + 0.36 * np.cos(a), spring + 0.42 * np.sin(a), 0.0) for a in t]
            vertices, _, triangles = tube(curve, 0.045, 8)
            parts.append((vertices, None, triangles))
        t = np.linspace(0, 2 * np.pi, 25)[:-1]
        for a, b in zip(t, np.roll(t, -1)):
            at = lambda r, a: (c + r * np.cos(a), spring + 0.72 + r * np.sin(a))
            parts.append(prism([at(0.22, a), at(0.27, a), at(0.27, b), at(0.22, b)], -0.06, 0.06))
    return join(parts)


MESHES = {m.__name__: m for m in (
    bust, figure, singer, car, car_windows, lit_windows,
    puddles, ring, street_lamp, truss, window_wall)}

if __name__ == "__main__":
    for name in sys.argv[1:] or MESHES:
        write_ply(name, MESHES[name]())
