"""How far points and straight ways are from the parts of obstacles."""

import math

import numpy as np

from crowdsim.jit import kernel

REACH = 2.0  # how far from a cell of the grid the parts are that it lists [m]
CLEAR = 0.3  # how far from obstacles avatars of size 1 are to be placed [m]
STRETCH = 1.5  # length at most of stretches of ways, each of which is compared with the parts that a cell lists [m]
ANY_HEIGHT = -1.0  # instead of a height, where every part counts
CELLS = 32  # cells of a row for which parts near them are found together
ROUNDING = 1e-3  # more than what rounding changes of distances [m]


@kernel(inline=True)
def stands(part, frame):
    """Return whether a part is there in a control frame: a door is not while it is open."""
    return not part.opens <= frame < part.closes


@kernel(inline=True)
def cell_at(grid, x, z):
    """Return the cell of a grid that a point lies in; -1 outside."""
    column, row = math.floor((x - grid.x) / grid.size), math.floor((z - grid.z) / grid.size)
    if column < 0.0 or row < 0.0 or column >= grid.columns or row >= grid.rows:
        return -1
    return int(row) * int(grid.columns) + int(column)


@kernel(inline=True)
def part_gap(part, x, z):
    """Return how far a point is from a part, negative inside [m], and the unit vector from the part to the point."""
    dx, dz = x - part.x, z - part.z
    along, across = dx * part.ux + dz * part.uz, dz * part.ux - dx * part.uz
    a = along - min(max(along, -part.half_along), part.half_along)
    b = across - min(max(across, -part.half_across), part.half_across)
    far = math.sqrt(a * a + b * b)
    if far > 1e-12:
        gap, a, b = far - part.radius, a / far, b / far
    else:
        over, beside = part.half_along - abs(along), part.half_across - abs(across)
        gap = -min(over, beside) - part.radius
        if over < beside:
            a, b = math.copysign(1.0, along), 0.0
        else:
            a, b = 0.0, math.copysign(1.0, across)
    return gap, a * part.ux - b * part.uz, a * part.uz + b * part.ux


@kernel
def way_gap(part, x, z, to_x, to_z, enough):
    """Return how far a straight way is from a part, not above 0 where it leads through [m].

    Where that is clearly more than is ``enough`` it is less than the exact distance, but not less than enough.
    """
    dx, dz = x - part.x, z - part.z
    a, b = dx * part.ux + dz * part.uz, dz * part.ux - dx * part.uz
    dx, dz = to_x - x, to_z - z
    along, across = dx * part.ux + dz * part.uz, dz * part.ux - dx * part.uz
    half_a, half_b = part.half_along, part.half_across
    beside = max(_beside(a, along, half_a), _beside(b, across, half_b)) - part.radius
    if beside > max(enough, 0.0):
        return beside
    if _enters(a, along, half_a, b, across, half_b):
        return -part.radius
    least = min(_square_to(a, b, half_a, half_b), _square_to(a + along, b + across, half_a, half_b))
    length = max(along * along + across * across, 1e-18)
    for corner in range(4):
        ca = half_a if corner & 1 else -half_a
        cb = half_b if corner & 2 else -half_b
        share = min(max(((ca - a) * along + (cb - b) * across) / length, 0.0), 1.0)
        ea, eb = a + share * along - ca, b + share * across - cb
        least = min(least, ea * ea + eb * eb)
    return math.sqrt(least) - part.radius


@kernel(inline=True)
def _beside(a, along, half):
    """Return how far what reaches from ``a`` by ``along`` is from what reaches half a size to both sides."""
    return max(min(a, a + along), -max(a, a + along)) - half


@kernel(inline=True)
def _enters(a, along, half_a, b, across, half_b):
    """Return whether a way from (a, b) by (along, across) meets a rectangle around the origin."""
    first, last = 0.0, 1.0
    if along != 0.0:
        one, other = (-half_a - a) / along, (half_a - a) / along
        first, last = max(first, min(one, other)), min(last, max(one, other))
    elif abs(a) > half_a:
        return False
    if across != 0.0:
        one, other = (-half_b - b) / across, (half_b - b) / across
        first, last = max(first, min(one, other)), min(last, max(one, other))
    elif abs(b) > half_b:
        return False
    return first <= last


@kernel(inline=True)
def _square_to(a, b, half_a, half_b):
    """Return the squared distance of a point from a rectangle around the origin."""
    a, b = max(abs(a) - half_a, 0.0), max(abs(b) - half_b, 0.0)
    return a * a + b * b


@kernel
def gap_at(places, frame, x, z):
    """Return how far a point is from the nearest obstacle, negative inside; ``REACH`` where none is nearer [m]."""
    least, cell = REACH, cell_at(places.grid, x, z)
    if cell >= 0:
        for k in range(places.offsets[cell], places.offsets[cell + 1]):
            if places.gaps[k] >= least:
                break
            part = places.parts[places.listed[k]]
            if stands(part, frame):
                least = min(least, part_gap(part, x, z)[0])
    return least


@kernel
def gaps_at(places, frame, points, out):
    """Write the distance of each of ``points`` (n, 2) from the nearest obstacle, see ``gap_at``. Shape (n,)."""
    for i in range(points.shape[0]):
        out[i] = gap_at(places, frame, points[i, 0], points[i, 1])


@kernel
def clear_ways(parts, starts, ends, room, out):
    """Write whether ways from ``starts`` to ``ends`` (n, 2) keep some room from all parts. Shape (n,)."""
    for i in range(starts.shape[0]):
        for k in range(parts.shape[0]):
            out[i] &= way_gap(parts[k], starts[i, 0], starts[i, 1], ends[i, 0], ends[i, 1], room) >= room


@kernel
def is_way_free(places, frame, x, z, to_x, to_z, room, height):
    """Return whether a straight way keeps some room from all obstacles; less where it begins or ends nearer to one.

    Parts that are lower than ``height`` do not count [m].
    """
    if places.parts.shape[0] == 0:
        return True
    dx, dz = to_x - x, to_z - z
    length = math.sqrt(dx * dx + dz * dz)
    ux, uz = dx / max(length, 1e-12), dz / max(length, 1e-12)
    done = 0.0
    while True:
        half = 0.5 * min(length - done, STRETCH)
        cell = cell_at(places.grid, x + (done + half) * ux, z + (done + half) * uz)
        spare = (places.clear[cell] if cell >= 0 else REACH) - room
        if spare <= half:
            for k in range(places.offsets[cell], places.offsets[cell + 1]):
                if places.gaps[k] > half + room:
                    break
                part = places.parts[places.listed[k]]
                if part.height < height or not stands(part, frame):
                    continue
                gap = way_gap(part, x, z, to_x, to_z, room)
                if gap <= 0.0:
                    return False
                if gap < room and gap < 0.9 * min(part_gap(part, x, z)[0], part_gap(part, to_x, to_z)[0]):
                    return False
        done += half + max(half, spare)
        if not done < length:
            return True


@kernel(inline=True)
def may_be_near(places, x, z, far):
    """Return whether a part of an obstacle, be it an open door, may be nearer to a point than some distance [m]."""
    cell = cell_at(places.grid, x, z)
    return cell >= 0 and places.clear[cell] < far


@kernel(allocates=True)
def list_parts(parts, grid, reach, offsets, listed, gaps, clear):
    """List the parts within ``reach`` of each cell of a grid, as CSR, with how far they are from it at least.

    ``clear`` gets how far cells are from all parts at least. Where ``listed`` has no room parts are only counted.
    Returns how many entries there are.
    """
    held, half, columns = 0, 0.5 * grid.size, int(grid.columns)
    corner = half * math.sqrt(2.0)
    offsets[0] = 0
    apart, near = np.empty(parts.shape[0]), np.empty(parts.shape[0], np.int64)
    for cell in range(columns * int(grid.rows)):
        column = cell % columns
        x, z = grid.x + column * grid.size + half, grid.z + (cell // columns) * grid.size + half
        if column % CELLS == 0:
            # Of some cells in a row the nearest parts, and those within reach, are among these.
            middle = (min(CELLS, columns - column) - 1) * half
            for k in range(parts.shape[0]):
                apart[k] = part_gap(parts[k], x + middle, z)[0]
            furthest = max(apart.min() + 2.0 * middle, reach + corner + middle) + ROUNDING
            count = 0
            for k in range(parts.shape[0]):
                near[count] = k
                count += apart[k] <= furthest
        least = math.inf
        for k in near[:count]:
            gap = part_gap(parts[k], x, z)[0]
            least = min(least, gap)
            if gap <= reach + corner:
                if held < listed.shape[0]:
                    listed[held], gaps[held] = k, gap - corner
                held += 1
        offsets[cell + 1], clear[cell] = held, least - corner
    return held
