#!/usr/bin/env python3
"""Beams beside points at equal time in the scenes of the slides, as pictures and as relMSE.

    cargo build --release && benches/side_by_side.py docs/scenes [SCENE ...]

For each scene one PNG, left to right: paths (two long pictures averaged: the reference), points, and
as many passes of beams as take no longer (at least one). First order comes from photons in both, as
in Jarosz et al. 2008. Seconds are CPU seconds, relMSE as in `estimates.py`: the reference's own noise
is taken off. Points and beams trace the same photons, those of the scene file. Needs numpy, OpenEXR
and Pillow.
"""
import os
import sys
import tempfile

import Imath
import numpy as np
import OpenEXR
from PIL import Image

import estimates

SIZES = {"smoky_cornell": "180x180", "concert_stage": "240x150", "foggy_street": "240x135"}
SPP = {"smoky_cornell": 256, "concert_stage": 128, "foggy_street": 128}
DIRECT = 'direct = "photons"\n'


def rgb(file):
    exr = OpenEXR.InputFile(file)
    box = exr.header()["dataWindow"]
    shape = (box.max.y - box.min.y + 1, box.max.x - box.min.x + 1)
    pixel = Imath.PixelType(Imath.PixelType.FLOAT)
    return np.stack([np.frombuffer(exr.channel(c, pixel), np.float32).reshape(shape) for c in "RGB"], -1)


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
        estimates.REFERENCE_SPP = SPP[name]
        with tempfile.TemporaryDirectory() as folder:
            scene = estimates.Scene(name, folder)
            exposure = [line for line in scene.text.splitlines() if line.startswith("exposure")]
            exposure = float(exposure[0].split("=")[1]) if exposure else 0.0
            seconds, point = scene.render("point", "--method", "point", "--passes", 1, keys=DIRECT)
            one = scene.render("beam", "--passes", 1, keys=DIRECT)[0]
            passes = max(1, int(seconds / one))
            used, beam = scene.render("beam", "--passes", passes, keys=DIRECT)
            errors = [scene.error(picture) for picture in (point, beam)]
            pictures = [sum(rgb(r) for r in scene.references) / 2.0, rgb(point), rgb(beam)]
            png(pictures, exposure).save(os.path.join(out, f"{name}_beam_point.png"), optimize=True)
        print(f"{name} {SIZES[name]}: reference adds {scene.own:.1e}; point {seconds:.1f} s, relMSE "
              f"{errors[0]:.1e}; beam, {passes} passes {used:.1f} s, relMSE {errors[1]:.1e}, "
              f"1/{errors[0] / errors[1]:.1f}", flush=True)


if __name__ == "__main__":
    main()
