"""Compiled conversion of pictures into what video encoders take."""

import numpy as np

from crowdsim.jit import kernel


@kernel
def to_yuv420(picture, out):
    """Write a picture (height, width, 3) as planes Y, U, V of H.264: BT.709, limited range, both sizes even."""
    height, width = picture.shape[0], picture.shape[1]
    luma, quarter = height * width, height * width // 4
    for y in range(height):
        row = y * width
        for x in range(width):
            r, g, b = np.int32(picture[y, x, 0]), np.int32(picture[y, x, 1]), np.int32(picture[y, x, 2])
            out[row + x] = np.uint8((11966 * r + 40254 * g + 4064 * b + 32768 * 33) >> 16)
    for y in range(height // 2):
        for x in range(width // 2):
            r, g, b = np.int32(0), np.int32(0), np.int32(0)
            for k in range(4):
                r += np.int32(picture[2 * y + (k >> 1), 2 * x + (k & 1), 0])
                g += np.int32(picture[2 * y + (k >> 1), 2 * x + (k & 1), 1])
                b += np.int32(picture[2 * y + (k >> 1), 2 * x + (k & 1), 2])
            place = y * (width // 2) + x
            out[luma + place] = np.uint8((-6596 * r - 22189 * g + 28785 * b + 131072 * 257) >> 18)
            out[luma + quarter + place] = np.uint8((28785 * r - 26146 * g - 2640 * b + 131072 * 257) >> 18)
