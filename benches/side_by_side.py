#!/usr/bin/env python3
"""Beams beside points at equal time in the scenes of the slides, as pictures and as relMSE.

    cargo build --release && benches/side_by_side.py docs/scenes [SCENE ...]

For each scene one PNG, left to right: the reference, points, and as many passes of beams as take no
longer (at least one). First order comes from photons in both, as in Jarosz et al. 2008. References are
two long pictures of other seeds, averaged: of paths in the box; of beams with sampled first order and
a dozen passes on stage and street, where paths hardly ever scatter inside a spot's cone. relMSE is over
the 95 % of the pixels in which the two differ least (a path that comes close to a lamp in haze outshines
a picture), and their own noise there, a quarter of the relMSE between them, is taken off. Seconds are
CPU seconds. Points and beams trace the photons of the scene file. Needs numpy, OpenEXR and Pillow.
"""
import os
import sys
import tempfile

import Imath
import numpy as np
import OpenEXR
from PIL import Image

import estimates

SIZES = {"smoky_cornell": "160x160", "concert_stage": "208x130", "foggy_street": "208x117"}
REFERENCES = {"smoky_cornell": ("--method", "path", "--spp", 128)}
LONG_BEAMS = ("--passes", 12)
DIRECT = 'direct = "photons"\n'


def rgb(file):
    exr = OpenEXR.InputFile(file)
    box = exr.header()["dataWindow"]
    shape = (box.max.y - box.min.y + 1, box.max.x - box.min.x + 1)
    pixel = Imath.PixelType(Imath.PixelType.FLOAT)
    return np.stack([np.frombuffer(exr.channel(c, pixel), np.float32).reshape(shape) for c in "RGB"], -1)


def squares(a, b, floor):
    return ((a - b) ** 2 / (b ** 2 + floor)).mean(axis=-1)


def png(pictures, exposure):
    """Side by side, through a curve that keeps lamps from burning out the rest."""
    x = np.concatenate(pictures, axis=1) * 2.0 ** exposure
    x = 1.0 - np.exp(-1.4 * x)
    x = np.where(x < 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-9) ** (1 / 2.4) - 0.055)
    return Image.fromarray((255.0 * np.clip(x, 0.0, 1.0) + 0.5).astype(np.uint8))


def main():
    out = sys.argv[1]
    for name in sys.argv[2:] or SIZES:
        estimates.SCENES[name] = (SIZES[name], {r'direct = "photons"\n': ""})
        estimates.REFERENCE_SPP = 1
        with tempfile.TemporaryDirectory() as folder:
            scene = estimates.Scene(name, folder)
            options = REFERENCES.get(name, LONG_BEAMS)
            scene.references = [scene.render(f"long{i}", *options, "--seed", 100 + i)[1] for i in range(2)]
            exposure = [line for line in scene.text.splitlines() if line.startswith("exposure")]
            exposure = float(exposure[0].split("=")[1]) if exposure else 0.0
            seconds, point = scene.render("point", "--method", "point", "--passes", 1, keys=DIRECT)
            one = scene.render("beam", "--passes", 1, keys=DIRECT)[0]
            passes = max(1, int(seconds / one))
            used, beam = scene.render("beam", "--passes", passes, keys=DIRECT)
            first, second, point, beam = (rgb(f) for f in (*scene.references, point, beam))
            both = (first + second) / 2.0
            floor = 0.01 * np.median(both.mean(axis=-1)) ** 2
            between = squares(first, second, floor)
            kept = between <= np.quantile(between, 0.95)
            own = between[kept].mean() / 4.0
            errors = [squares(p, both, floor)[kept].mean() - own for p in (point, beam)]
            png([both, point, beam], exposure).save(
                os.path.join(out, f"{name}_beam_point.png"), optimize=True)
        print(f"{name} {SIZES[name]}: reference adds {own:.1e}; point {seconds:.1f} s, relMSE "
              f"{errors[0]:.1e}; beam, {passes} passes {used:.1f} s, relMSE {errors[1]:.1e}, "
              f"1/{errors[0] / errors[1]:.1f}", flush=True)


if __name__ == "__main__":
    main()
