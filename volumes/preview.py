"""A quick look at a .vdb: orthographic picture with sun, shadow and glow.

    python3 preview.py FILE.vdb OUT.png [--extinction 30] [--axis z|x] [--fire KELVIN]

Marches every pixel front to back along x or z:
    L = Σ T_i (1 - e^{-σ d_i Δ}) S_i,     T_{i+1} = T_i e^{-σ d_i Δ}
with d the density, σ the extinction per unit density [1/m] and Δ the voxel [m].
S is sunlight through the shadow of the volume plus sky.  Multiple scattering is
imitated by octaves with the extinction scaled by 1/4, 1/16 (Wrenninge, Kulla &
Lundqvist 2013).  With --fire, `temperature` times KELVIN glows as a black body,
roughly.  A check for the eye; it takes no part in making the volumes.
"""

import argparse
import struct
import zlib

import numpy as np
import pyopenvdb as vdb

SKY = np.array([0.25, 0.33, 0.48])
SUN = np.array([1.0, 0.93, 0.82])
OCTAVES = ((1.0, 1.0), (0.45, 0.25), (0.25, 0.0625))


def dense(path, name, low=None, high=None):
    """Grid `name` as an array over index box low..high (default: its own), and the voxel size."""
    g = vdb.read(path, name)
    if low is None:
        low, high = g.evalActiveVoxelBoundingBox()
    out = np.zeros([b - a + 1 for a, b in zip(low, high)], np.float32)
    g.copyToArray(out, ijk=low)
    return out, g.transform.voxelSize()[0], low, high


def shadow(density, dz, dx):
    """Column of density towards a sun above: sheared layer by layer in x and z."""
    column = np.zeros_like(density)
    length = np.sqrt(1.0 + dx * dx + dz * dz)
    for j in range(density.shape[1] - 2, -1, -1):
        above = column[:, j + 1] + length * density[:, j + 1]
        column[:, j] = _shift(above, dx, dz)
    return column


def _shift(layer, dx, dz):
    """Bilinear shift of a 2-D layer, 0 from outside; |dx|, |dz| <= 1."""
    padded = np.pad(layer, 1)
    for axis, d in enumerate((dx, dz)):
        padded = (1 - abs(d)) * padded + abs(d) * np.roll(padded, -int(np.sign(d)), axis)
    return padded[1:-1, 1:-1]


def black_body(kelvin):
    """Relative radiance at 610, 550, 465 nm against 1500 K at 610 nm (Wien)."""
    wavelength = np.array([610e-9, 550e-9, 465e-9])
    t = np.maximum(kelvin, 200.0)[..., None]
    return (610e-9 / wavelength) ** 5 * np.exp(1.4388e-2 * (1 / (610e-9 * 1500.0)
                                                           - 1 / (wavelength * t)))


def picture(density, extinction, voxel, glow):
    """Radiance image (rows from the top, columns, rgb), looking along the last axis."""
    column = shadow(density, dz=0.35, dx=-0.7) * extinction * voxel
    optical = density * extinction * voxel
    image = np.tile(0.5 * SKY, (*density.shape[:2], 1))
    for k in range(density.shape[2]):
        lit = sum(a * np.exp(-b * column[:, :, k]) for a, b in OCTAVES)
        height = np.linspace(0.35, 0.8, density.shape[1])[None, :, None]
        source = 0.8 * lit[..., None] * SUN + height * SKY
        if glow is not None:
            source = 0.15 * source + black_body(glow[:, :, k])
        alpha = 1.0 - np.exp(-optical[:, :, k, None])
        image = image * (1.0 - alpha) + source * alpha
    return image.transpose(1, 0, 2)[::-1]


def write_png(path, image):
    """8-bit PNG of a linear image, through an exponential shoulder and gamma 2.2."""
    bytes_ = (255 * (1 - np.exp(-1.3 * image)) ** (1 / 2.2) + 0.5).astype(np.uint8)
    rows = b"".join(b"\0" + row.tobytes() for row in bytes_)

    def chunk(kind, body):
        return (struct.pack(">I", len(body)) + kind + body
                + struct.pack(">I", zlib.crc32(kind + body)))

    header = struct.pack(">IIBBBBB", image.shape[1], image.shape[0], 8, 2, 0, 0, 0)
    with open(path, "wb") as out:
        out.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header)
                  + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("file")
    parser.add_argument("png")
    parser.add_argument("--extinction", type=float, default=30.0, help="1/m at density 1")
    parser.add_argument("--axis", choices="xz", default="z", help="axis to look along")
    parser.add_argument("--fire", type=float, help="kelvin where temperature is 1")
    args = parser.parse_args()
    density, voxel, low, high = dense(args.file, "density")
    glow = None
    if args.fire:
        glow = dense(args.file, "temperature", low, high)[0] * args.fire
    # The view is along the last axis, from its upper end.
    order = (0, 1, 2) if args.axis == "z" else (2, 1, 0)
    density = density.transpose(order)
    glow = None if glow is None else glow.transpose(order)
    write_png(args.png, picture(density, args.extinction, voxel, glow))


if __name__ == "__main__":
    main()
