"""Writes the volumes of this folder with the OpenVDB library.

    python3 generate.py smoke|cumulus|fire|haze|all [--out FOLDER] [--coarse]
    python3 generate.py table [--out FOLDER]

Needs Debian's python3-openvdb, python3-numpy, python3-scipy and python3-numba,
and the system's Python.  Each volume is described at the top of its own file:
`smoke`, `cumulus`, `fire`, `drift`.  Seeds are fixed; two runs on one machine agree to the
bit, and on two machines up to the rounding of the libraries, which turbulence
amplifies.  `table` reads the files back and prints what README.md lists.
"""

import argparse
import time
from pathlib import Path

import cumulus
import drift
import fire
import smoke
import vdbout


def halved(cells):
    """The trial grid of --coarse: half the cells along each axis."""
    return tuple(n // 2 for n in cells)


def make_smoke(folder, coarse):
    for frame in smoke.write(folder, halved(smoke.CELLS) if coarse else smoke.CELLS):
        print(f"smoke: frame {frame} of {smoke.FRAMES}", flush=True)


def make_cumulus(folder, coarse):
    cumulus.write(folder / "cumulus.vdb", halved(cumulus.CELLS) if coarse else cumulus.CELLS)


def make_fire(folder, coarse):
    fire.write(folder / "fire.vdb", halved(fire.CELLS) if coarse else fire.CELLS)


def make_haze(folder, coarse):
    drift.write(folder, drift.HAZE, coarse)
    drift.write(folder, drift.GROUND_FOG, coarse)


def table(folder):
    """Markdown table of every grid in the folder's files, read back by the library."""
    print("| file | MB | grid | type | active voxels | active box x y z | voxel [m] | min | max |")
    print("|---|---|---|---|---|---|---|---|---|")
    for path in sorted(folder.glob("*.vdb")):
        size = f"{path.stat().st_size / 1e6:.2f}"
        for name, kind, active, box, voxel, low, high in vdbout.describe(path):
            print(f"| {path.name} | {size} | {name} | {kind} | {active} | {box} | {voxel:g} "
                  f"| {_number(low)} | {_number(high)} |")


def _number(value):
    values = value if isinstance(value, tuple) else (value,)
    return " ".join(f"{v:.3g}" for v in values)


MAKERS = {"smoke": make_smoke, "cumulus": make_cumulus, "fire": make_fire, "haze": make_haze}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("what", choices=[*MAKERS, "all", "table"])
    parser.add_argument("--out", type=Path, default=Path(__file__).parent, help="folder of the files")
    parser.add_argument("--coarse", action="store_true", help="half resolution, to try changes")
    args = parser.parse_args()
    if args.what == "table":
        table(args.out)
        return
    args.out.mkdir(parents=True, exist_ok=True)
    for name in MAKERS if args.what == "all" else [args.what]:
        start = time.perf_counter()
        MAKERS[name](args.out, args.coarse)
        print(f"{name}: {time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
