"""The loops over voxels of the fluid solver, compiled by numba.

Layout.  A staggered (MAC) grid, Harlow & Welch 1965: cell (i, j, k) fills
[i, i+1] x [j, j+1] x [k, k+1] in cell units; scalars live at its centre, and the
velocity components u, v, w [m/s] at the centres of the faces normal to x, y, z,
    u[i, j, k] at (i, j+1/2, k+1/2),   v at (i+1/2, j, k+1/2),   w at (i+1/2, j+1/2, k).
The vertical axis is y.

Advection, ∂q/∂t + u·∇q = 0, by the unconditionally stable MacCormack scheme of
Selle, Fedkiw, Kim, Liu & Rossignac 2008 (eq. 5 to 7):
    q̂  = A(q),   q̃ = Aᴿ(q̂),   q' = q̂ + (q - q̃)/2,
with A a semi-Lagrangian step (second-order Runge-Kutta trace, trilinear
lookup), Aᴿ the same backwards in time, and q' clamped to the eight values A has
interpolated from, so that no new extremum appears.

Vorticity confinement, Fedkiw, Stam & Jensen 2001 (eq. 9 to 11):
    ω = ∇×u,   N = ∇|ω| / |∇|ω||,   f = ε h (N × ω)   [m/s²],
evaluated at cell centres and averaged onto the faces.

The solid is a ball given by four numbers (centre and radius, cell units; radius
0 for none); a trace that ends inside is pushed out to its surface.

`c` is everywhere dt / h [s/m]: m/s times c is cells per step.
"""

import math

import numpy as np
from numba import njit, prange

# In single precision, or every product with them would be in double.
HALF, ONE = np.float32(0.5), np.float32(1.0)


@njit(cache=True)
def _corner(p, n):
    """Lower corner and fraction of index coordinate p, clamped to the array."""
    p = min(max(p, np.float32(0.0)), np.float32(n - 1))
    i = min(int(p), n - 2)
    return i, p - np.float32(i)


@njit(cache=True)
def lookup(q, x, y, z):
    """Trilinear value of q at index coordinates."""
    i, fx = _corner(x, q.shape[0])
    j, fy = _corner(y, q.shape[1])
    k, fz = _corner(z, q.shape[2])
    gx, gy, gz = ONE - fx, ONE - fy, ONE - fz
    return (gx * (gy * (gz * q[i, j, k] + fz * q[i, j, k + 1])
                  + fy * (gz * q[i, j + 1, k] + fz * q[i, j + 1, k + 1]))
            + fx * (gy * (gz * q[i + 1, j, k] + fz * q[i + 1, j, k + 1])
                    + fy * (gz * q[i + 1, j + 1, k] + fz * q[i + 1, j + 1, k + 1])))


@njit(parallel=True, cache=True)
def trace(u, v, w, ox, oy, oz, c, ball, feet):
    """For each sample, at index + (ox, oy, oz), where its fluid was a step ago
    (midpoint rule), as index coordinates of that same set of samples."""
    _, nx, ny, nz = feet.shape
    for i in prange(nx):
        for j in range(ny):
            for k in range(nz):
                x, y, z = np.float32(i) + ox, np.float32(j) + oy, np.float32(k) + oz
                mx = x - HALF * c * lookup(u, x, y - HALF, z - HALF)
                my = y - HALF * c * lookup(v, x - HALF, y, z - HALF)
                mz = z - HALF * c * lookup(w, x - HALF, y - HALF, z)
                x -= c * lookup(u, mx, my - HALF, mz - HALF)
                y -= c * lookup(v, mx - HALF, my, mz - HALF)
                z -= c * lookup(w, mx - HALF, my - HALF, mz)
                dx, dy, dz = x - ball[0], y - ball[1], z - ball[2]
                distance = math.sqrt(dx * dx + dy * dy + dz * dz)
                if distance < ball[3]:
                    s = ball[3] / max(distance, HALF)
                    x, y, z = ball[0] + s * dx, ball[1] + s * dy, ball[2] + s * dz
                feet[0, i, j, k] = x - ox
                feet[1, i, j, k] = y - oy
                feet[2, i, j, k] = z - oz


@njit(parallel=True, cache=True)
def _semi_lagrangian(q, feet, open_air, out):
    nx, ny, nz = q.shape
    for i in prange(nx):
        for j in range(ny):
            for k in range(nz):
                x, y, z = feet[0, i, j, k], feet[1, i, j, k], feet[2, i, j, k]
                outside = (x < -0.5 or x > nx - 0.5 or y > ny - 0.5 or z < -0.5
                           or z > nz - 0.5)
                out[i, j, k] = 0.0 if open_air and outside else lookup(q, x, y, z)


@njit(parallel=True, cache=True)
def _correct(q, ahead, back, feet):
    """Turns `ahead` into the clamped, corrected result."""
    nx, ny, nz = q.shape
    for i in prange(nx):
        for j in range(ny):
            for k in range(nz):
                error = HALF * (q[i, j, k] - back[i, j, k])
                x, y, z = feet[0, i, j, k], feet[1, i, j, k], feet[2, i, j, k]
                inside = (0.0 <= x <= nx - 1 and 0.0 <= y <= ny - 1 and 0.0 <= z <= nz - 1)
                if error != 0.0 and inside:
                    a, _ = _corner(x, nx)
                    b, _ = _corner(y, ny)
                    d, _ = _corner(z, nz)
                    low = high = q[a, b, d]
                    for n in range(1, 8):
                        corner = q[a + (n & 1), b + (n >> 1 & 1), d + (n >> 2)]
                        low, high = min(low, corner), max(high, corner)
                    ahead[i, j, k] = min(max(ahead[i, j, k] + error, low), high)


def advect(fields, velocity, offset, c, ball, open_air):
    """One MacCormack step of fields whose samples all sit at index + offset.

    With `open_air` the world outside the sides and top is 0 (smoke, heat);
    without, it repeats the border (velocity)."""
    shape = fields[0].shape
    feet, heads = np.empty((3, *shape), np.float32), np.empty((3, *shape), np.float32)
    offset, c = np.array(offset, np.float32), np.float32(c)
    trace(*velocity, *offset, c, ball, feet)
    trace(*velocity, *offset, -c, ball, heads)
    results = []
    for q in fields:
        ahead, back = np.empty_like(q), np.empty_like(q)
        _semi_lagrangian(q, feet, open_air, ahead)
        _semi_lagrangian(ahead, heads, open_air, back)
        _correct(q, ahead, back, feet)
        results.append(ahead)
    return results


@njit(parallel=True, cache=True)
def mirror_into_ball(q, ball, depth):
    """Fills the outermost `depth` cells of the ball with the mirror image of q
    across its surface, and its inside with 0, so that lookups beside the
    surface see no false edge."""
    nx, ny, nz = q.shape
    for i in prange(nx):
        for j in range(ny):
            for k in range(nz):
                dx, dy, dz = i + 0.5 - ball[0], j + 0.5 - ball[1], k + 0.5 - ball[2]
                distance = math.sqrt(dx * dx + dy * dy + dz * dz)
                if distance < ball[3] - depth:
                    q[i, j, k] = 0.0
                elif distance < ball[3]:
                    # One and a half cells of clearance keep the mirrored
                    # lookup clear of cells that this loop writes.
                    s = max(2.0 * ball[3] - distance, ball[3] + 1.8) / distance
                    q[i, j, k] = lookup(q, ball[0] + s * dx - 0.5, ball[1] + s * dy - 0.5,
                                        ball[2] + s * dz - 0.5)


@njit(parallel=True, cache=True)
def curl(u, v, w, h, out):
    """Vorticity [1/s] at cell centres, central differences; 0 on the border."""
    nx, ny, nz = out.shape[1:]
    s = 0.25 / h
    out[:] = 0.0
    for i in prange(1, nx - 1):
        for j in range(1, ny - 1):
            for k in range(1, nz - 1):
                # A centred velocity is the mean of two faces, a centred
                # difference spans 2 h: together a factor of 1/4.
                dwdy = w[i, j + 1, k] + w[i, j + 1, k + 1] - w[i, j - 1, k] - w[i, j - 1, k + 1]
                dvdz = v[i, j, k + 1] + v[i, j + 1, k + 1] - v[i, j, k - 1] - v[i, j + 1, k - 1]
                dudz = u[i, j, k + 1] + u[i + 1, j, k + 1] - u[i, j, k - 1] - u[i + 1, j, k - 1]
                dwdx = w[i + 1, j, k] + w[i + 1, j, k + 1] - w[i - 1, j, k] - w[i - 1, j, k + 1]
                dvdx = v[i + 1, j, k] + v[i + 1, j + 1, k] - v[i - 1, j, k] - v[i - 1, j + 1, k]
                dudy = u[i, j + 1, k] + u[i + 1, j + 1, k] - u[i, j - 1, k] - u[i + 1, j - 1, k]
                out[0, i, j, k] = s * (dwdy - dvdz)
                out[1, i, j, k] = s * (dudz - dwdx)
                out[2, i, j, k] = s * (dvdx - dudy)


@njit(cache=True)
def _norm(omega, i, j, k):
    return math.sqrt(omega[0, i, j, k] ** 2 + omega[1, i, j, k] ** 2 + omega[2, i, j, k] ** 2)


@njit(parallel=True, cache=True)
def confinement(omega, gain, out):
    """gain (N x ω) at cell centres, gain = ε h [m]; 0 on the two border layers."""
    nx, ny, nz = out.shape[1:]
    out[:] = 0.0
    for i in prange(2, nx - 2):
        for j in range(2, ny - 2):
            for k in range(2, nz - 2):
                gx = _norm(omega, i + 1, j, k) - _norm(omega, i - 1, j, k)
                gy = _norm(omega, i, j + 1, k) - _norm(omega, i, j - 1, k)
                gz = _norm(omega, i, j, k + 1) - _norm(omega, i, j, k - 1)
                s = gain / (math.sqrt(gx * gx + gy * gy + gz * gz) + 1e-6)
                ox, oy, oz = omega[0, i, j, k], omega[1, i, j, k], omega[2, i, j, k]
                out[0, i, j, k] = s * (gy * oz - gz * oy)
                out[1, i, j, k] = s * (gz * ox - gx * oz)
                out[2, i, j, k] = s * (gx * oy - gy * ox)
