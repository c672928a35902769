"""Compiled easing curves."""

from crowdsim.jit import kernel


@kernel(inline=True)
def minimum_jerk(s):
    """Return the step from 0 at ``s`` = 0 to 1 at ``s`` = 1 without speed and acceleration at its ends.

    It is the path of least jerk between two points at rest, 10 s^3 - 15 s^4 + 6 s^5 (Flash and Hogan 1985).
    """
    if s <= 0.0:
        return 0.0
    if s >= 1.0:
        return 1.0
    return s * s * s * (10.0 - s * (15.0 - 6.0 * s))
