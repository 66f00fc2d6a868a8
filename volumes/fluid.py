"""An incompressible (or dilating) fluid on a staggered grid, y up, SI units.

    ∂u/∂t + (u·∇)u = -∇p + f,      ∇·u = s,      u·n = 0 on the solid,
u velocity [m/s], p pressure over density [m²/s²], f force per mass [m/s²]: the
buoyancy the caller supplies and vorticity confinement; s [1/s] is 0 for smoke
and the expansion of burning gas for fire.  There is no viscosity: what damping
there is comes from the grid.

One step, after Fedkiw, Stam & Jensen, "Visual Simulation of Smoke", 2001:
advect u, add dt f, project.  Departures from that paper: MacCormack advection
(see `kernels`) in place of monotonic cubic interpolation, a solid with
fractional faces in place of voxels, and the Poisson solver.

Projection.  With a_f in [0, 1] the open part of face f (Ng, Min & Gibou 2009),
    Σ_f a_f ∂φ/∂n = (1/h) Σ_f a_f u·n - s,       u ← u - ∇φ,    φ = dt p.
a_f is estimated as 1/2 + d/h, clamped, from the signed distance d of the face's
centre to the ball.  Solved by conjugate gradients; the preconditioner is the
same operator without the solid, inverted exactly by fast transforms, since on
a box -∇² has the eigenvalues Σ (2/h)² sin²(θ/2) with
    θ = π(m+1)/N      sine transform II,    open air (φ = 0) on both sides: x, z
    θ = π(m+1/2)/N    cosine transform IV,  floor below, open air above: y.
Without a solid the first iteration is exact.
"""

import math

import numpy as np
from scipy import fft

import kernels

CENTRE = (0.5, 0.5, 0.5)
FACES = ((0.0, 0.5, 0.5), (0.5, 0.0, 0.5), (0.5, 0.5, 0.0))
# Transform of each axis: its kind and the type that undoes it.
TRANSFORMS = ((fft.dst, fft.idst, 2, 1.0), (fft.dct, fft.idct, 4, 0.5), (fft.dst, fft.idst, 2, 1.0))

# Openings smaller than this are closed.  The projection hardly restrains the
# speed in a sliver: at 0 single faces beside the ball run at three times the
# speed of the plume, and conjugate gradients need half as many steps again.
SLIVER = 0.25


def along(axis, part):
    """Index that applies the slice `part` to one axis of a 3-D array."""
    index = [slice(None)] * 3
    index[axis] = part
    return tuple(index)


class Fluid:
    """Velocity, passive scalars and a ball on one grid.

    shape: cells (x, y, z); h: cell size [m]; ball: (x, y, z, radius) in cell
    units, or None; epsilon: strength of the confinement [1]."""

    def __init__(self, shape, h, epsilon, ball=None, tolerance=2e-3):
        self.shape, self.h, self.epsilon, self.tolerance = shape, h, epsilon, tolerance
        self.ball = np.array(ball if ball else (0.0, 0.0, 0.0, 0.0), np.float32)
        self.velocity = [np.zeros([n + (a == b) for b, n in enumerate(shape)], np.float32)
                         for a in range(3)]
        self.scalars = {}
        self.open = [self._open_part(offset, face.shape)
                     for offset, face in zip(FACES, self.velocity)]
        self.open[1][:, 0, :] = 0.0
        self.open_cells = self._open_part(CENTRE, shape)
        self.closed = sum(a[along(axis, slice(1, None))] + a[along(axis, slice(None, -1))]
                          for axis, a in enumerate(self.open)) == 0.0
        self.phi = np.zeros(shape, np.float32)
        self.eigenvalues = sum(
            ((2.0 / h * np.sin(0.5 * np.pi * (np.arange(n) + shift) / n)) ** 2)
            .reshape([-1 if a == b else 1 for b in range(3)])
            for a, (n, (_, _, _, shift)) in enumerate(zip(shape, TRANSFORMS))).astype(np.float32)

    def add_scalar(self, name):
        """A quantity carried along at cell centres, 0 at first."""
        self.scalars[name] = np.zeros(self.shape, np.float32)

    def _open_part(self, offset, shape):
        """1/2 + signed distance to the ball in cells, clamped to [0, 1]."""
        if self.ball[3] == 0.0:
            return np.ones(shape, np.float32)
        axes = np.ogrid[tuple(slice(0, n) for n in shape)]
        squared = sum((x + o - c) ** 2 for x, o, c in zip(axes, offset, self.ball))
        part = np.clip(0.5 + np.sqrt(squared) - self.ball[3], 0.0, 1.0)
        part[part < SLIVER] = 0.0
        return part.astype(np.float32)

    def steps_for(self, duration, cfl):
        """How many equal steps keep the fastest face under `cfl` cells a step."""
        fastest = max(float(np.abs(face).max()) for face in self.velocity)
        return max(1, math.ceil(duration * fastest / (cfl * self.h)))

    def step(self, dt, lift, expansion=0.0):
        """Advances by dt [s] under the upward force `lift` [m/s²] at cell centres."""
        c = dt / self.h
        for q in self.scalars.values():
            if self.ball[3] > 0.0:
                kernels.mirror_into_ball(q, self.ball, 3.0)
        moved = kernels.advect(list(self.scalars.values()), self.velocity, CENTRE, c,
                               self.ball, True)
        self.velocity = [kernels.advect([q], self.velocity, offset, c, self.ball, False)[0]
                         for q, offset in zip(self.velocity, FACES)]
        self.scalars = dict(zip(self.scalars, moved))
        self._add_forces(dt, lift)
        self._project(expansion)

    def _add_forces(self, dt, lift):
        omega = np.empty((3, *self.shape), np.float32)
        kernels.curl(*self.velocity, self.h, omega)
        force = np.empty_like(omega)
        kernels.confinement(omega, self.epsilon * self.h, force)
        force[1] += lift
        for axis, face in enumerate(self.velocity):
            inner = face[along(axis, slice(1, -1))]
            inner += 0.5 * dt * (force[axis][along(axis, slice(1, None))]
                                 + force[axis][along(axis, slice(None, -1))])

    def _gradient(self, phi):
        """∂φ/∂n on every face; φ = 0 half a cell outside means 2φ/h there."""
        for axis in range(3):
            first, last = phi[along(axis, slice(0, 1))], phi[along(axis, slice(-1, None))]
            yield np.concatenate((2.0 * first, np.diff(phi, axis=axis), -2.0 * last),
                                 axis=axis) / self.h

    def _divergence(self, faces):
        """(1/h) Σ a_f q_f over the faces of each cell."""
        return sum(np.diff(a * q, axis=axis)
                   for axis, (a, q) in enumerate(zip(self.open, faces))) / self.h

    def _box_solve(self, r):
        """Solves -∇²φ = r on the box without the solid."""
        for axis, (forward, _, kind, _) in enumerate(TRANSFORMS):
            r = forward(r, type=kind, axis=axis, workers=-1)
        r /= self.eigenvalues
        for axis, (_, inverse, kind, _) in enumerate(TRANSFORMS):
            r = inverse(r, type=kind, axis=axis, workers=-1)
        r[self.closed] = 0.0
        return r

    def _project(self, expansion):
        """Conjugate gradients for -∇·(a∇φ) = s - ∇·(a u), warm-started."""
        source = expansion - self._divergence(self.velocity)
        source[self.closed] = 0.0
        goal = self.tolerance * float(np.abs(source).max())
        phi = self.phi
        r = source + self._divergence(self._gradient(phi))
        r[self.closed] = 0.0
        direction, rz = np.zeros_like(r), 1.0
        while float(np.abs(r).max()) > goal:
            z = self._box_solve(r)
            rz_before, rz = rz, float(np.vdot(r, z))
            direction = z + np.float32(rz / rz_before) * direction
            image = -self._divergence(self._gradient(direction))
            image[self.closed] = 0.0
            step = np.float32(rz / float(np.vdot(direction, image)))
            phi = phi + step * direction
            r -= step * image
        self.phi = phi
        for a, face, slope in zip(self.open, self.velocity, self._gradient(phi)):
            face -= slope
            face[a == 0.0] = 0.0

    def centred_velocity(self):
        """Velocity at cell centres, shape (x, y, z, 3)."""
        return np.stack([0.5 * (q[along(a, slice(1, None))] + q[along(a, slice(None, -1))])
                         for a, q in enumerate(self.velocity)], axis=-1)
