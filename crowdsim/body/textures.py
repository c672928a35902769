"""Textures of cloth, hair, leather and skin, made by code, and where they lie on a body.

Textures are tiles of ``TILE`` metres that repeat. Around a segment they are mirrored at its front and its back, so that
no seam needs vertices twice; between segments triangles stretch them. In glTF files they multiply the colours of parts.
"""

from __future__ import annotations

import io
from functools import cache

import numpy as np
from PIL import Image

from crowdsim.body.binding import SIDES, Binding
from crowdsim.core.types import Array

TILE, PIXELS = 0.08, 64
"""Width of a tile [m], and of its picture [px]."""
TEXTURES = {
    "skin": "skin", "hair": "hair", "top": "cloth", "shorts": "cloth", "band": "cloth", "stripes": "cloth",
    "hems": "cloth", "crossings": "cloth", "cuffs": "cloth", "gloves": "leather", "shoes": "leather",
}  # fmt: skip
"""Texture of each part that has one."""
_RADII = {"trunk": 0.15, "head": 0.10}
_LIMB_RADII = {"upper_arm": 0.05, "forearm": 0.045, "hand": 0.06, "thigh": 0.08, "shank": 0.06, "foot": 0.05}
"""Approximate radii of segments [m]."""


def texture_places(binding: Binding, vertices: Array) -> Array:
    """Return where vertices lie on textures: around the nearest segment and along it, in tiles. Shape (V, 2), float32.

    Args:
        binding: The binding pose.
        vertices: Of the skin in it [m]. Shape (V, 3).
    """
    radii = _RADII | {f"{side}_{name}": radius for side in SIDES for name, radius in _LIMB_RADII.items()}
    nearest, places = np.full(len(vertices), np.inf), np.zeros((len(vertices), 2))
    for name, radius in radii.items():
        segment = binding.segments[name]
        along, front, out = ((vertices - segment.start) @ segment.axes.T).T
        beyond = along - np.clip(along, 0.0, segment.length)
        gaps = np.sqrt(beyond**2 + front**2 + out**2) - radius * binding.size
        near = gaps < nearest
        around = radius * (np.abs(np.arctan2(out, front)) - 0.5 * np.pi)
        places[near] = np.stack([around, along / binding.size], axis=1)[near] / TILE
        nearest[near] = gaps[near]
    return places.astype(np.float32)


@cache
def texture_light(name: str) -> Array:
    """Return how much light of each colour a texture lets through, 1 in the mean. Shape (PIXELS, PIXELS, 3)."""
    random = np.random.default_rng([ord(letter) for letter in name])
    noise = random.random((PIXELS, PIXELS))
    rows, columns = np.indices((PIXELS, PIXELS))
    if name == "cloth":
        # Threads over and under one another, four pixels wide.
        over = (rows // 4 + columns // 4) % 2 == 0
        bulge = np.sin(np.pi * (np.where(over, columns, rows) % 4 + 0.5) / 4.0)
        light = 0.80 + 0.20 * bulge + 0.05 * noise
    elif name == "hair":
        light = 0.55 + 1.1 * _smooth(noise, (12, 1))
    elif name == "leather":
        # Creases lie where two of some points are nearest.
        points = PIXELS * random.random((90, 2))
        apart = np.abs(np.stack([rows, columns], axis=-1)[..., None, :] - points)
        gaps = np.sort(np.linalg.norm(np.minimum(apart, PIXELS - apart), axis=-1), axis=-1)
        light = 0.84 + 0.16 * np.clip((gaps[..., 1] - gaps[..., 0]) / 2.0, 0.0, 1.0)
    else:
        spots = _smooth(noise, (5, 5)) + 0.5 * _smooth(random.random((PIXELS, PIXELS)), (2, 2))
        light = 1.0 + 0.5 * (spots - spots.mean())
    # Where skin is darker it is redder.
    red = np.array([0.7, 1.0, 1.1]) if name == "skin" else np.ones(3)
    colours = (light / light.mean())[..., None] ** red
    return np.asarray(colours / colours.mean(axis=(0, 1)))


def _smooth(values: Array, widths: tuple[int, int]) -> Array:
    """Return values of a tile that repeats, each the mean of those around it along both axes."""
    for axis, width in enumerate(widths):
        values = np.mean([np.roll(values, shift, axis) for shift in range(-width, width + 1)], axis=0)
    return values


def texture_png(name: str) -> tuple[bytes, Array]:
    """Return a texture as PNG, and the linear colour that takes it to white in the mean. Shape (3,)."""
    light = texture_light(name)
    most = light.max(axis=(0, 1))
    linear = light / most
    # The curve of sRGB.
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    pixels, file = np.round(255.0 * encoded).astype(np.uint8), io.BytesIO()
    grey = (pixels == pixels[..., :1]).all()
    Image.fromarray(pixels[..., 0] if grey else pixels).save(file, "png", optimize=True)
    return file.getvalue(), most
