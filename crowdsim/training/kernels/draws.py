"""Random numbers of training: functions of whole numbers alone (splitmix64's finaliser)."""

import numpy as np

from crowdsim.core.random import mix
from crowdsim.jit import kernel


@kernel
def draw_number(seed, index, offset):
    """Return a number in [0, 1) that depends on three whole numbers alone."""
    bits = np.uint64(seed) * np.uint64(0x9E3779B97F4A7C15)
    bits += np.uint64(index) * np.uint64(0x8CB92BA72F3D8DD7) + np.uint64(offset)
    return float(mix(mix(bits)) >> np.uint64(11)) / 9007199254740992.0
