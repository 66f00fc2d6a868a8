#!/usr/bin/env python3
"""The Cornell box, empty and full of fog, against Mitsuba 3: python3 peer_cornell.py [OPTIONS]

    python3 -m venv /tmp/mi && /tmp/mi/bin/pip install mitsuba numpy
    cargo build --release && /tmp/mi/bin/python benches/peer_cornell.py

Writes the box for both renderers from one list of walls, renders it with Mitsuba's `path` or
`volpath` and with this renderer's `path` and `beam`, and prints the mean of each wall's inner part
(its corners drawn in to 0.8 of their distance from its middle, the lamp left out) as a ratio to
Mitsuba's, with the standard error of that ratio from both pictures' halves. Exit code 1 if a ratio
is off by more than 1 % and 3 standard errors.
"""

import argparse
import os
import subprocess
import sys
import tempfile

import numpy as np

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
WALLS = {  # corner, edge u, edge v, reflectance; the front is u x v
    "floor": ((-1, 0, 1), (2, 0, 0), (0, 0, -2), (0.73, 0.73, 0.73)),
    "ceiling": ((-1, 2, -1), (2, 0, 0), (0, 0, 2), (0.73, 0.73, 0.73)),
    "back": ((-1, 0, -1), (2, 0, 0), (0, 2, 0), (0.73, 0.73, 0.73)),
    "left": ((-1, 0, 1), (0, 0, -2), (0, 2, 0), (0.63, 0.06, 0.05)),
    "right": ((1, 0, -1), (0, 0, 2), (0, 2, 0), (0.14, 0.42, 0.09)),
}
LAMP = ((-0.32, 1.995, -0.32), (0.64, 0, 0), (0, 0, 0.64), (17.0, 13.4, 8.6))
FOG = ((-0.98, 0.02, -0.98), (0.98, 1.98, 0.98))
SIGMA_T, ALBEDO = 0.6, 0.9
EYE, AIM, FOV = (0.0, 1.0, 4.35), (0.0, 0.98, 0.0), 38.0


def toml(size, fog, seed):
    colour = lambda c: "[" + ", ".join(str(float(x)) for x in c) + "]"
    quad = lambda w: f"corner = {colour(w[0])}, edge_u = {colour(w[1])}, edge_v = {colour(w[2])}"
    out = [f"[camera]\nposition = {colour(EYE)}\nlook_at = {colour(AIM)}\nvertical_fov = {FOV}",
           f"resolution = [{size}, {size}]\n[render]\nseed = {seed}\nneighbours = 200",
           f"[[light]]\nquad = {{ {quad(LAMP)}, radiance = {colour(LAMP[3])} }}"]
    for name, wall in WALLS.items():
        out.append(f'[[object]]\nname = "{name}"\nshape = {{ quad = {{ {quad(wall)} }} }}\n'
                   f"material = {{ diffuse = {{ reflectance = {colour(wall[3])} }} }}")
    if fog:
        out.append(f"[[fog]]\nbox = {{ min = {colour(FOG[0])}, max = {colour(FOG[1])} }}\n"
                   f"extinction = {SIGMA_T}\nalbedo = {ALBEDO}")
    return "\n".join(out) + "\n"


def mitsuba_picture(mi, size, fog, spp, seed):
    def rectangle(wall):
        c, u, v = (np.array(x, dtype=float) for x in wall[:3])
        n = np.cross(u, v)
        m = np.eye(4)
        m[:3, 0], m[:3, 1], m[:3, 2], m[:3, 3] = u / 2, v / 2, n / np.linalg.norm(n), c + u / 2 + v / 2
        return {"type": "rectangle", "to_world": mi.ScalarTransform4f(m)}

    rgb = lambda c: {"type": "rgb", "value": [float(x) for x in c]}
    scene = {
        "type": "scene",
        "integrator": {"type": "volpath" if fog else "path", "max_depth": 129, "rr_depth": 8},
        "sensor": {
            "type": "perspective", "fov": FOV, "fov_axis": "y",
            "to_world": mi.ScalarTransform4f().look_at(origin=list(EYE), target=list(AIM), up=[0, 1, 0]),
            "film": {"type": "hdrfilm", "width": size, "height": size, "rfilter": {"type": "box"}},
            "sampler": {"type": "independent", "sample_count": spp},
        },
        "lamp": rectangle(LAMP) | {"emitter": {"type": "area", "radiance": rgb(LAMP[3])},
                                   "bsdf": {"type": "diffuse", "reflectance": rgb((0, 0, 0))}},
    }
    for name, wall in WALLS.items():
        side = {"type": "diffuse", "reflectance": rgb(wall[3])}
        scene[name] = rectangle(wall) | {"bsdf": {"type": "twosided", "side": side}}
    if fog:
        low, high = (np.array(c) for c in FOG)
        m = np.diag([*(high - low) / 2, 1.0])
        m[:3, 3] = (low + high) / 2
        medium = {"type": "homogeneous", "albedo": ALBEDO, "sigma_t": SIGMA_T}
        scene["fog"] = {"type": "cube", "to_world": mi.ScalarTransform4f(m),
                        "bsdf": {"type": "null"}, "interior": medium}
    return np.array(mi.render(mi.load_dict(scene), seed=seed))[..., :3]


def project(p, size):
    eye, aim = np.array(EYE), np.array(AIM)
    forward = (aim - eye) / np.linalg.norm(aim - eye)
    right = np.cross(forward, [0, 1, 0])
    right /= np.linalg.norm(right)
    d = np.asarray(p, dtype=float) - eye
    k = 0.5 * size / np.tan(np.radians(FOV) / 2) / (d @ forward)
    return np.array([size / 2 + k * (d @ right), size / 2 - k * (d @ np.cross(right, forward))])


def mask(wall, size, shrink):
    c, u, v = (np.array(x, dtype=float) for x in wall[:3])
    a, b = 0.5 - shrink / 2, 0.5 + shrink / 2
    q = [project(c + s * u + t * v, size) for s, t in ((a, a), (b, a), (b, b), (a, b))]
    y, x = np.mgrid[0:size, 0:size] + 0.5
    side = [(q[(i + 1) % 4][0] - q[i][0]) * (y - q[i][1]) - (q[(i + 1) % 4][1] - q[i][1]) * (x - q[i][0])
            for i in range(4)]
    return np.all(np.array(side) > 0, axis=0) | np.all(np.array(side) < 0, axis=0)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", default=os.path.join(ROOT, "target/release/vpm-vdb"))
    parser.add_argument("--size", type=int, default=96)
    parser.add_argument("--spp", type=int, default=128, help="of each of four pictures")
    parser.add_argument("--photons", type=int, default=500_000, help="of each pass")
    parser.add_argument("--passes", type=int, default=4)
    args = parser.parse_args()
    import mitsuba as mi
    mi.set_variant("scalar_rgb")
    size, seeds, failed = args.size, range(4), False
    regions = {name: mask(wall, size, 0.8) for name, wall in WALLS.items()}
    regions["ceiling"] &= ~mask(LAMP, size, 1.3)
    means = lambda pictures: {n: np.array([p[m].mean() for p in pictures]) for n, m in regions.items()}
    with tempfile.TemporaryDirectory() as folder:
        for fog in (False, True):
            theirs = means([mitsuba_picture(mi, size, fog, args.spp, s) for s in seeds])
            for method in ("path", "beam"):
                pictures = []
                for seed in seeds:
                    scene, out = os.path.join(folder, "box.toml"), os.path.join(folder, "box.exr")
                    with open(scene, "w") as file:
                        file.write(toml(size, fog, seed))
                    more = ["--spp", str(args.spp)] if method == "path" else [
                        "--photons", str(args.photons), "--passes", str(args.passes), "--spp", "8"]
                    subprocess.run([args.bin, "render", scene, "-o", out, "--method", method, "--quiet", *more], check=True)
                    picture = np.array(mi.Bitmap(out).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False))
                    pictures.append(picture[..., :3])
                for name, ours in means(pictures).items():
                    a, b = ours, theirs[name]
                    ratio = a.mean() / b.mean()
                    error = ratio * np.hypot(a.std(ddof=1) / a.mean(), b.std(ddof=1) / b.mean()) / 2.0
                    bad = abs(ratio - 1.0) > 0.01 + 3.0 * error
                    failed |= bad
                    print(f"{'fog' if fog else 'clear':5} {method:4} {name:8} {ratio:.4f} +- {error:.4f}"
                          f"{'  FAILED' if bad else ''}", flush=True)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
