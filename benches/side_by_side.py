#!/usr/bin/env python3
"""Beams beside points at equal time in the scenes of the slides, as pictures and as relMSE.

    cargo build --release && benches/side_by_side.py docs/scenes [SCENE ...]      # some minutes each
    benches/side_by_side.py --sampled [SCENE ...]      # with sampled first order, `passes` alone

Part of each scene at its own resolution, all light from photons, one thread. A pass takes the photons
of the scene file, their map, and the rays: seconds of the part's rays over its share of the picture.
Two comparisons, means over some seeds:

  same photons   points march in fixed steps, as long as makes a pass take what one of beams takes;
                 between the two steps next to that by the powers of their times. As on the slides.
  passes         points march in the steps that the renderer chooses, and the beams get as many
                 passes as take no longer.

For each scene one PNG, left to right: the reference, points with the first of the steps that takes no
longer, beams. References are two long pictures of other seeds: of paths in the smoke, elsewhere of beams
with sampled first order, since paths hardly ever scatter inside a spot's cone or meet a lamp through glass.
relMSE is mean((x - r1) (x - r2) / (r^2 + 0.01 mean(r)^2)), in which the references' own noise cancels.
Needs numpy, OpenEXR and Pillow.
"""
import json
import os
import re
import subprocess
import sys
import tempfile

import Imath
import numpy as np
import OpenEXR
from PIL import Image

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..")
BINARY = os.path.join(ROOT, "target", "release", "vpm-vdb")
# Part of the picture, reference.
PATHS, BEAMS = ("path", "--spp", 256), ("beam", "--passes", 32)
SCENES = {
    "rising_smoke": ((240, 300, 400, 500), PATHS),
    "smoky_cornell": ((100, 100, 300, 300), BEAMS),
    "foggy_street": ((136, 76, 408, 229), BEAMS),
    "concert_stage": ((124, 77, 372, 232), BEAMS),
}
STEPS = [2.0 ** k for k in range(1, 10)]
SEEDS = (1, 2, 3)
DIRECT = "sampled" if "--sampled" in sys.argv else "photons"


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


class Scene:
    def __init__(self, name, folder):
        self.name, self.folder = name, folder
        self.part, (method, *options) = SCENES[name]
        with open(os.path.join(ROOT, "scenes", name + ".toml")) as file:
            text = file.read().replace('"../volumes', f'"{ROOT}/volumes').replace('"meshes/', f'"{ROOT}/scenes/meshes/')
        self.text = re.sub(r"direct = .*\n", "", text)
        width, height = map(int, re.search(r"resolution = \[(\d+), (\d+)\]", text).groups())
        x0, y0, x1, y1 = self.part
        self.share = (x1 - x0) * (y1 - y0) / (width * height)
        line = re.search(r"exposure = (\S+)", text)
        self.exposure = float(line.group(1)) if line else 0.0
        self.halves = [self.render(method, 100 + i, 'direct = "sampled"\n', *options)[1] for i in range(2)]
        mean = sum(self.halves) / 2.0
        self.weight = 1.0 / (mean**2 + 0.01 * mean.mean() ** 2)

    def render(self, method, seed, keys, *options):
        """Seconds of a pass of the whole picture, and the part."""
        toml, out, report = (os.path.join(self.folder, self.name + end) for end in (".toml", ".exr", ".json"))
        with open(toml, "w") as file:
            file.write(self.text.replace("[render]\n", "[render]\n" + keys))
        subprocess.run([BINARY, "render", toml, "--quiet", "--crop", ",".join(map(str, self.part)), "--method", method,
                        "--seed", str(seed), "-o", out, "--report", report, *map(str, options)], check=True)
        with open(report) as file:
            time = json.load(file)["time_s"]
        return time["photons"] + time["map"] + time["gather"] / self.share, rgb(out).astype(np.float64)

    def run(self, method, keys="", passes=1):
        """Least seconds of some seeds, mean relMSE and variance, and a picture."""
        options = ("--passes", passes, "--threads", 1)
        keys = f'direct = "{DIRECT}"\n' + keys
        runs = [self.render(method, seed, keys, *options) for seed in SEEDS]
        pictures = np.stack([picture for _, picture in runs])
        error = (pictures - self.halves[0]) * (pictures - self.halves[1]) * self.weight
        noise = pictures.var(axis=0, ddof=1) * self.weight
        return min(s for s, _ in runs), error.mean(), noise.mean(), pictures[0]


def main():
    out = sys.argv[1]
    for name in sys.argv[2:] or SCENES:
        with tempfile.TemporaryDirectory() as folder:
            scene = Scene(name, folder)
            beam = scene.run("beam")
            print(f"{name}: beam {beam[0]:.1f} s, relMSE {beam[1]:.1e} (variance {beam[2]:.1e})", flush=True)
            point = scene.run("point")
            passes = max(1, int(point[0] / beam[0]))
            beams = scene.run("beam", passes=passes)
            print(f"  point, steps of its own: {point[0]:.1f} s, relMSE {point[1]:.1e} (variance {point[2]:.1e}); "
                  f"{passes} passes of beams {beams[0]:.1f} s, relMSE {beams[1]:.1e}: 1/{point[1] / beams[1]:.1f}", flush=True)
            if DIRECT == "sampled":
                continue
            before = point
            for step in STEPS:
                point = scene.run("point", f"march = {{ step = {step} }}\n")
                print(f"  point, steps of {step:g} voxels: {point[0]:.1f} s, relMSE {point[1]:.1e}", flush=True)
                if point[0] <= beam[0]:
                    break
                before = point
            at = np.log(before[0] / beam[0]) / np.log(before[0] / point[0]) if before[0] > beam[0] else 1.0
            equal = before[1] ** (1.0 - at) * point[1] ** at
            print(f"  point in the beam's time: relMSE {equal:.1e}: 1/{equal / beam[1]:.1f}", flush=True)
            picture = png([sum(scene.halves) / 2.0, point[3], beam[3]], scene.exposure)
            picture.save(os.path.join(out, f"{name}_beam_point.png"), optimize=True)


if __name__ == "__main__":
    main()
