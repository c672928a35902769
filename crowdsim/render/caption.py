"""A small caption in the lower left corner of a picture."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from crowdsim.core.types import Array


@lru_cache(maxsize=8)
def _font(height: int) -> Any:
    from PIL import ImageFont

    return ImageFont.load_default(height)


def text_height(picture_height: int) -> int:
    """Return the height of a caption's letters for a picture [px]."""
    return max(10, round(picture_height / 45))


def draw_caption(picture: Array, text: str, corner: tuple[int, int] | None = None, height: int = 0) -> None:
    """Write a line of light text with a dark rim into a picture, in place.

    Args:
        picture: Shape (height, width, 3), uint8.
        text: The line; what does not fit is cut off.
        corner: Left and top [px]; the lower left corner by default.
        height: Height of the letters [px]; by default what suits the picture.
    """
    from PIL import Image, ImageDraw

    size = height or text_height(picture.shape[0])
    font = _font(size)
    rim = max(1, size // 10)
    left, top, right, bottom = (int(value) for value in font.getbbox(text or " "))
    width, high = right - left + 2 * rim + 2, bottom - top + 2 * rim + 2
    x, y = corner if corner is not None else (size * 2 // 3, picture.shape[0] - high - size // 2)
    width, high = min(width, picture.shape[1] - x), min(high, picture.shape[0] - y)
    if width <= 0 or high <= 0 or x < 0 or y < 0:
        return
    image = Image.new("L", (width, high))
    ImageDraw.Draw(image).text((1 + rim - left, 1 + rim - top), text, fill=255, font=font)
    letters = np.asarray(image)
    dark = letters.copy()
    # The rim is the letters, pushed by a little in every direction.
    for dy, dx in ((0, rim), (0, -rim), (rim, 0), (-rim, 0), (rim, rim), (rim, -rim), (-rim, rim), (-rim, -rim)):
        np.maximum(dark, np.roll(letters, (dy, dx), axis=(0, 1)), out=dark)
    area = picture[y : y + high, x : x + width].astype(np.float32)
    area += dark[..., None] * np.float32(0.62 / 255.0) * (np.float32(34.0) - area)
    area += letters[..., None] * np.float32(1.0 / 255.0) * (np.float32(246.0) - area)
    picture[y : y + high, x : x + width] = (area + 0.5).astype(np.uint8)
