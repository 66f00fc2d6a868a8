"""A small fire: gaseous fuel from a round burner, burnt where it meets the air.

After Nguyen, Fedkiw & Jensen, "Physically Based Modeling and Animation of
Fire", 2002, with the reaction simplified: there the blue core is a level set,
here it is what is left of the fuel.  On the grid are carried
    F  fuel                [1]   1 at the burner
    T  heat                [1]   0 air, 1 = SCALE kelvin above the air
    ρ  soot                [1]
    A  gas                 [1]   the share of burner gas, burnt or not
F and A start equal, and A - F is what has burnt.  Gas of share A holds air of
share 1 - A, and burns as fast as fuel and air find each other,
    b = K F (1 - A)                                                  [1/s]
    DF/Dt = κ∇²F - b,      DT/Dt = κ∇²T + b HEAT_OF_BURNING - C T⁴ - MIX_COOLING T,
    DA/Dt = κ∇²A,          Dρ/Dt = b SOOT_YIELD - ρ / SOOT_LIFE.
κ [m²/s] stands for mixing below the grid, without which the sheets are one
voxel thin and the flames fall apart into threads.
T⁴ is the paper's radiative cooling.  Because b needs both F and
1 - A it lives in a sheet around the fuel, and the flames are hollow, thin
and as wrinkled as the border of the fuel is.

Forces: buoyancy g (1 - ρ_gas/ρ_air) -> LIFT T [m/s²], vorticity confinement.
Expansion: the burning gas swells, ∇·u = SWELL b [1/s] (the paper has the
gas expand at the core's surface instead).

`temperature` is written in units of SCALE kelvin above absolute zero, so that a
renderer multiplies by SCALE = 1500 K; `density` is the soot, which both absorbs
and glows.
"""

import numpy as np
from scipy import ndimage

import noise
import vdbout
from fluid import Fluid

CELLS = (80, 144, 80)
H = 0.0072  # [m]
CORNER = (-40 * H, 0.0, -40 * H)  # [m]
SCALE = 1500.0  # [K]

BURNER_RADIUS, BURNER_HEIGHT = 0.11, 0.03  # [m]
BURNER_SPEED = 0.4  # [m/s]
RISE = 0.3  # speed at which the burner's pattern drifts up [m/s]
K = 8.0  # [1/s]
HEAT_OF_BURNING = 2.5  # heat per unit of fuel [1]
C = 1.1  # [1/s] at T = 1
MIX_COOLING = 0.5  # [1/s]
SOOT_YIELD, SOOT_LIFE = 2.0, 0.6  # [1], [s]
KAPPA = 4e-4  # [m²/s]; the explicit step wants KAPPA dt / h² < 1/6
LIFT = 16.0  # [m/s²]
SWELL = 1.2  # volume gained per unit burnt [1]
EPSILON = 2.0  # [1/s]
CFL = 3.0
DURATION = 1.3  # [s]
THRESHOLD = 0.02  # soot below which a voxel is left out


class Burner:
    """The cells gas comes from."""

    def __init__(self, h, shape):
        index = np.indices(shape).reshape(3, -1).T
        p = (index + 0.5) * h + CORNER
        r = np.hypot(p[:, 0], p[:, 2])
        inside = (r < BURNER_RADIUS) & (p[:, 1] < BURNER_HEIGHT)
        self.cells, self.positions = tuple(index[inside].T), p[inside]

    def feed(self, fluid, time):
        """Patches of the burner give gas, others rest, and they wander."""
        gas = np.clip(2.5 * noise.patches(self.positions, RISE * time, 0.1, 41) - 0.6, 0.0, 1.0)
        for name in ("fuel", "gas"):
            fluid.scalars[name][self.cells] = gas
        # A pilot light: what leaves the burner is warm already.
        fluid.scalars["heat"][self.cells] = np.maximum(fluid.scalars["heat"][self.cells], 0.35 * gas)
        fluid.velocity[1][self.cells] = BURNER_SPEED * gas
        for axis, seed in ((0, 53), (2, 67)):
            fluid.velocity[axis][self.cells] = 0.4 * (
                noise.patches(self.positions, RISE * time, 0.05, seed) - 0.5)


def burn(fluid, dt):
    """One step of the reaction in every cell; returns the burning rate [1/s]."""
    fuel, gas, heat, soot = (fluid.scalars[n] for n in ("fuel", "gas", "heat", "soot"))
    rate = K * fuel * np.clip(1.0 - gas, 0.0, 1.0)
    rate = np.minimum(rate, fuel / dt)
    for q in (fuel, gas, heat):
        q += np.float32(KAPPA * dt / fluid.h ** 2) * ndimage.laplace(q, mode="nearest")
    fuel -= dt * rate
    heat += dt * HEAT_OF_BURNING * rate
    # d T/dt = -C T⁴ has the solution T / (1 + 3 C T³ t)^(1/3).
    heat /= np.cbrt(1.0 + 3.0 * C * dt * heat ** 3)
    heat *= np.float32(np.exp(-dt * MIX_COOLING))
    soot += dt * SOOT_YIELD * rate
    soot *= np.float32(np.exp(-dt / SOOT_LIFE))
    return rate


def simulate(cells=CELLS):
    """The fluid after DURATION seconds of burning."""
    h = H * CELLS[0] / cells[0]
    fluid = Fluid(cells, h, EPSILON)
    for name in ("fuel", "gas", "heat", "soot"):
        fluid.add_scalar(name)
    burner = Burner(h, cells)
    time = 0.0
    while time < DURATION - 1e-6:
        left = DURATION - time
        dt = min(left / fluid.steps_for(left, CFL), 0.012)
        burner.feed(fluid, time)
        rate = burn(fluid, dt)
        fluid.step(dt, LIFT * fluid.scalars["heat"], SWELL * rate)
        time += dt
    return fluid


def write(path, cells=CELLS):
    """fire.vdb: soot as `density`, and `temperature` wherever there is soot."""
    fluid = simulate(cells)
    soot = np.minimum(fluid.scalars["soot"], 1.0)
    kelvin = 293.0 + SCALE * fluid.scalars["heat"]
    active = soot > THRESHOLD
    vdbout.write(path, [
        vdbout.grid("density", soot, fluid.h, CORNER, active, {}),
        vdbout.grid("temperature", kelvin / SCALE, fluid.h, CORNER, active,
                    {"unit": "1500 kelvin", "kelvin_scale": SCALE}),
    ], {"title": "fire over a round burner", "time_s": DURATION})
