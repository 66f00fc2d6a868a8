"""Rising smoke that meets a ball, after figure 1 of Fedkiw, Stam & Jensen 2001.

Warm smoke leaves a round plate, rises, wraps itself around a ball and breaks
into billows above it.  The force per mass of the paper (eq. 8) is
    f = (β T - α ρ) ŷ,      β = g / T_air = 9.81 / 293 m/(s² K),
with T the temperature above the air's [K], ρ the density grid [1] and α the
weight of smoke where ρ = 1 [m/s²].  There is no cooling and no diffusion apart
from the grid's.

The plate feeds ρ, T and an upward speed into a thin cylinder, all three
modulated by gradient noise that drifts through it, so that the column is uneven
and turns turbulent; a plume from an even plate would stay a smooth tube until
well past the ball.
"""

import numpy as np
from numba import njit

import noise
import vdbout
from fluid import Fluid

CELLS = (128, 256, 128)
H = 0.0085  # cell size [m]
CORNER = (-64 * H, 0.0, -64 * H)  # world position of the grid's lower corner [m]

BALL_CENTRE = (0.03, 0.75, 0.01)  # [m]; a little off the axis, so the plume parts unevenly
BALL_RADIUS = 0.16  # [m]

PLATE_HEIGHT, PLATE_RADIUS, PLATE_THICKNESS = 0.10, 0.10, 0.03  # [m]
PLATE_SPEED = 1.0  # [m/s]
HEAT = 150.0  # [K]
BETA = 9.81 / 293.0
ALPHA = 0.25
EPSILON = 0.25  # confinement; at 0 detail dies above the ball, at 1 it boils like a fluid of its own
CFL = 3.5
FRAME = 0.36  # time between written frames [s]
FRAMES = 6
THRESHOLD = 0.006  # density below which a voxel is left out


@njit(cache=True)
def _uneven(positions, time, seed):
    """Drifting noise in [0, 1] at positions [m]: grains of 6 cm and down."""
    out = np.empty(positions.shape[0], np.float32)
    for n in range(positions.shape[0]):
        x, y, z = positions[n]
        value = noise.fbm(x / 0.06, (y - 0.9 * time) / 0.06, z / 0.06, 3, 0.6, seed)
        out[n] = min(max(0.5 + 1.6 * value, 0.0), 1.0)
    return out


class Plate:
    """The cells of the source and what they are kept at."""

    def __init__(self, h, shape, corner):
        index = np.indices(shape).reshape(3, -1).T
        p = (index + 0.5) * h + corner
        r = np.hypot(p[:, 0], p[:, 2])
        inside = (r < PLATE_RADIUS) & (np.abs(p[:, 1] - PLATE_HEIGHT) < 0.5 * PLATE_THICKNESS)
        self.cells = tuple(index[inside].T)
        self.positions = p[inside]
        # Full in the middle, gone at the rim.
        self.profile = np.clip(4.0 * (1.0 - r[inside] / PLATE_RADIUS), 0.0, 1.0)

    def feed(self, fluid, time):
        """Sets smoke, heat and speed in the cells of the plate."""
        grain = _uneven(self.positions, time, 5)
        warm = _uneven(self.positions, time, 11)
        density, heat = fluid.scalars["density"], fluid.scalars["temperature"]
        density[self.cells] = np.maximum(density[self.cells],
                                         self.profile * (0.35 + 0.65 * grain))
        heat[self.cells] = np.maximum(heat[self.cells], HEAT * self.profile * (0.4 + 0.6 * warm))
        fluid.velocity[1][self.cells] = PLATE_SPEED * self.profile * (0.3 + 1.4 * warm)
        for axis, seed in ((0, 23), (2, 31)):
            sway = 2.0 * _uneven(self.positions, time, seed) - 1.0
            fluid.velocity[axis][self.cells] = 0.5 * PLATE_SPEED * self.profile * sway


def simulate(cells=CELLS):
    """Yields (frame, fluid) for frames 1 .. FRAMES; `cells` may be coarser for a trial."""
    h = H * CELLS[0] / cells[0]
    ball = [(c - o) / h for c, o in zip(BALL_CENTRE, CORNER)] + [BALL_RADIUS / h]
    fluid = Fluid(cells, h, EPSILON, tuple(ball))
    fluid.add_scalar("density")
    fluid.add_scalar("temperature")
    plate = Plate(h, cells, CORNER)
    time = 0.0
    for frame in range(1, FRAMES + 1):
        while time < frame * FRAME - 1e-6:
            left = frame * FRAME - time
            dt = min(left / fluid.steps_for(left, CFL), 0.02)
            plate.feed(fluid, time)
            lift = BETA * fluid.scalars["temperature"] - ALPHA * fluid.scalars["density"]
            fluid.step(dt, lift)
            time += dt
        yield frame, fluid


def _halved(values):
    """Mean over blocks of 2 x 2 x 2 cells."""
    x, y, z = (n // 2 for n in values.shape[:3])
    return values.reshape(x, 2, y, 2, z, 2, -1).mean(axis=(1, 3, 5))


def grids(fluid, everything):
    """The grids of one frame: `density`, and with `everything` the others as well."""
    notes = {"ball_centre_x": BALL_CENTRE[0], "ball_centre_y": BALL_CENTRE[1],
             "ball_centre_z": BALL_CENTRE[2], "ball_radius": BALL_RADIUS}
    density = fluid.scalars["density"] * fluid.open_cells
    active = density > THRESHOLD
    out = [vdbout.grid("density", density, fluid.h, CORNER, active, notes)]
    if everything:
        heat = fluid.scalars["temperature"] * fluid.open_cells
        out.append(vdbout.grid("temperature", heat, fluid.h, CORNER, active,
                               notes | {"unit": "kelvin above the air"}))
        # Velocity wherever a block of eight holds smoke.
        coarse = _halved(active.astype(np.float32))[..., 0] > 0.0
        out.append(vdbout.grid("velocity", _halved(fluid.centred_velocity()), 2.0 * fluid.h,
                               CORNER, coarse, notes | {"unit": "m/s"}))
    return out


def write(folder, cells=CELLS):
    """rising_smoke_0001.vdb ..., and the last frame with all grids as rising_smoke.vdb."""
    for frame, fluid in simulate(cells):
        notes = {"title": "smoke rising past a ball", "time_s": frame * FRAME,
                 "ball": "centre {} {} {} m, radius {} m".format(*BALL_CENTRE, BALL_RADIUS)}
        vdbout.write(folder / f"rising_smoke_{frame:04d}.vdb", grids(fluid, False), notes)
        yield frame
    vdbout.write(folder / "rising_smoke.vdb", grids(fluid, True), notes)
