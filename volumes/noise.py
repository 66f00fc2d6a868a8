"""Seeded noise at a point, for the sources of the fluids and the cloud's edge.

Gradient noise (Perlin 2002): at lattice point L a pseudo-random vector g(L),
    n(p) = blend over the 8 corners L of the cell of p of  g(L) · (p - L),
    blend weights s(t) = 6t^5 - 15t^4 + 10t^3.
Here g is not one of Perlin's twelve edge vectors but a hashed point of the cube
[-1, 1]^3, so the pattern shows less of the lattice.  Range about [-1, 1].

Cellular noise (Worley 1996): F1(p) = distance to the nearest of one hashed
feature point per unit cell.  The nearest point is looked for in the 27 cells
around p; a nearer one further away is possible in principle but rare.

Fractal sum: fbm(p) = Σ_o gain^o n(lacunarity^o p + shift_o), with lacunarity
2.03 so that the zeros of successive octaves do not coincide.

Everything is a pure function of (point, seed): no tables, no state.
"""

import math

from numba import njit

LACUNARITY = 2.03


@njit(cache=True)
def _hash(i, j, k, seed):
    """Integer lattice point and seed to a well mixed 32-bit integer."""
    h = (i * 374761393 + j * 668265263 + k * 1442695041 + seed * 974634533) & 0xFFFFFFFF
    h = ((h ^ (h >> 15)) * 2246822519) & 0xFFFFFFFF
    h = ((h ^ (h >> 13)) * 3266489917) & 0xFFFFFFFF
    return h ^ (h >> 16)


@njit(cache=True)
def _three(h):
    """Three numbers in [0, 1) of ten bits each from one hash."""
    return (h & 1023) / 1024.0, ((h >> 10) & 1023) / 1024.0, ((h >> 20) & 1023) / 1024.0


@njit(cache=True)
def _smooth(t):
    return t * t * t * (t * (t * 6.0 - 15.0) + 10.0)


@njit(cache=True)
def gradient(x, y, z, seed):
    """Gradient noise at a point, about [-1, 1], mean 0."""
    i, j, k = math.floor(x), math.floor(y), math.floor(z)
    fx, fy, fz = x - i, y - j, z - k
    sx, sy, sz = _smooth(fx), _smooth(fy), _smooth(fz)
    total = 0.0
    for a in range(2):
        wx = sx if a else 1.0 - sx
        for b in range(2):
            wy = sy if b else 1.0 - sy
            for c in range(2):
                wz = sz if c else 1.0 - sz
                gx, gy, gz = _three(_hash(int(i) + a, int(j) + b, int(k) + c, seed))
                dot = ((2.0 * gx - 1.0) * (fx - a) + (2.0 * gy - 1.0) * (fy - b)
                       + (2.0 * gz - 1.0) * (fz - c))
                total += wx * wy * wz * dot
    return 1.6 * total


@njit(cache=True)
def fbm(x, y, z, octaves, gain, seed):
    """Sum of `octaves` gradient noises, normalised by the sum of amplitudes."""
    total, amplitude, norm = 0.0, 1.0, 0.0
    for o in range(octaves):
        total += amplitude * gradient(x, y, z, seed + 17 * o)
        norm += amplitude
        amplitude *= gain
        x, y, z = LACUNARITY * x, LACUNARITY * y, LACUNARITY * z
    return total / norm


@njit(cache=True)
def worley(x, y, z, seed):
    """Distance to the nearest feature point [lattice cells], about [0, 1]."""
    i, j, k = int(math.floor(x)), int(math.floor(y)), int(math.floor(z))
    nearest = 9.0
    for a in range(-1, 2):
        for b in range(-1, 2):
            for c in range(-1, 2):
                px, py, pz = _three(_hash(i + a, j + b, k + c, seed))
                dx, dy, dz = i + a + px - x, j + b + py - y, k + c + pz - z
                nearest = min(nearest, dx * dx + dy * dy + dz * dz)
    return math.sqrt(nearest)
