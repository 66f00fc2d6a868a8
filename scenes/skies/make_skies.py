#!/usr/bin/env python3
"""Writes the skies of the example scenes: python3 make_skies.py

Needs numpy and OpenEXR's Python module. Lat-long, half floats, linear Rec. 709 [W/(m2 sr)]: the
picture's middle is seen along -z, its right half toward +x, its top is +y, as the renderer reads it.

sunset: a clear sky after Rayleigh's colours by eye, not by simulation,
    L(d) = zenith + (horizon - zenith) exp(-h / 0.16) + sum over lobes  a exp(-angle / w),
with h the sine of the height above the horizon and the lobes around the sun; below the horizon a
calm sea shows the sky at the mirrored height by Schlick's Fresnel term, with the sun's road broken
into bands. The sun itself is no part of it: it is a light of the scene.
"""

import os

import numpy as np
import OpenEXR

HERE = os.path.dirname(os.path.abspath(__file__))
WIDTH, HEIGHT = 1024, 512
SUN = np.array([-0.64, 0.075, -0.77])
ZENITH = np.array([0.035, 0.075, 0.19])
HORIZON = np.array([0.95, 0.42, 0.17])
LOBES = ((np.array([2.2, 1.05, 0.38]), 0.10), (np.array([0.75, 0.24, 0.10]), 0.45))
AWAY = np.array([0.20, 0.20, 0.30])  # horizon opposite to the sun


def directions():
    v, u = np.meshgrid((np.arange(HEIGHT) + 0.5) / HEIGHT, (np.arange(WIDTH) + 0.5) / WIDTH, indexing="ij")
    theta, phi = np.pi * v, 2.0 * np.pi * u
    return np.stack([-np.sin(theta) * np.sin(phi), np.cos(theta), np.sin(theta) * np.cos(phi)], -1)


def sky(d):
    sun = SUN / np.linalg.norm(SUN)
    h = np.maximum(d[..., 1:2], 0.0)
    flat = d * [1.0, 0.0, 1.0]
    flat /= np.maximum(np.linalg.norm(flat, axis=-1, keepdims=True), 1e-9)
    toward = 0.5 + 0.5 * (flat @ (sun * [1, 0, 1]) / np.hypot(sun[0], sun[2]))[..., None]
    horizon = AWAY + (HORIZON - AWAY) * toward ** 2
    out = ZENITH + (horizon - ZENITH) * np.exp(-h / 0.16)
    angle = np.arccos(np.clip(d @ sun, -1.0, 1.0))[..., None]
    for colour, width in LOBES:
        out = out + colour * np.exp(-angle / width)
    return out


def sunset():
    d = directions()
    mirrored = d * [1.0, -1.0, 1.0]
    depth = -d[..., 1:2]
    bands = 0.03 * np.sin(70.0 * np.log(np.maximum(depth, 1e-3)))
    mirrored[..., 1:2] = np.maximum(mirrored[..., 1:2] + bands * np.minimum(depth * 8.0, 1.0), 0.0)
    mirrored /= np.linalg.norm(mirrored, axis=-1, keepdims=True)
    fresnel = 0.02 + 0.98 * (1.0 - np.clip(depth, 0.0, 1.0)) ** 5
    sea = np.array([0.006, 0.012, 0.020]) + 0.75 * fresnel * sky(mirrored)
    return np.where(d[..., 1:2] >= 0.0, sky(d), sea)


if __name__ == "__main__":
    # Seven bits of mantissa: steps that cannot be seen, and a smaller file.
    picture = sunset().astype(np.float32)
    exponent = np.exp2(np.floor(np.log2(picture)) - 7.0)
    picture = (np.round(picture / exponent) * exponent).astype(np.float16)
    header = {"compression": OpenEXR.PIZ_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, {"RGB": np.ascontiguousarray(picture)}).write(os.path.join(HERE, "sunset.exr"))
