#!/usr/bin/env python3
"""The Cornell box, empty and full of fog, against Mitsuba 3: python3 peer_cornell.py [OPTIONS]

    python3 -m venv /tmp/mi && /tmp/mi/bin/pip install mitsuba numpy
    cargo build --release && /tmp/mi/bin/python benches/peer_cornell.py

Writes the box for both renderers from one list of walls, renders it with Mitsuba's `path` or
`volpath` and with this renderer's `path` and `beam`, and prints the mean of each wall as a ratio to
Mitsuba's: of its inner part (a tenth of its width left out on each side) and of the rest, its edges;
the lamp is left out. The standard error of a ratio comes from the scatter of four pictures of each.
Exit code 1 if a ratio is off by more than 1 % and 3 standard errors.

The box is closed and the camera in it, so that the fog needs no boundary of its own: behind a cube of
`null`, filled with an extinction of 1e-6/m, Mitsuba 3.9.1 shows a back wall 6 % darker than without it.
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
    "front": ((1, 0, 1), (-2, 0, 0), (0, 2, 0), (0.73, 0.73, 0.73)),
}
LAMP = ((-0.32, 1.995, -0.32), (0.64, 0, 0), (0, 0, 0.64), (17.0, 13.4, 8.6))
FOG = ((-1.1, -0.1, -1.1), (1.1, 2.1, 1.1))
SIGMA_T, ALBEDO = 0.6, 0.9
EYE, AIM, FOV = (0.0, 1.0, 0.95), (0.0, 1.0, -1.0), 90.0


def toml(size, fog, seed):
    colour = lambda c: "[" + ", ".join(str(float(x)) for x in c) + "]"
    quad = lambda w: f"corner = {colour(w[0])}, edge_u = {colour(w[1])}, edge_v = {colour(w[2])}"
    out = [f"[camera]\nposition = {colour(EYE)}\nlook_at = {colour(AIM)}\nvertical_fov = {FOV}",
           f"resolution = [{size}, {size}]\n[render]\nseed = {seed}\nneighbours = 200",
           f'[[object]]\nname = "lamp"\nshape = {{ quad = {{ {quad(LAMP)} }} }}\n'
           f"material = {{ emissive = {{ radiance = {colour(LAMP[3])} }} }}"]
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
        medium = {"type": "homogeneous", "albedo": ALBEDO, "sigma_t": SIGMA_T}
        scene = {"type": "scene", "fog": medium | {"id": "fog"}} | scene
        inside = {"type": "ref", "id": "fog"}
        scene["sensor"]["medium"] = inside
        for name in ["lamp", *WALLS]:
            scene[name] |= {"exterior": inside, "interior": inside}
    return np.array(mi.render(mi.load_dict(scene), seed=seed))[..., :3]


def our_picture(mi, path):
    bitmap = mi.Bitmap(path)
    names = [bitmap.struct_()[i].name for i in range(len(bitmap.struct_()))]
    return np.array(bitmap)[..., [names.index(c) for c in "RGB"]].astype(float)


def places(wall, size):
    """Along each pixel's middle: distance to the plane of a wall, and where it lies there in the
    wall's edges, from 0 to 1."""
    eye, aim = np.array(EYE), np.array(AIM)
    forward = (aim - eye) / np.linalg.norm(aim - eye)
    right = np.cross(forward, [0, 1, 0])
    right /= np.linalg.norm(right)
    y, x = (1.0 - (np.mgrid[0:size, 0:size] + 0.5) * 2.0 / size) * np.tan(np.radians(FOV) / 2)
    d = forward - x[..., None] * right + y[..., None] * np.cross(right, forward)
    c, u, v = (np.array(a, dtype=float) for a in wall[:3])
    n = np.cross(u, v)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (c - eye) @ n / (d @ n)
    p = eye + t[..., None] * d - c
    return np.where(t > 0, t, np.inf), p @ u / (u @ u), p @ v / (v @ v)


def regions(size):
    at = {name: places(wall, size) for name, wall in WALLS.items()}
    nearest = np.min([t for t, _, _ in at.values()], axis=0)
    _, s, t = places(LAMP, size)
    lamp = np.maximum(abs(s - 0.5), abs(t - 0.5)) < 0.6
    out = {}
    for name, (distance, s, t) in at.items():
        seen = (distance <= nearest) & ~((name == "ceiling") & lamp)
        edge = np.maximum(abs(s - 0.5), abs(t - 0.5))
        for part, where in (("", edge < 0.4), (" edge", edge >= 0.4)):
            if (seen & where).any():
                out[name + part] = seen & where
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bin", default=os.path.join(ROOT, "target/release/vpm-vdb"))
    parser.add_argument("--size", type=int, default=64)
    parser.add_argument("--spp", type=int, default=128, help="of each of four pictures")
    parser.add_argument("--photons", type=int, default=300_000, help="of each pass")
    parser.add_argument("--passes", type=int, default=4)
    args = parser.parse_args()
    import mitsuba as mi
    mi.set_variant("scalar_rgb")
    size, seeds, failed = args.size, range(4), False
    parts = regions(size)
    means = lambda pictures: {n: np.array([p[m].mean() for p in pictures]) for n, m in parts.items()}
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
                    pictures.append(our_picture(mi, out))
                for name, ours in means(pictures).items():
                    a, b = ours, theirs[name]
                    ratio = a.mean() / b.mean()
                    error = ratio * np.hypot(a.std(ddof=1) / a.mean(), b.std(ddof=1) / b.mean()) / 2.0
                    bad = abs(ratio - 1.0) > 0.01 + 3.0 * error
                    failed |= bad
                    print(f"{'fog' if fog else 'clear':5} {method:4} {name:12} {ratio:.4f} +- {error:.4f}"
                          f"{'  FAILED' if bad else ''}", flush=True)
    sys.exit(1 if failed else 0)


if __name__ == "__main__":
    main()
