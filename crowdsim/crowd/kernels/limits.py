"""Compiled measures of what the machine can do at best."""

from crowdsim.jit import kernel


@kernel
def walk(following, place, steps):
    """Return the index after ``steps`` steps from ``place``, each to the entry of ``following`` there."""
    for _ in range(steps):
        place = following[place]
    return place
