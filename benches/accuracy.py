#!/usr/bin/env python3
"""What accuracy costs in time: relMSE against seconds, photons and paths, on the first scenes.

    cargo build --release && benches/accuracy.py docs/accuracy

writes docs/accuracy.csv and docs/accuracy.png (needs python3 with matplotlib; some six minutes).

Each setting is rendered with several seeds and compared with a long path-traced reference. The
reference is noisy too: half the relMSE between two references of different seeds is what it adds,
and is subtracted. Seconds are the renderer's own, loading excluded, median over the seeds.
"""
import json
import os
import statistics
import subprocess
import sys
import tempfile

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..")
BINARY = os.path.join(ROOT, "target", "release", "vpm-vdb")
SCENES = {"rising_smoke": "320x400", "cloud": "320x200"}
REFERENCE_SPP = 256
PASSES = (1, 2, 4, 8)
SPP = (4, 16, 64)
SEEDS = (1, 2)


def run(*arguments):
    return subprocess.run([BINARY, *map(str, arguments)], check=True, capture_output=True, text=True).stdout


def render(scene, out, *options):
    report = out + ".json"
    run("render", os.path.join(ROOT, "scenes", scene + ".toml"), "--resolution", SCENES[scene],
        "-o", out, "--report", report, *options)
    with open(report) as file:
        seconds = json.load(file)["time_s"]
    return seconds["total"] - seconds["load"] - seconds["output"]


def relmse(a, b):
    return json.loads(run("compare", a, b, "--json"))["relmse"]


def study(scene, folder):
    references = [os.path.join(folder, f"{scene}_{i}.exr") for i in range(2)]
    for i, reference in enumerate(references):
        render(scene, reference, "--method", "path", "--spp", REFERENCE_SPP, "--seed", 100 + i)
    own = 0.5 * relmse(*references)
    settings = [("beam", "--passes", n) for n in PASSES] + [("path", "--spp", n) for n in SPP]
    for method, option, count in settings:
        seconds, errors = [], []
        for seed in SEEDS:
            out = os.path.join(folder, "picture.exr")
            seconds.append(render(scene, out, "--method", method, option, count, "--seed", seed))
            errors.append(relmse(out, references[0]) - own)
        yield scene, method, count, statistics.median(seconds), statistics.mean(errors), statistics.stdev(errors)


def plot(rows, out):
    import matplotlib
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    figure, axes = plt.subplots(1, len(SCENES), figsize=(9, 3.6), sharey=True)
    for axis, scene in zip(axes, SCENES):
        for method, mark in (("beam", "o-"), ("path", "s--")):
            points = [r for r in rows if r[:2] == (scene, method)]
            axis.errorbar([r[3] for r in points], [r[4] for r in points], [r[5] for r in points],
                          fmt=mark, label={"beam": "photons, beam estimate", "path": "path tracer"}[method])
        axis.set(xscale="log", yscale="log", xlabel="time [s]", title=f"{scene}, {SCENES[scene]}")
        axis.grid(True, which="both", alpha=0.3)
    axes[0].set_ylabel("relMSE [1]")
    axes[0].legend()
    figure.tight_layout()
    figure.savefig(out, dpi=100)


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for scene in SCENES:
            for row in study(scene, folder):
                rows.append(row)
                print("%-13s %-5s %5d  %7.2f s  relMSE %.2e +- %.1e" % row, flush=True)
    with open(sys.argv[1] + ".csv", "w") as file:
        file.write("scene,method,passes_or_spp,seconds,relmse,relmse_standard_deviation\n")
        file.writelines("%s,%s,%d,%.3f,%.4e,%.1e\n" % row for row in rows)
    plot(rows, sys.argv[1] + ".png")


if __name__ == "__main__":
    main()
