#!/usr/bin/env python3
"""This renderer on the scenes of the peers' bench, against that bench's references.

    cargo build --release && benches/peer_vpm.py PEERS [SCENE ...]
    benches/peer_vpm.py --seeds 10 PEERS [SCENE ...]

The second form renders 8 passes with each of some seeds and compares means of the picture and of
its 10 x 10 blocks with the references by their scatter: photons of one pass light many pixels.

PEERS is the folder of the peers' bench: scenes.json, volumes/ and refs/. Scenes are rendered at
200 x 200 on two threads and scored by its metric against its two reference halves. Seconds are
sampling alone (loading and writing excluded, as there). For Cycles and Mitsuba on the same machine
run that folder's bench_peers.py beside it. Needs python3 with numpy and OpenEXR.
"""
import json
import os
import subprocess
import sys
import tempfile

import numpy as np
import OpenEXR

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..")
BINARY = os.path.join(ROOT, "target", "release", "vpm-vdb")
RESOLUTION = 200
SCENES = ("cloud_g0", "cloud_g8", "smoke")
# Photons of a pass and neighbours by scene, and how many passes.
BEAM = {"cloud_g0": (60_000, 150), "cloud_g8": (100_000, 150), "smoke": (200_000, 60)}
PASSES = (1, 2, 4, 8)
SPP = (4, 16, 64)


def vector(v):
    return "[" + ", ".join(repr(float(x)) for x in v) + "]"


def quad(center, x, y):
    """Corner and edges of a quad around its centre; it faces along x cross y."""
    return f"corner = {vector(center - x - y)}, edge_u = {vector(2 * x)}, edge_v = {vector(2 * y)}"


def facing(light):
    """Half edges of a quad light that faces its target."""
    normal = np.subtract(light["target"], light["center"])
    normal /= np.linalg.norm(normal)
    up = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 0.95 else np.array([1.0, 0.0, 0.0])
    x = np.cross(up, normal)
    x /= np.linalg.norm(x)
    y = np.cross(normal, x)
    return 0.5 * light["size"][0] * x, 0.5 * light["size"][1] * y


def light_toml(light):
    if light["type"] == "sun":
        direction = vector(-np.array(light["to_light"]))
        return f"sun = {{ direction = {direction}, irradiance = {float(light['irradiance'])} }}"
    if light["type"] == "constant":
        return f"sky = {{ radiance = {float(light['radiance'])} }}"
    shape = quad(np.array(light["center"], float), *facing(light))
    return f"quad = {{ {shape}, radiance = {float(light['radiance'])} }}"


def scene_toml(scene, volume, photons, neighbours):
    camera, medium = scene["camera"], scene["medium"]
    lines = [
        "[camera]",
        f"position = {vector(camera['origin'])}", f"look_at = {vector(camera['target'])}",
        f"up = {vector(camera['up'])}",
        f"vertical_fov = {float(camera['fov_deg'])}", f"resolution = [{RESOLUTION}, {RESOLUTION}]",
        "[render]",
        f"photons = {photons}", f"neighbours = {neighbours}",
        f"max_bounces = {scene['max_scatter'] or 1000}",
        "[[volume]]",
        f"file = {json.dumps(volume)}",
        f"extinction = {float(medium['sigma_t_scale'])}", f"albedo = {float(medium['albedo'])}",
        f"phase = {{ henyey_greenstein = {{ g = {float(medium['g'])} }} }}",
    ]
    for light in scene["lights"]:
        lines += ["[[light]]", light_toml(light)]
    for surface in scene["surfaces"]:
        x, y = surface["half_size"]
        shape = quad(np.array(surface["center"], float), np.array([x, 0.0, 0.0]), np.array([0.0, y, 0.0]))
        lines += ["[[object]]", f"shape = {{ quad = {{ {shape} }} }}",
                  f"material = {{ diffuse = {{ reflectance = {float(surface['reflectance'])} }} }}"]
    return "\n".join(lines) + "\n"


def load_scene(document, name):
    scene = dict(document["scenes"][name])
    return {**load_scene(document, scene.pop("base")), **scene} if "base" in scene else scene


def picture(file):
    for part in OpenEXR.File(file).parts:
        if "RGBA" in part.channels:
            return part.channels["RGBA"].pixels[..., 0].astype(np.float64)
    raise ValueError(file + " has no colour")


def relmse(x, r1, r2):
    r = 0.5 * (r1 + r2)
    return float(np.mean((x - r1) * (x - r2) / (r**2 + 0.01 * r.mean() ** 2)))


def blocks(x):
    n = RESOLUTION // 10
    return x.reshape(10, n, 10, n).mean((1, 3)).ravel()


def agreement(name, toml, folder, r1, r2, seeds):
    """Prints the mean over the reference's, and how far blocks are off in standard errors."""
    pictures = []
    for seed in range(1, seeds + 1):
        out = os.path.join(folder, "a.exr")
        subprocess.run([BINARY, "render", toml, "--passes", "8", "--seed", str(seed), "--threads", "2",
                        "--quiet", "-o", out], check=True)
        pictures.append(picture(out))
    r = 0.5 * (r1 + r2)
    ratios = np.array([x.mean() / r.mean() for x in pictures])
    found, reference = np.array([blocks(x) for x in pictures]), blocks(r)
    own = np.mean((blocks(r1) - blocks(r2)) ** 2) / 4
    t = (found.mean(0) - reference) / np.sqrt(found.var(0, ddof=1) / seeds + own)
    t = t[reference > 1e-3]
    print("%-9s mean ratio %.4f +- %.4f, of one seed +- %.4f; |t| of %d blocks: worst %.2f, rms %.2f"
          % (name, ratios.mean(), ratios.std(ddof=1) / seeds**0.5, ratios.std(ddof=1), len(t),
             np.abs(t).max(), np.sqrt(np.mean(t**2))), flush=True)


def main():
    seeds = 0
    if sys.argv[1:2] == ["--seeds"] and len(sys.argv) > 3:
        seeds = int(sys.argv[2])
        del sys.argv[1:3]
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    peers = os.path.abspath(sys.argv[1])
    with open(os.path.join(peers, "scenes.json")) as file:
        document = json.load(file)
    if not seeds:
        print("scene     method  passes/spp  load s  render s    relMSE  mean ratio")
    with tempfile.TemporaryDirectory() as folder:
        for name in sys.argv[2:] or SCENES:
            scene = load_scene(document, name)
            volume = os.path.join(peers, document["volumes"][scene["medium"]["volume"]]["file"])
            toml = os.path.join(folder, name + ".toml")
            with open(toml, "w") as file:
                file.write(scene_toml(scene, volume, *BEAM.get(name, (100_000, 100))))
            r1, r2 = (np.load(os.path.join(peers, "refs", f"{name}.{i}.npy")) for i in (1, 2))
            if seeds:
                agreement(name, toml, folder, r1, r2, seeds)
                continue
            runs = [("beam", "--passes", n) for n in PASSES] + [("path", "--spp", n) for n in SPP]
            for method, option, count in runs:
                out, report = os.path.join(folder, "a.exr"), os.path.join(folder, "a.json")
                subprocess.run([BINARY, "render", toml, "--method", method, option, str(count),
                                "--threads", "2", "-o", out, "--report", report],
                               check=True, capture_output=True)
                with open(report) as file:
                    seconds = json.load(file)["time_s"]
                x = picture(out)
                ratio = x.mean() / (0.5 * (r1 + r2).mean())
                render = seconds["total"] - seconds["load"] - seconds["output"]
                print("%-9s %-6s %10d %7.2f %9.2f  %.2e  %10.4f"
                      % (name, method, count, seconds["load"], render, relmse(x, r1, r2), ratio), flush=True)


if __name__ == "__main__":
    main()
