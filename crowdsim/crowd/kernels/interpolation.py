"""Rows of playback frames at a fractional frame."""

from crowdsim.jit import kernel


@kernel(inline=True)
def between(rows, frame, column):
    """Return a column of ``rows`` at a fractional row."""
    below = int(frame)
    share = frame - below
    value = float(rows[below, column])
    if share > 0.0:
        value += share * (rows[below + 1, column] - value)
    return value


@kernel(inline=True)
def ground_at(ground, frame):
    """Return the ground transform at a fractional row."""
    below = int(frame)
    share = frame - below
    x, z, heading = ground[below, 0], ground[below, 1], ground[below, 2]
    if share > 0.0:
        x += share * (ground[below + 1, 0] - x)
        z += share * (ground[below + 1, 1] - z)
        heading += share * (ground[below + 1, 2] - heading)
    return x, z, heading


@kernel(inline=True)
def point_at(rows, frame, column, x, z, size, cos, sin):
    """Return the position of a point of a body at (x, z): three columns of ``rows`` at a fractional row."""
    px, pz = between(rows, frame, column), between(rows, frame, column + 2)
    return x + px * cos + pz * sin, between(rows, frame, column + 1) * size, z - px * sin + pz * cos
