#!/usr/bin/env python3
"""The photon estimates and the path tracer at equal time, and the time each needs for relMSE 0.01.

    cargo build --release && benches/estimates.py [SCENE ...]       # some minutes; prints two tables
    benches/estimates.py --paths [SCENE ...]                         # the second one only

Time is CPU seconds of the process, less those of a render of one pixel with one photon (reading,
building): shares of a busy machine, not its load, decide. References are two long path-traced
pictures of different seeds; half the relMSE between them is what one of them adds, and is
subtracted. Equal time: one pass of the point estimate, and as many passes of the beam estimate as
fit into no more. Time to relMSE 0.01: paths by their law, relMSE ~ 1 / time, from a run near it;
beams the cheapest setting of photons and passes tried whose mean over three seeds is below it.
"""
import json
import os
import re
import subprocess
import sys
import tempfile

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..")
BINARY = os.path.join(ROOT, "target", "release", "vpm-vdb")
# Resolution, and changes to the scene's text.
SCENES = {
    "rising_smoke": ("320x400", {}),
    "cloud": ("320x200", {}),
    "smoky_cornell": ("256x256", {}),
    "foggy_street": ("320x180", {}),
    "concert_stage": ("320x200", {}),
}
REFERENCE_SPP = 64
# First order, and what else the point estimate is told: the slides' nearest photons at steps of its
# own choice and at small ones, all from photons as there too, and the fixed-radius form.
POINTS = [("sampled", ""), ("sampled", 'search = "radius"\n'), ("sampled", "march = { step = 0.5 }\n"),
          ("photons", ""), ("photons", "march = { step = 0.5 }\n")]
BEAMS = [(n, 1) for n in (12_500, 25_000, 37_500, 50_000, 62_500, 75_000, 100_000, 150_000, 200_000)]
BEAMS += [(200_000, 2), (200_000, 4)]
SEEDS = (1, 2, 3)


class Scene:
    def __init__(self, name, folder):
        self.folder, self.name = folder, name
        self.resolution, self.changes = SCENES[name]
        with open(os.path.join(ROOT, "scenes", name + ".toml")) as file:
            self.text = file.read().replace('"../volumes', f'"{ROOT}/volumes')
        self.text = self.text.replace('"meshes/', f'"{ROOT}/scenes/meshes/')
        for pattern, by in self.changes.items():
            self.text = re.sub(pattern, by, self.text)
        self.set_up = 0.0
        self.set_up = self.render("one", "--crop", "0,0,1,1", "--photons", 1, "--passes", 1)[0]
        self.references = [self.render(f"reference{i}", "--method", "path", "--spp", REFERENCE_SPP,
                                       "--seed", 100 + i)[1] for i in range(2)]
        self.own = 0.5 * self.compare(*self.references)

    def render(self, out, *options, keys=""):
        """CPU seconds and picture; `keys` are added to the scene's [render]."""
        text = self.text.replace("[render]\n", "[render]\n" + keys)
        toml, out = (os.path.join(self.folder, f"{self.name}{e}") for e in (".toml", f"_{out}.exr"))
        with open(toml, "w") as file:
            file.write(text)
        before = os.times()
        subprocess.run([BINARY, "render", toml, "--quiet", "--resolution", self.resolution, "-o", out,
                        *map(str, options)], check=True)
        after = os.times()
        used = sum(getattr(after, k) - getattr(before, k) for k in ("children_user", "children_system"))
        return used - self.set_up, out

    def compare(self, a, b):
        out = subprocess.run([BINARY, "compare", a, b, "--json"], check=True, capture_output=True, text=True)
        return json.loads(out.stdout)["relmse"]

    def error(self, picture):
        return self.compare(picture, self.references[0]) - self.own

    def run(self, *options, keys="", seeds=(1,)):
        """CPU seconds and relMSE, means over seeds."""
        runs = []
        for seed in seeds:
            seconds, picture = self.render("picture", "--seed", seed, *options, keys=keys)
            runs.append((seconds, self.error(picture)))
        return tuple(sum(column) / len(runs) for column in zip(*runs))


def main():
    points = [] if "--paths" in sys.argv else POINTS
    names = [n for n in sys.argv[1:] if n != "--paths"] or [n for n in SCENES if os.path.exists(os.path.join(ROOT, "scenes", n + ".toml"))]
    with tempfile.TemporaryDirectory() as folder:
        for scene in (Scene(name, folder) for name in names):
            print(f"{scene.name}, {scene.resolution}; the reference adds {scene.own:.1e}", flush=True)
            for direct, keys in points:
                direct = f'direct = "{direct}"\n'
                point = scene.run("--method", "point", "--passes", 1, keys=direct + keys)
                one = scene.run("--passes", 1, keys=direct)
                passes = max(1, int(point[0] / one[0]))
                beam = one if passes == 1 else scene.run("--passes", passes, keys=direct)
                print(f"  {direct.strip()}; point, {keys.strip() or 'defaults'}: {point[0]:.2f} s, "
                      f"relMSE {point[1]:.2e}; beam, {passes} passes: {beam[0]:.2f} s, "
                      f"relMSE {beam[1]:.2e}, 1/{point[1] / beam[1]:.1f}", flush=True)
            spp, path = 16, (0.0, 1.0)
            while path[1] > 0.02 and spp <= REFERENCE_SPP:
                path = scene.run("--method", "path", "--spp", spp)
                spp *= 4
            paths = path[0] * path[1] / 0.01
            print(f"  path, {spp // 4:4} spp           {path[0]:8.2f} s  relMSE {path[1]:.2e}  "
                  f"{paths:.2f} s to 0.01", flush=True)
            for photons, passes in BEAMS:
                beam = scene.run("--photons", photons, "--passes", passes, seeds=SEEDS)
                print(f"  beam, {passes} x {photons:7} photons {beam[0]:6.2f} s  relMSE {beam[1]:.2e}", flush=True)
                if beam[1] < 0.01:
                    print(f"  beam takes 1/{paths / beam[0]:.1f} of the paths' time to relMSE 0.01", flush=True)
                    break


if __name__ == "__main__":
    main()
