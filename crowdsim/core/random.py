"""Draws in compiled code, equal to the bit to those of ``crowd/random.py``: hashes of stream, avatar and draw."""

import numpy as np

from crowdsim.jit import kernel


@kernel(inline=True)
def mix(bits):
    """Scramble 64 bits (SplitMix64's finaliser)."""
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return bits ^ (bits >> np.uint64(31))


@kernel(inline=True)
def uniform(stream, avatar, draw):
    """Return a number in [0, 1); ``stream`` is uint64, from ``random.stream``, the others are integers of any type."""
    golden = np.uint64(0x9E3779B97F4A7C15)
    bits = mix(stream + (np.uint64(avatar) + np.uint64(1)) * golden)
    bits = mix(bits + (np.uint64(draw) + np.uint64(1)) * golden)
    return np.float64(bits >> np.uint64(11)) * 2.0**-53
