"""Compiled measures of what the machine can do at best."""

from crowdsim.jit import kernel


@kernel
def walk(following, place, steps):
    """Return where so many steps lead from a place, each to what ``following`` says of the place before."""
    for _ in range(steps):
        place = following[place]
    return place
