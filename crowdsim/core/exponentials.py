"""Exponentials of numbers up to 0, which vectorise, as library functions do not."""

from crowdsim.jit import kernel


@kernel(inline=True)
def exponential(value):
    """Return the exponential of a number up to 0, with a relative error of 1e-9; below -32 that of -32.

    exp(v) = exp(v / 1024) ^ 1024: the polynomial that is best for so small a number, and ten squarings.
    """
    y = max(value, -32.0) * (1.0 / 1024.0)
    v = 0.9999999999995212 + y * (
        0.9999999992338505 + y * (0.49999980375826153 + y * (0.16664906210443037 + y * 0.04102110216102971))
    )
    v *= v
    v *= v
    v *= v
    v *= v
    v *= v
    v *= v
    v *= v
    v *= v
    v *= v
    return v * v
