"""Compiled control: everything that avatars do in a frame, except for the index of large crowds.

``model``, ``avatars``, ``world``, ``record`` and ``strikes`` are the named tuples of ``arrays.py``. Each kernel handles
avatars (or decisions) ``first`` to ``last`` and writes nothing that another range reads in the same stage. Look-ups and
rewards mean what ``policy.action_values`` says, draws what ``random.uniform`` says; tests hold them equal.
"""

import math

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from crowdsim.jit import kernel

# Kernels that allocate nothing do without numba's counting of references, which would cost more than their work: two
# atomic operations for every array that is handed to a function, or looked up in a named tuple.
_kernel = kernel(allocates=False)

# Parts of kernels: handing over arrays, of which a model has fifteen and scratch space as many, would take longer than
# what they do for a small crowd. Stages of a frame are parts too: all of them are one function in ``run_frames``.
_part = kernel(inline=True)

# Rows of ``Avatars.whole`` and ``Avatars.real``, a column for each slot.
(
    NUMBER, POLICY, MOOD, TEAM, SKIP, FIXED, OPPONENT, OPPONENT_BEFORE, DECISIONS, ACTION, ACTION_BEFORE, PENDING,
    BURST,
) = range(13)  # fmt: skip
(
    SCALE, SPEED, PHASE, PHASE_BEFORE, BASE_X, BASE_Z, BASE_COS, BASE_SIN, BASE_TURN, X, Z, HEADING, END_X, END_Z,
    RESTED,
) = range(15)  # fmt: skip

# Columns of the tables of ``Model`` and of ``World.moods``.
NEXT, LENGTH, ORIGIN, PATHS, STRIKES, FIRST_STRIKE = range(6)
MOVE_X, MOVE_Z, MOVE_COS, MOVE_SIN, COST, CUT = range(6)
TIME, FIST_X, FIST_Y, FIST_Z, FIST_SPEED, HAND, OWNER, WORTH = range(8)
HEAD, NECK, PELVIS = 0, 3, 6
HEAD_RADIUS, TORSO_RADIUS, NECK_DROP, PELVIS_DROP, TOLERANCE, REACH, PACE, FARTHEST, SOON, LATER = range(10)
STRIDE, BEHAVIOURS, ACTIONS, STATES = range(4)
MARGIN, MOST, TEMPERATURE, HYSTERESIS, INTERVAL = range(5)
LOOKS_AHEAD, CELLS, TABLE, NORM, DISCOUNT, LOW, STEP, PRICE, EACH = range(4, 13)
FIRST, PER_UNIT, POINTS, WRAPS, APART, FADE, LEAST, GREATEST, RATE = range(9)
TARGET_X, TARGET_Y, TARGET_Z, MOVING_X, MOVING_Z, LASTS = range(6)

AHEAD = 4  # so many avatars before one is worked on, memory is asked for what that reads
LANES = 8  # entries that are worked on at once
BLOCK = 16  # situations that are weighed at a time

ENTERED = -2  # instead of an action before, of those who have just entered
NO_STRIKE = 1 << 30  # instead of a frame, where an action has no strike left
BURSTS = (2, 5)  # least and most strikes of a burst
BEHIND = 0.8  # how much further away an opponent counts that is behind [m]
REST = 4.0  # what a strike costs an avatar that rests, in normalised values
SORTED = 256  # so many avatars that choose together do so in the order of their states

_clock_type = types.int32(types.int32, types.CPointer(types.int64))
_clock_gettime = types.ExternalFunction("clock_gettime", _clock_type)


@intrinsic
def _request(typing, array, index):
    """Ask memory for an entry of an array."""

    def generate(context, builder, signature, values):
        pointer = builder.gep(make_array(signature.args[0])(context, builder, values[0]).data, [values[1]])
        byte, number = cgutils.voidptr_t, cgutils.int32_t
        kind = cgutils.ir.FunctionType(cgutils.ir.VoidType(), [byte, number, number, number])
        function = builder.module.declare_intrinsic("llvm.prefetch", [byte], kind)
        builder.call(function, [builder.bitcast(pointer, byte), number(0), number(3), number(1)])
        return context.get_dummy_value()

    return types.void(array, types.int64), generate


@_part
def _ask_for(array, index):
    """Ask memory for an entry, counted from the first one, of an array that will be read soon; any place will do."""
    _request(array, index)  # type: ignore[call-arg]


@_kernel
def _now(buffer):
    """Return a steady time [ns]; ``buffer`` has room for two numbers."""
    _clock_gettime(1, buffer.ctypes)  # type: ignore[call-overload]
    return buffer[0] * 1_000_000_000 + buffer[1]


@_part
def cos_sin(angle):
    """Return cosine and sine of an angle, as exact as a library does, but in the caller's own code, at half the cost.

    What is left of a quarter turn goes into polynomials (those of fdlibm); a quarter turn has two parts, so that whole
    ones leave no error behind.
    """
    if not abs(angle) < 1e5:
        return math.cos(angle), math.sin(angle)
    quarters = math.floor(angle * (2.0 / math.pi) + 0.5)
    v = (angle - quarters * 1.5707963267341256) - quarters * 6.077100506506192e-11
    u = v * v
    sin = 2.75573137070700676789e-06 + u * (-2.50507602534068634195e-08 + u * 1.58969099521155010221e-10)
    sin = -1.66666666666666324348e-01 + u * (8.33333333332248946124e-03 + u * (-1.98412698298579493134e-04 + u * sin))
    sin = v + v * u * sin
    cos = -2.75573143513906633035e-07 + u * (2.08757232129817482790e-09 - u * 1.13596475577881948265e-11)
    cos = 4.16666666666666019037e-02 + u * (-1.38888888888741095749e-03 + u * (2.48015872894767294178e-05 + u * cos))
    cos = 1.0 - (0.5 * u - u * u * cos)
    q = int(quarters)
    odd = q & 1 != 0
    cos, sin = (sin if odd else cos), (cos if odd else sin)
    return -cos if (q + 1) & 2 != 0 else cos, -sin if q & 2 != 0 else sin


@_part
def _mix(bits):
    """Scramble 64 bits."""
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return bits ^ (bits >> np.uint64(31))


@_part
def draw(stream, avatar, decision):
    """Return a number in [0, 1) that depends on nothing else."""
    golden = np.uint64(0x9E3779B97F4A7C15)
    bits = _mix(stream + (np.uint64(avatar) + np.uint64(1)) * golden)
    bits = _mix(bits + (np.uint64(decision) + np.uint64(1)) * golden)
    return np.float64(bits >> np.uint64(11)) * 2.0**-53


@_part
def _between(rows, place, column):
    """Return a column of ``rows`` at a fractional row."""
    below = int(place)
    share = place - below
    value = np.float64(rows[below, column])
    if share > 0.0:
        value += share * (rows[below + 1, column] - value)
    return value


@_part
def _ground_at(ground, place):
    """Return the ground transform at a fractional row."""
    below = int(place)
    share = place - below
    x, z, heading = ground[below, 0], ground[below, 1], ground[below, 2]
    if share > 0.0:
        x += share * (ground[below + 1, 0] - x)
        z += share * (ground[below + 1, 1] - z)
        heading += share * (ground[below + 1, 2] - heading)
    return x, z, heading


@_part
def _point_at(rows, place, column, x, z, size, cos, sin):
    """Return where a point of a body is that stands at (x, z): three columns of ``rows`` at a fractional row."""
    px, pz = _between(rows, place, column), _between(rows, place, column + 2)
    return x + px * cos + pz * sin, _between(rows, place, column + 1) * size, z - px * sin + pz * cos


@_part
def _fade(grids, b, distance, bearing, height):
    """Return how much a behaviour counts for a target: 1 inside its grid, falling to 0 beyond it."""
    fade = 1.0
    for axis in range(3):
        if grids[b, axis, FADE] > 0.0:
            value = distance if axis == 0 else (bearing if axis == 1 else height)
            beyond = max(grids[b, axis, LEAST] - value, value - grids[b, axis, GREATEST], 0.0)
            fade *= max(0.0, 1.0 - beyond / grids[b, axis, FADE])
    return fade


@_part
def exponential(value):
    """Return the exponential of a number up to 0, to 1e-9 of it; what lies below -32 counts as -32.

    exp(v) = exp(v / 1024) ^ 1024: the polynomial that is best for so small a number, and ten squarings, which
    vectorise, as library functions do not.
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


@_kernel
def bearings(xs, zs, count, out):
    """Write atan2(x, z) of each place, to 2e-9: a polynomial of the smaller over the greater, which vectorises."""
    for k in range(count):
        x, z = xs[k], zs[k]
        ax, az = abs(x), abs(z)
        greater = max(ax, az)
        t = min(ax, az) / (greater if greater > 0.0 else 1.0)
        u = t * t
        angle = 0.057463975847337374 + u * (
            -0.03071783261194565 + u * (0.010680852068445015 - u * 0.0017437229102955482)
        )
        angle = -0.14261577273925508 + u * (0.10940212904732985 + u * (-0.08372095274306866 + u * angle))
        angle = t * (0.999999997551612 + u * (-0.33333282326387254 + u * (0.19998231136682537 + u * angle)))
        angle = 0.5 * math.pi - angle if ax > az else angle
        angle = math.pi - angle if z < 0.0 else angle
        out[k] = -angle if x < 0.0 else angle


@_part
def _corner(grids, b, axis, value):
    """Return the cell below a value on one axis of a grid, how far the next one lies in a table, and its share."""
    place = (value / (1.0 + grids[b, axis, RATE] * value) - grids[b, axis, FIRST]) * grids[b, axis, PER_UNIT]
    points, stride = grids[b, axis, POINTS], grids[b, axis, APART]
    step = stride if points > 1.0 else 0.0
    if grids[b, axis, WRAPS] != 0.0:
        place -= points * math.floor(place / points)
        lower = min(math.floor(place), points - 1.0)
        step = step if lower + 1.0 < points else stride * (1.0 - points)
    else:
        place = min(max(place, 0.0), points - 1.0)
        lower = min(math.floor(place), max(points - 2.0, 0.0))
    return int(lower * stride), int(step), place - lower


@_part
def _place_all(grids, b, cell_count, count, cells, steps, work, near_shares, aside_shares):
    """Find where each end lies on the grid of a behaviour, whose table begins at its state's first cell.

    ``work`` holds distances and bearings; ``cells`` are states and become entries; ``steps`` go to the next bearing.
    """
    near_least, near_per, near_points = grids[b, 0, FIRST], grids[b, 0, PER_UNIT], grids[b, 0, POINTS]
    aside_least, aside_per, aside_points = grids[b, 1, FIRST], grids[b, 1, PER_UNIT], grids[b, 1, POINTS]
    rate = grids[b, 0, RATE]
    near_apart, aside_apart = grids[b, 0, APART], grids[b, 1, APART]
    near_last, aside_last = max(near_points - 2.0, 0.0), max(aside_points - 2.0, 0.0)
    wraps = grids[b, 1, WRAPS] != 0.0
    once = 1.0 / aside_points if wraps else 0.0
    step = aside_apart if aside_points > 1.0 else 0.0
    back = aside_apart - aside_apart * aside_points if wraps else step
    aside_last = aside_points - 1.0 if wraps else aside_last
    most = np.inf if wraps else aside_points - 1.0
    least = -np.inf if wraps else 0.0
    for k in range(count):
        place = (work[2, k] / (1.0 + rate * work[2, k]) - near_least) * near_per
        place = min(max(place, 0.0), near_points - 1.0)
        lower = min(np.floor(place), near_last)
        near_shares[k] = place - lower
        cell = cells[k] * cell_count + lower * near_apart
        place = min(max((work[3, k] - aside_least) * aside_per, least), most)
        place -= aside_points * np.floor(place * once)
        lower = max(min(np.floor(place), aside_last), 0.0)
        aside_shares[k] = place - lower
        cells[k] = cell + lower * aside_apart
        steps[k] = step if lower + 1.0 < aside_points else back


@_part
def _see_ends(moves, actions, offset, n, x, z, vx, vz, lasts, lead, first, work):
    """Write where a target is seen from the end of ``n`` actions: x, z and distance; and their ends.

    It is at (x, z) now and moves by (vx, vz) a frame for so many frames. It is seen ``lead`` frames later than the end:
    values are those of a still target, and who goes after a moving one must be ahead of them.
    """
    for k in range(n):
        action, at = np.uint64(offset + k), np.uint64(first + k)
        t = min(np.float64(actions[action, LENGTH]) + lead, lasts)
        dx, dz = x + t * vx - moves[action, MOVE_X], z + t * vz - moves[action, MOVE_Z]
        cos, sin = moves[action, MOVE_COS], moves[action, MOVE_SIN]
        later_x, later_z = dx * cos - dz * sin, dx * sin + dz * cos
        work[0, at], work[1, at] = later_x, later_z
        work[2, at] = math.sqrt(later_x * later_x + later_z * later_z)
        work[4, at] = actions[action, NEXT]


@_part
def _gaps(paths, first, count, x, z, vx, vz, lasts, least, most, facing, wide, out):
    """Write how far from where it should be a target is along ``count`` rows of paths from ``first`` on.

    It is at (x, z) now and moves by (vx, vz) a frame for so many frames.
    """
    if facing:
        for k in range(count):
            row = np.uint64(first + k)
            t = min(np.float64(paths[4, row]), lasts)
            dx, dz = x + t * vx - paths[0, row], z + t * vz - paths[1, row]
            cos, sin = paths[2, row], paths[3, row]
            aside, ahead = max(abs(dx * cos - dz * sin) - wide, 0.0), dx * sin + dz * cos
            ahead -= min(max(ahead, least), most)
            out[k] = math.sqrt(ahead * ahead + aside * aside)
    else:
        for k in range(count):
            row = np.uint64(first + k)
            t = min(np.float64(paths[4, row]), lasts)
            dx, dz = x + t * vx - paths[0, row], z + t * vz - paths[1, row]
            far = math.sqrt(dx * dx + dz * dz)
            out[k] = abs(far - min(max(far, least), most))


@_part
def _add_strikes(actions, strikes, terms, row, offset, n, x, y, z, vx, vz, lasts, factor, rows, out):
    """Add ``factor`` times what landed strikes earn by a term to what each of ``n`` actions is worth."""
    tolerance, head, torso, column = terms[row, 2], terms[row, 4], terms[row, 5], int(terms[row, 8])
    greatest, wasted = terms[row, 11] != 0.0, terms[row, 12] * terms[row, 12]
    low, high = y - terms[row, 7], y - terms[row, 6]
    # Within the tolerance of the surface (``rewards.lands``) where no square is below its least, which would be too
    # deep in head or torso, and one is not above its most; which takes no roots.
    head_least, head_most = max(head - tolerance, 0.0) ** 2, (head + tolerance) ** 2
    torso_least, torso_most = max(torso - tolerance, 0.0) ** 2, (torso + tolerance) ** 2
    for k in range(n):
        rows[k] = 0.0
    # No branch: what lands is anybody's guess.
    for k in range(np.uint64(actions[offset, STRIKES]), np.uint64(actions[offset + n, STRIKES])):
        px, py, pz = strikes[k, FIST_X], strikes[k, FIST_Y], strikes[k, FIST_Z]
        t = min(np.float64(strikes[k, TIME]), lasts)
        dx, dy, dz = px - (x + t * vx), py - y, pz - (z + t * vz)
        aside = dx * dx + dz * dz
        to_head = aside + dy * dy
        dy = py - min(max(py, low), high)
        to_torso = aside + dy * dy
        lands = (
            ((to_head <= head_most) | (to_torso <= torso_most)) & (to_head >= head_least) & (to_torso >= torso_least)
        )
        action = np.uint64(strikes[k, OWNER])
        earned = strikes[k, column] * np.float64(lands)
        rows[action] = max(rows[action], earned) if greatest else rows[action] + earned
        out[action] -= factor * strikes[k, column + 1] * np.float64(aside > wasted)
    factor *= terms[row, 1]
    for k in range(n):
        out[k] += factor * rows[k]


@_part
def _fold(rows, i, weights, t, before, greatest):
    """Return the sum, or the greatest, of eight rows from ``i`` on, weighed from ``t`` on, and of what was before."""
    one = np.uint64(1)
    a = rows[i] * weights[t]
    i, t = i + one, t + one
    c = rows[i] * weights[t]
    i, t = i + one, t + one
    d = rows[i] * weights[t]
    i, t = i + one, t + one
    e = rows[i] * weights[t]
    i, t = i + one, t + one
    f = rows[i] * weights[t]
    i, t = i + one, t + one
    g = rows[i] * weights[t]
    i, t = i + one, t + one
    h = rows[i] * weights[t]
    i, t = i + one, t + one
    j = rows[i] * weights[t]
    if greatest:
        return max(before, max(max(max(a, c), max(d, e)), max(max(f, g), max(h, j))))
    return before + (((a + c) + (d + e)) + ((f + g) + (h + j)))


@_part
def _add_nearness(
    actions, paths, terms, row, last, discounts, b, offset, n, x, z, vx, vz, lasts, factor, gaps, rows, out
):  # fmt: skip
    """Add ``factor`` times proximity terms to what each of ``n`` actions is worth; return the row behind the terms.

    These are the one in ``row`` and those behind it, before ``last``, that differ in weight and width alone: one sum.
    """
    begun, end = actions[offset, PATHS], actions[offset + n, PATHS]
    facing, greatest = terms[row, 5] != 0.0, terms[row, 4] != 0.0
    least, most, wide = terms[row, 2], terms[row, 6], terms[row, 7]
    count = _whole_lanes(end - begun)
    _gaps(paths, begun, count, x, z, vx, vz, lasts, least, most, facing, wide, gaps)
    weight, shrink = terms[row, 1], -1.0 / terms[row, 3]
    for k in range(count):
        rows[k] = weight * exponential(gaps[k] * shrink)
    row += 1
    while (
        not greatest and row < last and terms[row, 0] != 0.0 and terms[row, 4] == 0.0
        and terms[row, 2] == least and terms[row, 6] == most and terms[row, 7] == wide
        and (terms[row, 5] != 0.0) == facing
    ):  # fmt: skip
        weight, shrink = terms[row, 1], -1.0 / terms[row, 3]
        for k in range(count):
            rows[k] += weight * exponential(gaps[k] * shrink)
        row += 1
    at = 0
    for k in range(n):
        # Rows of the next action count for nothing: whole lanes leave no number of rounds to guess.
        length = actions[offset + k, LENGTH]
        near = 0.0
        for t in range(0, length, LANES):
            near = _fold(rows, np.uint64(at + t), discounts[b, length], np.uint64(t), near, greatest)
        out[k] += factor * near
        at += length
    return row


@_part
def _whole_lanes(count):
    """Return a whole number of ``LANES``: loops over so many leave no rest that would be done one by one."""
    return (count + LANES - 1) // LANES * LANES


@_part
def _interpolate(table, cell, near, aside, above, part, turned, raised):
    """Return an entry of a table between eight cells: steps to the next along each axis, and their shares."""
    low = np.uint64(cell)
    high = np.uint64(cell + near)
    left = np.uint64(cell + aside)
    both = np.uint64(cell + near + aside)
    value = (1.0 - part) * ((1.0 - turned) * table[low] + turned * table[left])
    value += part * ((1.0 - turned) * table[high] + turned * table[both])
    if above == 0:
        return value
    up = np.uint64(above)
    upper = (1.0 - part) * ((1.0 - turned) * table[low + up] + turned * table[left + up])
    upper += part * ((1.0 - turned) * table[high + up] + turned * table[both + up])
    return value + raised * (upper - value)


@_part
def _add_rows(table, at, near, aside, above, part, turned, raised, factor, n, out):
    """Add to ``out`` what lies between eight rows of a table, ``n`` entries each from ``at`` on, times ``factor``."""
    c, d, e = factor * (1.0 - part), factor * part, 1.0 - turned
    f, g = 1.0 - raised, raised
    if above == 0:
        f, g = 1.0, 0.0
    w0, w1, w2, w3 = c * e * f, c * turned * f, d * e * f, d * turned * f
    w4, w5, w6, w7 = c * e * g, c * turned * g, d * e * g, d * turned * g
    last = table.shape[0] - LANES
    a0, a1, a2, a3 = at, at + aside, at + near, at + near + aside
    ends = max(max(a0, a1), max(a2, a3)) + above
    for begin in range(0, n, LANES):
        # Whole lanes are read, also beyond the last action, where there is more of the table.
        if ends + begin <= last:
            i0, i1, i2, i3 = np.uint64(a0 + begin), np.uint64(a1 + begin), np.uint64(a2 + begin), np.uint64(a3 + begin)
            up, o = np.uint64(above), np.uint64(begin)
            if above == 0:
                for k in range(np.uint64(LANES)):
                    out[o + k] += w0 * table[i0 + k] + w1 * table[i1 + k] + w2 * table[i2 + k] + w3 * table[i3 + k]
            else:
                i4, i5, i6, i7 = i0 + up, i1 + up, i2 + up, i3 + up
                for k in range(np.uint64(LANES)):
                    out[o + k] += (
                        w0 * table[i0 + k] + w1 * table[i1 + k] + w2 * table[i2 + k] + w3 * table[i3 + k]
                    ) + (w4 * table[i4 + k] + w5 * table[i5 + k] + w6 * table[i6 + k] + w7 * table[i7 + k])
        else:
            for k in range(begin, min(begin + LANES, n)):
                out[k] += (w0 * table[a0 + k] + w1 * table[a1 + k] + w2 * table[a2 + k] + w3 * table[a3 + k]) + (
                    w4 * table[a0 + above + k] + w5 * table[a1 + above + k] + w6 * table[a2 + above + k]
                    + w7 * table[a3 + above + k]
                )  # fmt: skip


@_part
def _prepare(model, weights, scratch, first, count, policy):
    """Look at ``count`` situations from ``order[first]`` on, and ask memory for what weighing them will read.

    Returns how many actions are looked ahead along.
    """
    behaviours = model.behaviours
    begun, end = model.policies[policy, BEHAVIOURS], model.policies[policy + 1, BEHAVIOURS]
    pairs = 0
    scratch.begins[0] = 0
    for d in range(count):
        q = scratch.order[first + d]
        scratch.begins[d + 1] = pairs
        state = scratch.states[q]
        if state < 0:
            continue
        situations = scratch.situations
        x, y, z = situations[q, TARGET_X], situations[q, TARGET_Y], situations[q, TARGET_Z]
        vx, vz, lasts = situations[q, MOVING_X], situations[q, MOVING_Z], situations[q, LASTS]
        offset = model.offsets[state]
        n = model.offsets[state + 1] - offset
        for k in range(_whole_lanes(n)):
            scratch.values[q, k] = 0.0
        distance, bearing, sought = math.sqrt(x * x + z * z), 0.0, False
        if distance > model.sizes[policy, FARTHEST]:
            # At the end of all grids every place further on looks alike, so that nothing would draw the avatar there.
            x, z = x * model.sizes[policy, FARTHEST] / distance, z * model.sizes[policy, FARTHEST] / distance
            distance = model.sizes[policy, FARTHEST]
            situations[q, TARGET_X], situations[q, TARGET_Z] = x, z
        # Tables of Q-values know still targets alone: they are read for where the target is half an action later.
        t = min(model.sizes[policy, SOON], lasts)
        soon_x, soon_z = x + t * vx, z + t * vz
        ahead = False
        for b in range(begun, end):
            spot = d * (end - begun) + b - begun
            factor = weights[scratch.moods[q], b - begun]
            if not sought and model.grids[b, 1, FADE] > 0.0:
                bearing, sought = math.atan2(x, z), True
            if factor != 0.0:
                norm = behaviours[b, NORM]
                factor = factor * _fade(model.grids, b, distance, bearing, y) / norm if norm > 0.0 else 0.0
            scratch.parts[spot, 3] = factor
            if factor == 0.0:
                continue
            cell, scratch.spots[spot, 3], scratch.parts[spot, 2] = _corner(model.grids, b, 2, y)
            if behaviours[b, LOOKS_AHEAD] != 0.0:
                ahead = True
                scratch.spots[spot, 0] = int(behaviours[b, TABLE]) + cell
                continue
            far = math.sqrt(soon_x * soon_x + soon_z * soon_z)
            near, near_step, scratch.parts[spot, 0] = _corner(model.grids, b, 0, far)
            aside, aside_step, scratch.parts[spot, 1] = _corner(model.grids, b, 1, math.atan2(soon_x, soon_z))
            at = int(behaviours[b, TABLE]) + offset * int(behaviours[b, CELLS]) + (cell + near + aside) * n
            near_step, aside_step = near_step * n, aside_step * n
            scratch.spots[spot, 0], scratch.spots[spot, 1], scratch.spots[spot, 2] = at, near_step, aside_step
            scratch.spots[spot, 3] *= n
            _ask_for(model.table, at)
            _ask_for(model.table, at + near_step)
            _ask_for(model.table, at + aside_step)
            _ask_for(model.table, at + near_step + aside_step)
        if ahead:
            first_row, last_row = model.actions[offset, PATHS], model.actions[offset + n, PATHS]
            for row in range(first_row, last_row + 15, 16):
                _ask_for(model.paths, row)
                _ask_for(model.paths, row + model.paths.shape[1])
            first_row, last_row = model.actions[offset, STRIKES], model.actions[offset + n, STRIKES]
            width = model.strikes.shape[1]
            for entry in range(first_row * width, last_row * width + 15, 16):
                _ask_for(model.strikes, entry)
            lead = model.sizes[policy, LATER]
            _see_ends(model.moves, model.actions, offset, n, x, z, vx, vz, lasts, lead, pairs, scratch.work)
            pairs += n
            scratch.begins[d + 1] = pairs
    return pairs


@_part
def _look_ahead(model, b, slot, slots, scratch, first, count, pairs):
    """Find what one behaviour's table is read for at the end of each of so many actions, and ask memory for it."""
    cells, steps = scratch.cells[2 * slot], scratch.cells[2 * slot + 1]
    for k in range(pairs):
        cells[k] = scratch.work[4, k]
    _place_all(
        model.grids, b, model.behaviours[b, CELLS], _whole_lanes(pairs), cells, steps, scratch.work,
        scratch.work[5 + 2 * slot], scratch.work[6 + 2 * slot],
    )  # fmt: skip
    near = int(model.grids[b, 0, APART]) if model.grids[b, 0, POINTS] > 1.0 else 0
    for d in range(count):
        if scratch.parts[d * slots + slot, 3] != 0.0:
            at = scratch.spots[d * slots + slot, 0]
            for k in range(scratch.begins[d], scratch.begins[d + 1]):
                _ask_for(model.table, at + int(cells[k]))
                _ask_for(model.table, at + int(cells[k]) + near)
    return near


@_part
def _weigh(model, weights, scratch, first, count, policy):
    """Do what ``value_actions`` does for ``count`` situations of one policy, which share a block of scratch space."""
    behaviours, table, work = model.behaviours, model.table, scratch.work
    begun, end = model.policies[policy, BEHAVIOURS], model.policies[policy + 1, BEHAVIOURS]
    slots = end - begun
    pairs = _prepare(model, weights, scratch, first, count, policy)
    if pairs > 0:
        bearings(work[0], work[1], _whole_lanes(pairs), work[3])
        for b in range(begun, end):
            if behaviours[b, LOOKS_AHEAD] != 0.0:
                scratch.nears[b - begun] = _look_ahead(model, b, b - begun, slots, scratch, first, count, pairs)
    for d in range(count):
        q = scratch.order[first + d]
        state = scratch.states[q]
        if state < 0:
            continue
        offset = model.offsets[state]
        n = model.offsets[state + 1] - offset
        out = scratch.values[q]
        for b in range(begun, end):
            spot = d * slots + b - begun
            factor = scratch.parts[spot, 3]
            if factor == 0.0:
                continue
            above, raised = scratch.spots[spot, 3], scratch.parts[spot, 2]
            if behaviours[b, LOOKS_AHEAD] == 0.0:
                for k in range(n):
                    out[k] += factor * behaviours[b, LOW]
                _add_rows(
                    table, scratch.spots[spot, 0], scratch.spots[spot, 1], scratch.spots[spot, 2], above,
                    scratch.parts[spot, 0], scratch.parts[spot, 1], raised, factor * behaviours[b, STEP], n, out,
                )  # fmt: skip
                continue
            slot = b - begun
            near, at, begin = scratch.nears[slot], scratch.spots[spot, 0], scratch.begins[d]
            cells, steps = scratch.cells[2 * slot], scratch.cells[2 * slot + 1]
            parts, turns = work[5 + 2 * slot], work[6 + 2 * slot]
            low, step, discounts = behaviours[b, LOW], behaviours[b, STEP], model.discounts[b, 0]
            for k in range(n):
                pair, action = np.uint64(begin + k), np.uint64(offset + k)
                value = _interpolate(
                    table, at + np.int64(cells[pair]), near, np.int64(steps[pair]), above, parts[pair], turns[pair],
                    raised,
                )  # fmt: skip
                value = (low + step * value) * discounts[np.uint64(model.actions[action, LENGTH])]
                out[np.uint64(k)] += factor * (value - model.moves[action, CUT + slot])
            situations = scratch.situations
            x, y, z = situations[q, TARGET_X], situations[q, TARGET_Y], situations[q, TARGET_Z]
            vx, vz, lasts = situations[q, MOVING_X], situations[q, MOVING_Z], situations[q, LASTS]
            row, last = int(behaviours[b, 2]), int(behaviours[b, 3])
            while row < last:
                if model.terms[row, 0] == 0.0:
                    _add_strikes(
                        model.actions, model.strikes, model.terms, row, offset, n, x, y, z, vx, vz, lasts, factor,
                        scratch.rows, out,
                    )  # fmt: skip
                    row += 1
                else:
                    row = _add_nearness(
                        model.actions, model.paths, model.terms, row, last, model.discounts, b, offset, n, x, z, vx,
                        vz, lasts, factor, scratch.gaps, scratch.rows, out,
                    )  # fmt: skip
        _count_price_once(model, scratch, d * slots, begun, end, offset, n, out)


@_part
def _count_price_once(model, scratch, spot, begun, end, offset, n, out):
    """Let a transition cost what it costs the behaviour that it costs most, where each has counted its own price."""
    parts, behaviours = scratch.parts, model.behaviours
    priced = 0
    for b in range(begun, end):
        priced += parts[spot + b - begun, 3] * (behaviours[b, PRICE] + behaviours[b, EACH]) > 0.0
    if priced < 2:
        return
    for k in range(n):
        cost = np.float64(model.moves[np.uint64(offset + k), COST])
        if cost > 0.0:
            total, most = 0.0, 0.0
            for b in range(begun, end):
                price = parts[spot + b - begun, 3] * (behaviours[b, PRICE] * cost + behaviours[b, EACH])
                total += price
                most = max(most, price)
            out[k] += total - most


@_part
def value_actions(model, weights, scratch, first, last):
    """Write into ``scratch.values`` what each action of a state is worth in the situations ``order[first:last]``.

    A situation is where the target's head is in the avatar's ground frame, for a body of scale 1: x, y, z [m]; by how
    much it moves over the ground in a frame of motion, along x and z [m], and for how many; then a state, a row of
    ``weights``, which are those of the behaviours, and a policy, all in ``scratch``. ``BLOCK`` of them are weighed at a
    time: what they read lies anywhere in memory, and one waits for it while others are worked on.
    """
    whose = scratch.policies
    while first < last:
        policy = whose[scratch.order[first]]
        count = 1
        while first + count < last and count < BLOCK and whose[scratch.order[first + count]] == policy:
            count += 1
        _weigh(model, weights, scratch, first, count, policy)
        first += count


@_part
def _next_strike(actions, strikes, action, phase):
    """Return the last whole frame before the next strike of an action, or ``NO_STRIKE``."""
    found = NO_STRIKE
    for k in range(actions[action, STRIKES], actions[action + 1, STRIKES]):
        if strikes[k, TIME] > phase:
            found = min(found, np.int64(np.ceil(strikes[k, TIME])) - 1)
    return found


@_part
def advance(model, avatars, first, last, due, few):
    """Move avatars by one frame; list in ``due[first:]`` those whose action has ended.

    Where they are ``few``, memory is asked for what the next frame will read. Returns how many are listed, or -1 - i
    where avatar i stands nowhere (not a number).
    """
    whole, real = avatars.whole, avatars.real
    actions, ground, policies = model.actions, model.ground, model.policies
    held = first
    for i in range(first, last):
        action = whole[ACTION, i]
        length, before = actions[action, LENGTH], real[PHASE, i]
        if before > whole[PENDING, i]:
            whole[PENDING, i] = _next_strike(actions, model.strikes, action, before)
        phase = before + real[SPEED, i]
        real[PHASE_BEFORE, i] = min(before, length)
        real[PHASE, i] = phase
        whole[ACTION_BEFORE, i] = -1
        stride = policies[whole[POLICY, i], STRIDE]
        place = actions[action, ORIGIN] + min(phase, length) * stride
        if few:
            soon = int(place) + stride
            _ask_for(ground, 3 * soon)
            _ask_for(model.bodies, 9 * soon)
        gx, gz, turned = _ground_at(ground, place)
        cos, sin = real[BASE_COS, i], real[BASE_SIN, i]
        x = real[BASE_X, i] + gx * cos + gz * sin
        z = real[BASE_Z, i] - gx * sin + gz * cos
        heading = real[BASE_TURN, i] + turned
        real[X, i], real[Z, i], real[HEADING, i] = x, z, heading
        if not math.isfinite(x + z + heading):
            return -1 - i
        due[held] = i
        held += phase >= length
    return held - first


@_part
def observe_all(avatars, present, due, first, last, reach, distances, hits, out_opponents, out_counts, out_neighbours):
    """Find opponents and neighbours as ``kd_tree_kernels.observe`` does, by comparing with all ``present`` slots."""
    whole, real = avatars.whole, avatars.real
    room = out_neighbours.shape[1]
    limit = reach * reach
    for q in range(first, last):
        own = due[q]
        x, z, skip = real[X, own], real[Z, own], whole[SKIP, own]
        for i in range(present):
            dx, dz = real[X, i] - x, real[Z, i] - z
            distances[i] = dx * dx + dz * dz
        held = 0
        for i in range(present):  # no branch: who is near is anybody's guess
            hits[held] = i
            held += distances[i] <= limit
        best, found = math.inf, -1
        listed = 0
        for h in range(held):
            i = hits[h]
            if i == own:
                continue
            nearer = distances[i] < best or (distances[i] == best and whole[NUMBER, i] < whole[NUMBER, found])
            if skip > -2 and whole[TEAM, i] != skip and nearer:
                best, found = distances[i], i
            k = listed
            if listed < room:
                listed += 1
            elif held > room + 1:
                # Full: the nearest ones stay, lower numbers first among equals.
                k = 0
                for other in range(1, room):
                    a, b = out_neighbours[q, other], out_neighbours[q, k]
                    if distances[a] > distances[b] or (
                        distances[a] == distances[b] and whole[NUMBER, a] > whole[NUMBER, b]
                    ):
                        k = other
                worst = out_neighbours[q, k]
                if distances[i] > distances[worst] or (
                    distances[i] == distances[worst] and whole[NUMBER, i] > whole[NUMBER, worst]
                ):
                    continue
            out_neighbours[q, k] = i
        out_counts[q] = listed
        if skip > -2 and found < 0:
            for i in range(present):
                if (
                    distances[i] <= best
                    and i != own
                    and whole[TEAM, i] != skip
                    and (distances[i] < best or whole[NUMBER, i] < whole[NUMBER, found])
                ):
                    best, found = distances[i], i
        out_opponents[q] = found


@_part
def _outside(arena, x, z):
    """Return how far a place lies outside the arena [m]; 0 inside."""
    if arena[0] == 1.0:
        dx, dz = x - arena[1], z - arena[2]
        return max(math.sqrt(dx * dx + dz * dz) - arena[3], 0.0)
    if arena[0] == 2.0:
        dx, dz = max(abs(x - arena[1]) - arena[3], 0.0), max(abs(z - arena[2]) - arena[4], 0.0)
        return math.sqrt(dx * dx + dz * dz)
    return 0.0


@_part
def _may_leave(arena, x, z, furthest):
    """Tell whether somebody may end outside the arena who goes so far."""
    dx, dz = abs(x - arena[1]), abs(z - arena[2])
    if arena[0] == 1.0:
        return furthest > arena[3] or dx * dx + dz * dz > (arena[3] - furthest) ** 2
    return arena[0] == 2.0 and (dx + furthest > arena[3] or dz + furthest > arena[4])


@_part
def _change_opponent(whole, real, slot_of, moods, present, own, nearest):
    """Return the number of an avatar's opponent, or what stands for a target: the old one, unless another is nearer.

    Turning to an opponent takes time: one right behind counts as ``BEHIND`` further away than one straight ahead.
    """
    skip = whole[SKIP, own]
    if skip == -2:
        return whole[FIXED, own]
    if nearest < 0:
        return -1
    old = whole[OPPONENT, own]
    if old >= 0:
        slot = slot_of[old]
        if slot < present and slot != own and whole[TEAM, slot] != skip:
            ax, az = real[X, slot] - real[X, own], real[Z, slot] - real[Z, own]
            bx, bz = real[X, nearest] - real[X, own], real[Z, nearest] - real[Z, own]
            cos, sin = cos_sin(real[HEADING, own])
            a, b = math.sqrt(ax * ax + az * az), math.sqrt(bx * bx + bz * bz)
            near = moods[whole[MOOD, own], HYSTERESIS]
            # Cosines of the directions in which the two are.
            ahead = (ax * sin + az * cos) / max(a, 1e-9) - (bx * sin + bz * cos) / max(b, 1e-9)
            if b + 0.5 * BEHIND * ahead >= a - near:
                return old
    return whole[NUMBER, nearest]


@_part
def crowd_out(
    whole,
    real,
    offsets,
    reaches,
    actions,
    moves,
    arena,
    crowding,
    due,
    count,
    counts,
    neighbours,
    near,
    work,
    values,
):
    """Lower the values of actions that end, or pass, inside a neighbour or outside the arena.

    For avatars ``due[:count]``, with which neighbours and values run along. ``near`` and ``work`` are scratch space.
    """
    ends_x, ends_z, frames, worst = work[0], work[1], work[2], work[3]
    end_cost, path_cost, disc, gap = crowding[0], crowding[1], crowding[2], crowding[3]
    for q in range(count):
        own = due[q]
        x, z, scale, speed = real[X, own], real[Z, own], real[SCALE, own], real[SPEED, own]
        state = actions[whole[ACTION, own], NEXT]
        offset = offsets[state]
        furthest = reaches[state] * scale + 1e-6  # moves are single numbers
        close = 0
        for m in range(counts[q]):
            j = neighbours[q, m]
            ax, az = real[X, j] - x, real[Z, j] - z
            wx, wz = real[END_X, j] - real[X, j], real[END_Z, j] - real[Z, j]
            room = disc * (scale + real[SCALE, j]) + gap
            # Where on its way the neighbour comes nearest to where the avatar is now.
            towards, moved = -(ax * wx + az * wz), wx * wx + wz * wz
            t = min(towards / moved, 1.0) if towards > 0.0 else 0.0
            nx, nz = ax + t * wx, az + t * wz
            near[close, 0], near[close, 1], near[close, 2], near[close, 3], near[close, 4] = ax, az, wx, wz, room
            near[close, 5] = (actions[whole[ACTION, j], LENGTH] - real[PHASE, j]) / real[SPEED, j]
            close += nx * nx + nz * nz < (room + furthest) ** 2
        leaves = _may_leave(arena, x, z, furthest)
        if close == 0 and not leaves:
            continue
        cos, sin = cos_sin(real[HEADING, own])
        cos, sin = cos * scale, sin * scale
        done = min(real[PHASE, own] - actions[whole[ACTION, own], LENGTH], speed)
        n = offsets[state + 1] - offset
        for k in range(np.uint64(n)):
            action = np.uint64(offset) + k
            ex, ez = moves[action, MOVE_X], moves[action, MOVE_Z]
            ends_x[k], ends_z[k] = ex * cos + ez * sin, ez * cos - ex * sin
            frames[k] = actions[action, LENGTH]
        lanes = np.uint64(_whole_lanes(n))
        for k in range(lanes):
            frames[k] = max(frames[k] - done, 0.0) / speed
            worst[k] = 0.0
        for m in range(np.uint64(close)):
            ax, az, wx, wz, room, left = near[m, 0], near[m, 1], near[m, 2], near[m, 3], near[m, 4], near[m, 5]
            # No branch: who comes too near is anybody's guess.
            for k in range(lanes):
                share = frames[k] / left if frames[k] < left else 1.0
                dx, dz = share * wx - ends_x[k], share * wz - ends_z[k]
                bx, bz = ax + dx, az + dz
                at_end = end_cost * (1.0 - math.sqrt(bx * bx + bz * bz) / room)
                # Where on their straight ways the two come nearest, seen from the avatar.
                towards, moved = -(ax * dx + az * dz), dx * dx + dz * dz
                t = towards / moved if towards < moved else 1.0
                nx, nz = ax + t * dx, az + t * dz
                on_way = path_cost * (1.0 - math.sqrt(nx * nx + nz * nz) / room)
                worst[k] = max(max(worst[k], at_end), on_way if towards > 0.0 else 0.0)
        if leaves:
            for k in range(lanes):
                worst[k] += crowding[4] * _outside(arena, x + ends_x[k], z + ends_z[k])
        for k in range(lanes):
            values[q, k] -= worst[k]


@_part
def _drawn(chances, count, wanted):
    """Return the first chance that is not zero and up to which they add up to more than is wanted, or the last one."""
    picked = 0
    for k in range(count):
        if chances[k] > 0.0:
            picked = k
            wanted -= chances[k]
            if wanted < 0.0:
                break
    return picked


@_part
def _candidate(values, row, n, floor, place):
    """Return the action that comes ``place``-th, counted from 0, among those worth ``floor`` or more."""
    for k in range(n):
        if values[row, k] >= floor:
            if place == 0:
                return k
            place -= 1
    return -1


@_part
def _pick(values, row, n, margin, most, temperature, number, chances):
    """Return one of the candidates: those near the best value, drawn by ``number`` in [0, 1); -1 for no number.

    Where there are too many, those of the least values drop out, the later ones among equals.
    """
    top = values[row, 0]
    for k in range(1, n):
        top = values[row, k] if values[row, k] > top else top
    if not math.isfinite(top):
        return -1
    first = temperature <= 0.0 or most <= 1
    floor = top if first else top - margin
    near = 0
    for k in range(n):  # no branch: who is near is anybody's guess
        chances[near] = values[row, k]
        near += values[row, k] >= floor
    if near == 1 or first:
        return _candidate(values, row, n, top, 0)
    if near <= most:
        total = 0.0
        for c in range(near):
            chances[c] = math.exp((chances[c] - top) / temperature)
            total += chances[c]
        return _candidate(values, row, n, floor, _drawn(chances, near, number * total))
    # The value that comes ``most``-th, and how many of those who have it may stay.
    held = 0
    for k in range(n):
        value = values[row, k]
        if held < most or value > chances[held - 1]:
            m = held if held < most else held - 1
            while m > 0 and chances[m - 1] < value:
                chances[m] = chances[m - 1]
                m -= 1
            chances[m] = value
            held = min(held + 1, int(most))
    floor = chances[held - 1]
    near = held
    total = 0.0
    left = near
    for k in range(n):
        above = values[row, k] >= floor
        if above and values[row, k] == floor:
            higher = 0
            for m in range(n):
                higher += values[row, m] > floor
            equal = 0
            for m in range(k):
                equal += values[row, m] == floor
            above = higher + equal < near
        chances[k] = math.exp((values[row, k] - top) / temperature) if above else 0.0
        total += chances[k]
        left -= above
        if left == 0:
            for m in range(k + 1, n):
                chances[m] = 0.0
            break
    return _drawn(chances, n, number * total)


@_kernel
def order_by_state(states, count, starts, out_order):
    """List the places of ``states[:count]`` by state; ``starts`` (S + 2,) is scratch.

    Those who choose among the same actions come one after another, so that these are read from memory once.
    """
    for state in range(starts.shape[0]):
        starts[state] = 0
    for q in range(count):
        starts[states[q] + 2] += 1
    for state in range(1, starts.shape[0]):
        starts[state] += starts[state - 1]
    for q in range(count):
        place = states[q] + 1
        out_order[starts[place]] = q
        starts[place] += 1


@_part
def aim(
    whole, real, slot_of, offsets, actions, moves, bodies, ground, policies, arena, crowding, targets, moods, present,
    moment, due, count, nearest, out_situations, out_states, out_moods, out_policies,
):  # fmt: skip
    """Choose opponents for avatars ``due[:count]`` and write their situations (``value_actions``).

    The state is that in which the action ends, or -1 where there is nobody to fight.
    """
    width = whole.shape[1]
    for q in range(count):
        if q + 2 * AHEAD < count:
            own, j = due[q + 2 * AHEAD], max(nearest[q + 2 * AHEAD], 0)
            for row in (OPPONENT, SKIP, ACTION, MOOD, POLICY, OPPONENT_BEFORE):
                _ask_for(whole, row * width + own)
            for row in (X, Z, SCALE, HEADING):
                _ask_for(real, row * width + own)
                _ask_for(real, row * width + j)
            _ask_for(real, PHASE * width + j)
            _ask_for(whole, ACTION * width + j)
            _ask_for(whole, POLICY * width + j)
        if q + AHEAD < count:
            j = max(nearest[q + AHEAD], 0)
            place = actions[whole[ACTION, j], ORIGIN] + int(real[PHASE, j]) * policies[whole[POLICY, j], STRIDE]
            _ask_for(bodies, 9 * place)
        own = due[q]
        opponent = _change_opponent(whole, real, slot_of, moods, present, own, nearest[q])
        whole[OPPONENT_BEFORE, own] = whole[OPPONENT, own]
        whole[OPPONENT, own] = opponent
        x, z, scale = real[X, own], real[Z, own], real[SCALE, own]
        seen = False
        tx, ty, tz = 0.0, 1.5 * scale, 0.0
        vx, vz, lasts = 0.0, 0.0, 0.0
        if opponent <= -2:
            target = -2 - opponent
            tx, ty, tz = targets[moment, target, 0], targets[moment, target, 1], targets[moment, target, 2]
            vx, vz = tx - targets[moment - 1, target, 0], tz - targets[moment - 1, target, 2]
            lasts = math.inf
            seen = True
        elif opponent >= 0 and slot_of[opponent] < present:
            j = slot_of[opponent]
            action = whole[ACTION, j]
            done = min(real[PHASE, j], actions[action, LENGTH])
            place = actions[action, ORIGIN] + done * policies[whole[POLICY, j], STRIDE]
            size = real[SCALE, j]
            hx, hz = _between(bodies, place, HEAD) * size, _between(bodies, place, HEAD + 2) * size
            cos, sin = cos_sin(real[HEADING, j])
            tx, tz = real[X, j] + hx * cos + hz * sin, real[Z, j] - hx * sin + hz * cos
            ty = _between(bodies, place, HEAD + 1) * size
            lasts = (actions[action, LENGTH] - done) / real[SPEED, j]
            if lasts > 0.0:
                # Where its head is at the end of its action.
                stride = policies[whole[POLICY, j], STRIDE]
                place = actions[action, ORIGIN] + actions[action, LENGTH] * stride
                cos, sin = cos_sin(real[BASE_TURN, j] + ground[place, 2])
                hx, hz = bodies[place, HEAD] * size, bodies[place, HEAD + 2] * size
                vx = (real[END_X, j] + hx * cos + hz * sin - tx) / lasts
                vz = (real[END_Z, j] - hx * sin + hz * cos - tz) / lasts
            seen = True
        if arena[0] != 0.0 and _outside(arena, x, z) > crowding[5]:
            # Turn back: the middle counts until the avatar is inside again.
            tx, tz = arena[1], arena[2]
            vx, vz = 0.0, 0.0
            seen = True
        cos, sin = cos_sin(real[HEADING, own])
        dx, dz = (tx - x) / scale, (tz - z) / scale
        out_situations[q, TARGET_X] = dx * cos - dz * sin
        out_situations[q, TARGET_Y] = ty / scale
        out_situations[q, TARGET_Z] = dx * sin + dz * cos
        dx, dz = vx / (scale * real[SPEED, own]), vz / (scale * real[SPEED, own])
        out_situations[q, MOVING_X] = dx * cos - dz * sin
        out_situations[q, MOVING_Z] = dx * sin + dz * cos
        out_situations[q, LASTS] = lasts * real[SPEED, own]
        state = actions[whole[ACTION, own], NEXT]
        for action in range(offsets[state], offsets[state + 1], 2):
            _ask_for(moves, action * moves.shape[1])
            _ask_for(actions, action * actions.shape[1])
        out_states[q] = state if seen else -1
        out_moods[q], out_policies[q] = whole[MOOD, own], whole[POLICY, own]


@_part
def draw_actions(whole, real, offsets, actions, moods, stream, frame, due, count, values, chances, out_chosen):
    """Draw the next action of avatars ``due[:count]`` by its value; return -1, or a slot without numbers.

    Strikes come in bursts. A strike takes ``INTERVAL`` frames to recover from; after a burst an avatar rests until it
    has recovered from all of them, and strikes cost it dear meanwhile.
    """
    for q in range(count):
        own = due[q]
        state, mood = actions[whole[ACTION, own], NEXT], whole[MOOD, own]
        interval = moods[mood, INTERVAL]
        if interval > 0.0 and whole[BURST, own] <= 0:
            if frame >= real[RESTED, own]:
                least, most = BURSTS
                drawn = draw(stream[1], whole[NUMBER, own], whole[DECISIONS, own])
                whole[BURST, own] = least + int(drawn * (most - least + 1))
            else:
                for k in range(offsets[state + 1] - offsets[state]):
                    action = offsets[state] + k
                    values[q, k] -= REST * (actions[action + 1, STRIKES] - actions[action, STRIKES])
        number = draw(stream[0], whole[NUMBER, own], whole[DECISIONS, own])
        picked = _pick(
            values, q, offsets[state + 1] - offsets[state], moods[mood, MARGIN], moods[mood, MOST],
            moods[mood, TEMPERATURE], number, chances,
        )  # fmt: skip
        if picked < 0:
            return own
        action = offsets[state] + picked
        out_chosen[q] = action
        if interval > 0.0:
            thrown = actions[action + 1, STRIKES] - actions[action, STRIKES]
            whole[BURST, own] = max(whole[BURST, own] - thrown, 0)
            real[RESTED, own] = max(real[RESTED, own], np.float64(frame)) + interval * thrown
    return -1


@_part
def keep_running(whole, offsets, actions, moves, due, count, states, values):
    """Where there is nobody to fight, let captured motion run on: the cheapest transition is worth most."""
    for q in range(count):
        if states[q] < 0:
            state = actions[whole[ACTION, due[q]], NEXT]
            for k in range(offsets[state + 1] - offsets[state]):
                values[q, k] = -moves[offsets[state] + k, COST]


@_part
def choose(
    model, avatars, world, present, moment, frame, due, count, nearest, counts, neighbours, scratch, out_chosen
):  # fmt: skip
    """Choose an opponent and the next action for avatars ``due[:count]``, for whom ``scratch`` has room.

    ``nearest``, ``counts`` and ``neighbours`` are what was observed and run along with ``due``, as the chosen actions
    do; ``moment`` is the row of ``world.targets`` for this frame. Everybody looks around in the order of storage, in
    which neighbours lie together; many weigh their actions in the order of their states. Returns -1, or the slot of an
    avatar whose values are no numbers.
    """
    aim(
        avatars.whole, avatars.real, avatars.slot_of, model.offsets, model.actions, model.moves, model.bodies,
        model.ground, model.policies, world.arena, world.crowding, world.targets, world.moods, present, moment, due,
        count, nearest, scratch.situations, scratch.states, scratch.moods, scratch.policies,
    )  # fmt: skip
    if count >= SORTED:
        order_by_state(scratch.states, count, scratch.starts, scratch.order)
    else:
        for q in range(count):
            scratch.order[q] = q
    value_actions(model, world.weights, scratch, 0, count)
    keep_running(avatars.whole, model.offsets, model.actions, model.moves, due, count, scratch.states, scratch.values)
    crowd_out(
        avatars.whole, avatars.real, model.offsets, model.reaches, model.actions, model.moves, world.arena,
        world.crowding, due, count, counts, neighbours, scratch.near, scratch.work,
        scratch.values,
    )  # fmt: skip
    return draw_actions(
        avatars.whole, avatars.real, model.offsets, model.actions, world.moods, world.stream, frame, due, count,
        scratch.values, scratch.rows, out_chosen,
    )  # fmt: skip


@_part
def switch(model, avatars, due, chosen, first, last):
    """Start the chosen actions where the old ones have ended, with the motion that was left over."""
    whole, real = avatars.whole, avatars.real
    actions, ground, starts, policies = model.actions, model.ground, model.starts, model.policies
    for q in range(first, last):
        i = due[q]
        old, new = whole[ACTION, i], chosen[q]
        stride, scale, speed = policies[whole[POLICY, i], STRIDE], real[SCALE, i], real[SPEED, i]
        phase = min(real[PHASE, i] - actions[old, LENGTH], speed)
        origin = actions[new, ORIGIN]
        x, z, heading = real[X, i], real[Z, i], real[HEADING, i]
        heading -= 2.0 * math.pi * math.floor(heading / (2.0 * math.pi) + 0.5)
        gx, gz, gh = starts[new, 0], starts[new, 1], starts[new, 2]
        if whole[ACTION_BEFORE, i] == ENTERED:  # nobody has seen what came before, so they stand where they should
            gx, gz, gh = ground[origin, 0], ground[origin, 1], ground[origin, 2]
        turn = heading - gh
        cos, sin = cos_sin(turn)
        cos, sin = cos * scale, sin * scale
        base_x, base_z = x - gx * cos - gz * sin, z + gx * sin - gz * cos
        real[BASE_X, i], real[BASE_Z, i] = base_x, base_z
        real[BASE_COS, i], real[BASE_SIN, i], real[BASE_TURN, i] = cos, sin, turn
        last_frame = origin + actions[new, LENGTH] * stride
        gx, gz = ground[last_frame, 0], ground[last_frame, 1]
        real[END_X, i], real[END_Z, i] = base_x + gx * cos + gz * sin, base_z - gx * sin + gz * cos
        gx, gz, heading = _ground_at(ground, origin + min(phase, actions[new, LENGTH]) * stride)
        real[X, i], real[Z, i] = base_x + gx * cos + gz * sin, base_z - gx * sin + gz * cos
        real[HEADING, i] = heading + turn
        whole[PENDING, i] = -1 if whole[PENDING, i] < actions[old, LENGTH] else actions[new, FIRST_STRIKE]
        whole[ACTION_BEFORE, i] = old
        whole[ACTION, i] = new
        real[PHASE, i] = phase
        whole[DECISIONS, i] += 1


@_part
def _base_before(model, whole, real, i):
    """Return where the action before the present one is based: x, z, cos, sin, turn."""
    actions, ground, starts, new = model.actions, model.ground, model.starts, whole[ACTION, i]
    gx, gz = starts[new, 0], starts[new, 1]
    cos, sin = real[BASE_COS, i], real[BASE_SIN, i]
    x = real[BASE_X, i] + gx * cos + gz * sin
    z = real[BASE_Z, i] - gx * sin + gz * cos
    old = whole[ACTION_BEFORE, i]
    end = actions[old, ORIGIN] + actions[old, LENGTH] * model.policies[whole[POLICY, i], STRIDE]
    turn = real[BASE_TURN, i] + starts[new, 2] - ground[end, 2]
    cos, sin = cos_sin(turn)
    cos, sin = cos * real[SCALE, i], sin * real[SCALE, i]
    gx, gz = ground[end, 0], ground[end, 1]
    return x - gx * cos - gz * sin, z + gx * sin - gz * cos, cos, sin, turn


@_part
def _body_at(model, avatars, j, share):
    """Return head, upper and lower end of the torso of an avatar, ``share`` of the way to this frame."""
    whole, real, actions, policies, bodies = avatars.whole, avatars.real, model.actions, model.policies, model.bodies
    action, phase = whole[ACTION, j], min(real[PHASE, j], actions[whole[ACTION, j], LENGTH])
    bx, bz, cos, sin = real[BASE_X, j], real[BASE_Z, j], real[BASE_COS, j], real[BASE_SIN, j]
    turn = real[BASE_TURN, j]
    if whole[ACTION_BEFORE, j] < 0:
        phase = real[PHASE_BEFORE, j] + share * (phase - real[PHASE_BEFORE, j])
    else:
        before = actions[whole[ACTION_BEFORE, j], LENGTH] - real[PHASE_BEFORE, j]
        moved = share * (before + phase)
        if moved < before:
            action = whole[ACTION_BEFORE, j]
            phase = real[PHASE_BEFORE, j] + moved
            bx, bz, cos, sin, turn = _base_before(model, whole, real, j)
        else:
            phase = moved - before
    place = actions[action, ORIGIN] + phase * policies[whole[POLICY, j], STRIDE]
    gx, gz, heading = _ground_at(model.ground, place)
    x, z = bx + gx * cos + gz * sin, bz - gx * sin + gz * cos
    size = real[SCALE, j]
    cos, sin = cos_sin(turn + heading)
    cos, sin = cos * size, sin * size
    head = _point_at(bodies, place, HEAD, x, z, size, cos, sin)
    return (
        head,
        _point_at(bodies, place, NECK, x, z, size, cos, sin),
        _point_at(bodies, place, PELVIS, x, z, size, cos, sin),
    )


@_part
def _touches(head, neck, pelvis, head_radius, torso_radius, tolerance, px, py, pz):
    """Tell whether a fist lands on a head and torso: within the tolerance of their surface (``rewards.lands``)."""
    hx, hy, hz = px - head[0], py - head[1], pz - head[2]
    distance = math.sqrt(hx * hx + hy * hy + hz * hz) - head_radius
    dx, dy, dz = neck[0] - pelvis[0], neck[1] - pelvis[1], neck[2] - pelvis[2]
    lx, ly, lz = px - pelvis[0], py - pelvis[1], pz - pelvis[2]
    square = dx * dx + dy * dy + dz * dz
    t = 0.0
    if square > 0.0:
        t = min(max((lx * dx + ly * dy + lz * dz) / square, 0.0), 1.0)
    lx, ly, lz = lx - t * dx, ly - t * dy, lz - t * dz
    distance = min(distance, math.sqrt(lx * lx + ly * ly + lz * lz) - torso_radius)
    return -tolerance <= distance <= tolerance


@_part
def _lands(model, avatars, targets, moment, present, i, opponent, share, px, py, pz):
    """Tell whether a strike of avatar ``i`` lands: near the surface of the opponent's head or torso then."""
    real, sizes, policy, scale = avatars.real, model.sizes, avatars.whole[POLICY, i], avatars.real[SCALE, i]
    tolerance = sizes[policy, TOLERANCE] * scale
    if opponent <= -2:
        before, now = targets[moment - 1, -2 - opponent], targets[moment, -2 - opponent]
        hx, hz = before[0] + share * (now[0] - before[0]), before[2] + share * (now[2] - before[2])
        hy = before[1] + share * (now[1] - before[1])
        neck = (hx, hy - sizes[policy, NECK_DROP] * scale, hz)
        pelvis = (hx, hy - sizes[policy, PELVIS_DROP] * scale, hz)
        head_radius, torso_radius = sizes[policy, HEAD_RADIUS] * scale, sizes[policy, TORSO_RADIUS] * scale
        return _touches((hx, hy, hz), neck, pelvis, head_radius, torso_radius, tolerance, px, py, pz)
    j = avatars.slot_of[opponent] if opponent >= 0 else present
    if j >= present:
        return False
    whose, size = avatars.whole[POLICY, j], real[SCALE, j]
    dx, dz = real[X, j] - px, real[Z, j] - pz
    # As far as a body reaches from where it stands, and moves in a frame: most who miss are not even near.
    far = size * (sizes[whose, REACH] + real[SPEED, j] * sizes[whose, PACE]) + tolerance
    if dx * dx + dz * dz > far * far:
        return False
    head, neck, pelvis = _body_at(model, avatars, j, share)
    head_radius, torso_radius = sizes[whose, HEAD_RADIUS] * size, sizes[whose, TORSO_RADIUS] * size
    return _touches(head, neck, pelvis, head_radius, torso_radius, tolerance, px, py, pz)


@_part
def _strikes_in(model, avatars, targets, present, moment, frame, i, old, out_whole, out_real, held):
    """List the strikes of one avatar in its action, or in its ``old`` one; return how many ``held`` and they are."""
    whole, real, actions, strikes, starts = avatars.whole, avatars.real, model.actions, model.strikes, model.starts
    switched = whole[ACTION_BEFORE, i] >= 0
    before = whole[ACTION_BEFORE, i] if switched else whole[ACTION, i]
    action = before if old else whole[ACTION, i]
    shown = min(real[PHASE, i], actions[whole[ACTION, i], LENGTH])
    rest = actions[before, LENGTH] - real[PHASE_BEFORE, i] if switched else 0.0
    motion = rest + shown if switched else shown - real[PHASE_BEFORE, i]
    low = real[PHASE_BEFORE, i] if old or not switched else 0.0
    high = actions[before, LENGTH] if old else shown
    scale = real[SCALE, i]
    opponent = whole[OPPONENT_BEFORE, i] if old else whole[OPPONENT, i]
    for k in range(actions[action, STRIKES], actions[action + 1, STRIKES]):
        time = np.float64(strikes[k, TIME])
        if not low < time <= high:
            continue
        if held < out_whole.shape[0]:
            base_x, base_z, cos, sin = real[BASE_X, i], real[BASE_Z, i], real[BASE_COS, i], real[BASE_SIN, i]
            if old:
                base_x, base_z, cos, sin, _ = _base_before(model, whole, real, i)
            gx, gz, gh = starts[action, 0], starts[action, 1], starts[action, 2]
            wx, wz = cos_sin(gh)
            fx, fz = strikes[k, FIST_X], strikes[k, FIST_Z]
            gx, gz = gx + fx * wx + fz * wz, gz - fx * wz + fz * wx
            px, pz = base_x + gx * cos + gz * sin, base_z - gx * sin + gz * cos
            py = strikes[k, FIST_Y] * scale
            share = (time - low + (0.0 if old or not switched else rest)) / motion
            out_whole[held, 0] = whole[NUMBER, i]
            out_whole[held, 1] = opponent
            out_whole[held, 2] = strikes[k, HAND]
            # Between two frames, and as exact as a number that is written: landing is judged then.
            out_real[held, 0] = frame - 1.0 + share
            out_real[held, 1], out_real[held, 2], out_real[held, 3] = px, py, pz
            out_real[held, 4] = strikes[k, FIST_SPEED] * scale * real[SPEED, i]
            share = out_real[held, 0] - (frame - 1.0)
            out_whole[held, 3] = _lands(model, avatars, targets, moment, present, i, opponent, share, px, py, pz)
        held += 1
    return held


@_part
def strike(model, avatars, world, present, moment, frame, first, last, who, out_whole, out_real, held):
    """List the strikes that avatars have thrown on the way to this frame; return how many ``held`` and they are.

    Within a control frame motion runs evenly, through the end of an action where there is one; strikes and opponents
    are placed in between accordingly. Where ``out_whole`` and ``out_real`` have no room, strikes are only counted.
    ``who[first:last]`` is scratch space.
    """
    whole, real, actions, slot_of = avatars.whole, avatars.real, model.actions, avatars.slot_of
    listed = first
    for i in range(first, last):  # no branch: who strikes is anybody's guess
        who[listed] = i
        listed += real[PHASE, i] > whole[PENDING, i]
    for k in range(first, listed):
        if k + AHEAD < listed:
            i = who[k + AHEAD]
            _ask_for(model.strikes, model.strikes.shape[1] * actions[whole[ACTION, i], STRIKES])
            _ask_for(model.starts, 3 * whole[ACTION, i])
            j = slot_of[max(whole[OPPONENT, i], 0)]
            place = int(real[PHASE, j]) * model.policies[whole[POLICY, j], STRIDE]
            place += actions[whole[ACTION, j], ORIGIN]
            _ask_for(model.bodies, 9 * place)
            _ask_for(model.ground, 3 * place)
        i = who[k]
        if whole[ACTION_BEFORE, i] >= 0:
            held = _strikes_in(
                model, avatars, world.targets, present, moment, frame, i, True, out_whole, out_real, held
            )
        held = _strikes_in(model, avatars, world.targets, present, moment, frame, i, False, out_whole, out_real, held)
    return held


@_part
def write_record(model, avatars, record, row, first, last):
    """Write what the take keeps of avatars ``first`` to ``last`` into a row of the record, by number."""
    whole, real = avatars.whole, avatars.real
    actions, policies = model.actions, model.policies
    for i in range(first, last):
        n = whole[NUMBER, i]
        action = whole[ACTION, i]
        heading = real[HEADING, i]
        record.whole[0, row, n] = action - policies[whole[POLICY, i], ACTIONS]
        record.real[0, row, n] = min(real[PHASE, i], actions[action, LENGTH])
        record.real[1, row, n] = real[X, i]
        record.real[2, row, n] = real[Z, i]
        record.real[3, row, n] = heading - 2.0 * math.pi * math.floor(heading / (2.0 * math.pi) + 0.5)
        record.whole[1, row, n] = whole[OPPONENT, i]


@kernel
def run_frames(
    model, avatars, world, present, frame, count, fresh, reach, most_near, scratch, record, strikes, timings, fault
):
    """Run ``count`` control frames from ``frame`` on for a small crowd, and record them.

    ``fresh``: the first frame only decides, since nothing has moved yet. ``timings`` (count, 6) takes the time of
    index, observe, choose, advance, strikes and record [ns]; with None no clock is read. ``fault`` takes the frame and
    slot of an avatar that got lost. Returns the frames done, which are fewer where room for strikes may not last, and
    the number of strikes.
    """
    due, hits = np.empty(present, np.int32), np.empty(present, np.int64)
    room = scratch.states.shape[0]
    nearest, counts = np.empty(present, np.int32), np.empty(present, np.int32)
    chosen = np.empty(present, np.int32)
    neighbours = np.empty((present, most_near), np.int32)
    distances = np.empty(present)
    clock = np.empty(2, np.int64)
    times = np.empty(6, np.int64)
    held = 0
    for k in range(count):
        if held + 8 * present > strikes.whole.shape[0] and k > 0:
            return k, held
        if timings is not None:
            times[0] = _now(clock)
        if fresh and k == 0:
            for i in range(present):
                due[i] = i
            dues = present
        else:
            dues = advance(model, avatars, 0, present, due, True)
            if dues < 0:
                fault[0], fault[1] = frame + k, -1 - dues
                return k, held
        if timings is not None:
            times[1] = _now(clock)
        observe_all(avatars, present, due, 0, dues, reach, distances, hits, nearest, counts, neighbours)
        if timings is not None:
            times[2] = _now(clock)
        lost = -1
        for start in range(0, dues, room):
            lost = max(
                lost,
                choose(
                    model, avatars, world, present, k + 1, frame + k, due[start:], min(room, dues - start),
                    nearest[start:], counts[start:], neighbours[start:], scratch, chosen[start:],
                ),
            )  # fmt: skip
        if lost >= 0:
            fault[0], fault[1] = frame + k, lost
            return k, held
        if timings is not None:
            times[3] = _now(clock)
        for q in range(dues):
            origin, length = model.actions[chosen[q], ORIGIN], model.actions[chosen[q], LENGTH]
            _ask_for(model.ground, 3 * origin)
            _ask_for(model.starts, 3 * chosen[q])
            _ask_for(model.ground, 3 * (origin + length * model.policies[avatars.whole[POLICY, due[q]], STRIDE]))
        switch(model, avatars, due, chosen, 0, dues)
        if timings is not None:
            times[4] = _now(clock)
        held = strike(
            model, avatars, world, present, k + 1, frame + k, 0, present, due, strikes.whole, strikes.real, held
        )
        if timings is not None:
            times[5] = _now(clock)
        write_record(model, avatars, record, k, 0, present)
        if timings is not None:
            timings[k, 0] = 0
            timings[k, 1] = times[2] - times[1]
            timings[k, 2] = times[3] - times[2]
            timings[k, 3] = times[1] - times[0] + times[4] - times[3]
            timings[k, 4] = times[5] - times[4]
            timings[k, 5] = _now(clock) - times[5]
    return count, held
