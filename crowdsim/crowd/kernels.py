"""Compiled control: everything that avatars do in a frame, except for the index of large crowds.

``model``, ``avatars``, ``world``, ``record`` and ``strikes`` are the named tuples of ``arrays.py``. Each kernel handles
avatars (or decisions) ``first`` to ``last`` and writes nothing that another range reads in the same stage. Look-ups and
rewards mean what ``policy.action_values`` says, draws what ``random.uniform`` says; tests hold them equal.
"""

import math

import numba as nb
import numpy as np
from numba import types

# Rows of ``Avatars.whole`` and ``Avatars.real``, a column for each slot.
NUMBER, POLICY, MOOD, TEAM, SKIP, FIXED, OPPONENT, OPPONENT_BEFORE, DECISIONS, ACTION, ACTION_BEFORE = range(11)
SCALE, SPEED, PHASE, PHASE_BEFORE, BASE_X, BASE_Z, BASE_COS, BASE_SIN, BASE_TURN, X, Z, HEADING, END_X, END_Z = range(
    14
)

# Columns of the tables of ``Model`` and of ``World.moods``.
NEXT, LENGTH, ORIGIN, PATHS, STRIKES = range(5)
MOVE_X, MOVE_Z, MOVE_COS, MOVE_SIN, COST = range(5)
TIME, FIST_X, FIST_Y, FIST_Z, WEIGHT, FIST_SPEED, HAND = range(7)
HEAD, NECK, PELVIS = 0, 3, 6
STRIDE, BEHAVIOURS, ACTIONS, STATES = range(4)
MARGIN, MOST, TEMPERATURE, HYSTERESIS = range(4)

_clock_type = types.int32(types.int32, types.CPointer(types.int64))
_clock_gettime = types.ExternalFunction("clock_gettime", _clock_type)


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _now(buffer):
    """Return a steady time [ns]; ``buffer`` has room for two numbers."""
    _clock_gettime(1, buffer.ctypes)  # type: ignore[call-overload]
    return buffer[0] * 1_000_000_000 + buffer[1]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _mix(bits):
    """Scramble 64 bits."""
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return bits ^ (bits >> np.uint64(31))


@nb.njit(cache=True, nogil=True, error_model="numpy")
def draw(stream, avatar, decision):
    """Return a number in [0, 1) that depends on nothing else."""
    golden = np.uint64(0x9E3779B97F4A7C15)
    bits = _mix(stream + (np.uint64(avatar) + np.uint64(1)) * golden)
    bits = _mix(bits + (np.uint64(decision) + np.uint64(1)) * golden)
    return np.float64(bits >> np.uint64(11)) * 2.0**-53


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _between(rows, place, column):
    """Return a column of ``rows`` at a fractional row."""
    below = int(place)
    share = place - below
    value = np.float64(rows[below, column])
    if share > 0.0:
        value += share * (rows[below + 1, column] - value)
    return value


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _corners(axes, first, end, x, y, z, cells, shares):
    """Write the cells around a target and their shares; return how many there are."""
    count = 1
    cells[0] = 0
    shares[0] = 1.0
    for row in range(first, end):
        kind = int(axes[row, 0])
        if kind == 0:
            value = math.sqrt(x * x + z * z)
        elif kind == 1:
            value = math.atan2(x, z)
        else:
            value = y
        points, stride = int(axes[row, 3]), int(axes[row, 5])
        place = (value - axes[row, 1]) / axes[row, 2]
        if axes[row, 4] != 0.0:
            place -= points * math.floor(place / points)
            lower = min(int(place), points - 1)
            upper = lower + 1 if lower + 1 < points else 0
        else:
            place = min(max(place, 0.0), points - 1.0)
            lower = max(min(int(place), points - 2), 0)
            upper = min(lower + 1, points - 1)
        share = place - lower
        for corner in range(count):
            cells[count + corner] = cells[corner] + upper * stride
            shares[count + corner] = shares[corner] * share
            cells[corner] += lower * stride
            shares[corner] *= 1.0 - share
        count *= 2
    return count


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _fade(axes, first, end, x, y, z):
    """Return how much a behaviour counts for a target: 1 inside its grid, falling to 0 beyond it."""
    fade = 1.0
    for row in range(first, end):
        if axes[row, 4] == 0.0 and axes[row, 6] > 0.0:
            kind = int(axes[row, 0])
            if kind == 0:
                value = math.sqrt(x * x + z * z)
            elif kind == 1:
                value = math.atan2(x, z)
            else:
                value = y
            place = (value - axes[row, 1]) / axes[row, 2]
            beyond = max(-place, place - (axes[row, 3] - 1.0), 0.0) * axes[row, 2]
            fade *= max(0.0, 1.0 - beyond / axes[row, 6])
    return fade


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _reward(model, action, x, y, z, first, end, log_discount):
    """Return the reward of an action for a target at rest: rows ``first`` to ``end`` of the terms."""
    total = 0.0
    for row in range(first, end):
        code = int(model.terms[row, 0])
        weight = model.terms[row, 1]
        if code == 0:
            best = 0.0
            tolerance = model.terms[row, 2]
            for k in range(model.actions[action, STRIKES], model.actions[action + 1, STRIKES]):
                px, py, pz = model.strikes[k, FIST_X], model.strikes[k, FIST_Y], model.strikes[k, FIST_Z]
                dx, dy, dz = px - x, py - y, pz - z
                lands = abs(math.sqrt(dx * dx + dy * dy + dz * dz) - model.terms[row, 4]) <= tolerance
                if not lands:
                    dy = py - min(max(py, y - model.terms[row, 7]), y - model.terms[row, 6])
                    lands = abs(math.sqrt(dx * dx + dy * dy + dz * dz) - model.terms[row, 5]) <= tolerance
                if lands:
                    speed = model.strikes[k, WEIGHT] ** model.terms[row, 3]
                    best = max(best, math.exp(model.strikes[k, TIME] * log_discount) * speed)
            total += weight * best
        elif code == 1:
            near = 0.0
            factor = 1.0
            discount = math.exp(log_discount)
            for k in range(model.actions[action, PATHS], model.actions[action + 1, PATHS]):
                factor *= discount
                dx, dz = x - model.paths[k, 0], z - model.paths[k, 1]
                if model.terms[row, 5] != 0.0:
                    cos, sin = math.cos(model.paths[k, 2]), math.sin(model.paths[k, 2])
                    aside, ahead = dx * cos - dz * sin, dx * sin + dz * cos - model.terms[row, 2]
                    gap = math.sqrt(ahead * ahead + aside * aside)
                else:
                    gap = abs(math.sqrt(dx * dx + dz * dz) - model.terms[row, 2])
                value = factor * math.exp(-gap / model.terms[row, 3])
                near = max(near, value) if model.terms[row, 4] != 0.0 else near + value
            total += weight * near
        else:
            cost = model.moves[action, COST]
            total -= weight * cost + (model.terms[row, 2] if cost > 0.0 else 0.0)
    return total


@nb.njit(cache=True, nogil=True, error_model="numpy")
def value_actions(model, weights, policy, state, x, y, z, cells, shares, out):
    """Write what each action of a state is worth for a target in the avatar's ground frame; return how many there are.

    ``weights`` (B,) are those of the policy's behaviours; ``cells`` and ``shares`` are scratch space.
    """
    offset = model.offsets[state]
    n = model.offsets[state + 1] - offset
    for k in range(n):
        out[k] = 0.0
    start = model.policies[policy, BEHAVIOURS]
    for b in range(start, model.policies[policy + 1, BEHAVIOURS]):
        weight = weights[b - start]
        if weight == 0.0:
            continue
        axis_first, axis_end = int(model.behaviours[b, 0]), int(model.behaviours[b, 1])
        factor = weight * _fade(model.axes, axis_first, axis_end, x, y, z) / model.behaviours[b, 7]
        if factor == 0.0:
            continue
        cell_count, table_start = int(model.behaviours[b, 5]), int(model.behaviours[b, 6])
        if model.behaviours[b, 4] == 0.0:
            corners = _corners(model.axes, axis_first, axis_end, x, y, z, cells, shares)
            entry = table_start + offset * cell_count
            for corner in range(corners):
                share = shares[corner] * factor
                if share != 0.0:
                    row = entry + cells[corner] * n
                    for k in range(n):
                        out[k] += share * model.table[row + k]
            continue
        term_first, term_end = int(model.behaviours[b, 2]), int(model.behaviours[b, 3])
        log_discount = math.log(model.behaviours[b, 8])
        for k in range(n):
            action = offset + k
            value = _reward(model, action, x, y, z, term_first, term_end, log_discount)
            dx, dz = x - model.moves[action, MOVE_X], z - model.moves[action, MOVE_Z]
            cos, sin = model.moves[action, MOVE_COS], model.moves[action, MOVE_SIN]
            later_x, later_z = dx * cos - dz * sin, dx * sin + dz * cos
            corners = _corners(model.axes, axis_first, axis_end, later_x, y, later_z, cells, shares)
            entry = table_start + model.actions[action, NEXT] * cell_count
            later = 0.0
            for corner in range(corners):
                later += shares[corner] * model.table[entry + cells[corner]]
            out[k] += factor * (value + math.exp(log_discount * model.actions[action, LENGTH]) * later)
    return n


@nb.njit(cache=True, nogil=True, error_model="numpy")
def advance(model, avatars, first, last, due):
    """Move avatars by one frame; list in ``due[first:]`` those whose action has ended.

    Returns how many those are, or -1 - i where avatar i stands nowhere (not a number).
    """
    whole, real = avatars.whole, avatars.real
    held = first
    for i in range(first, last):
        action = whole[ACTION, i]
        length = model.actions[action, LENGTH]
        real[PHASE_BEFORE, i] = min(real[PHASE, i], length)
        phase = real[PHASE, i] + real[SPEED, i]
        real[PHASE, i] = phase
        whole[ACTION_BEFORE, i] = -1
        place = model.actions[action, ORIGIN] + min(phase, length) * model.policies[whole[POLICY, i], STRIDE]
        gx, gz = _between(model.ground, place, 0), _between(model.ground, place, 1)
        cos, sin = real[BASE_COS, i], real[BASE_SIN, i]
        x = real[BASE_X, i] + gx * cos + gz * sin
        z = real[BASE_Z, i] - gx * sin + gz * cos
        heading = real[BASE_TURN, i] + _between(model.ground, place, 2)
        real[X, i], real[Z, i], real[HEADING, i] = x, z, heading
        if not math.isfinite(x + z + heading):
            return -1 - i
        if phase >= length:
            due[held] = i
            held += 1
    return held - first


@nb.njit(cache=True, nogil=True, error_model="numpy")
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


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _outside(arena, x, z):
    """Return how far a place lies outside the arena [m]; 0 inside."""
    if arena[0] == 1.0:
        dx, dz = x - arena[1], z - arena[2]
        return max(math.sqrt(dx * dx + dz * dz) - arena[3], 0.0)
    if arena[0] == 2.0:
        dx, dz = max(abs(x - arena[1]) - arena[3], 0.0), max(abs(z - arena[2]) - arena[4], 0.0)
        return math.sqrt(dx * dx + dz * dz)
    return 0.0


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _change_opponent(avatars, world, present, own, nearest):
    """Return the number of an avatar's opponent, or what stands for a target: the old one, unless another is nearer."""
    whole, real = avatars.whole, avatars.real
    skip = whole[SKIP, own]
    if skip == -2:
        return whole[FIXED, own]
    if nearest < 0:
        return -1
    old = whole[OPPONENT, own]
    if old >= 0:
        slot = avatars.slot_of[old]
        if slot < present and slot != own and whole[TEAM, slot] != skip:
            ax, az = real[X, slot] - real[X, own], real[Z, slot] - real[Z, own]
            bx, bz = real[X, nearest] - real[X, own], real[Z, nearest] - real[Z, own]
            near = world.moods[whole[MOOD, own], HYSTERESIS]
            if math.sqrt(bx * bx + bz * bz) >= math.sqrt(ax * ax + az * az) - near:
                return old
    return whole[NUMBER, nearest]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _crowd_out(model, avatars, world, own, offset, n, neighbours, row, count, values):
    """Lower the values of actions that end, or pass, inside a neighbour or outside the arena."""
    whole, real = avatars.whole, avatars.real
    end_cost, path_cost, disc, gap = world.crowding[0], world.crowding[1], world.crowding[2], world.crowding[3]
    arena_cost = world.crowding[4]
    x, z, scale = real[X, own], real[Z, own], real[SCALE, own]
    cos, sin = math.cos(real[HEADING, own]) * scale, math.sin(real[HEADING, own]) * scale
    old_length = model.actions[whole[ACTION, own], LENGTH]
    done = min(real[PHASE, own] - old_length, real[SPEED, own])
    for k in range(n):
        action = offset + k
        ex, ez = model.moves[action, MOVE_X], model.moves[action, MOVE_Z]
        mx, mz = ex * cos + ez * sin, ez * cos - ex * sin
        frames = max(model.actions[action, LENGTH] - done, 0.0) / real[SPEED, own]
        worst = 0.0
        for m in range(count):
            j = neighbours[row, m]
            left = (model.actions[whole[ACTION, j], LENGTH] - real[PHASE, j]) / real[SPEED, j]
            share = min(frames / left, 1.0) if left > 0.0 else 1.0
            ax, az = real[X, j] - x, real[Z, j] - z
            bx = ax + share * (real[END_X, j] - real[X, j]) - mx
            bz = az + share * (real[END_Z, j] - real[Z, j]) - mz
            room = disc * (scale + real[SCALE, j]) + gap
            at_end = bx * bx + bz * bz
            if at_end < room * room:
                worst = max(worst, end_cost * (1.0 - math.sqrt(at_end) / room))
            dx, dz = bx - ax, bz - az
            moved = dx * dx + dz * dz
            if moved > 0.0:
                # Where on their straight ways the two come nearest, seen from the avatar.
                t = min(max(-(ax * dx + az * dz) / moved, 0.0), 1.0)
                nx, nz = ax + t * dx, az + t * dz
                nearest = nx * nx + nz * nz
                if t > 0.0 and nearest < room * room:
                    worst = max(worst, path_cost * (1.0 - math.sqrt(nearest) / room))
        if world.arena[0] != 0.0:
            beyond = _outside(world.arena, x + mx, z + mz)
            worst += arena_cost * beyond
        values[k] -= worst


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _pick(values, n, margin, most, temperature, number):
    """Return one of the candidates: those near the best value, drawn by ``number`` in [0, 1); -1 for no number."""
    best = 0
    for k in range(1, n):
        if values[k] > values[best]:
            best = k
    if not math.isfinite(values[best]):
        return -1
    if temperature <= 0.0 or most <= 1 or n == 1:
        return best
    floor = values[best] - margin
    near = 0
    for k in range(n):
        near += values[k] >= floor
    while near > most:
        # One after another the least of too many candidates drops out, the later one among equals.
        least = -1
        for m in range(n):
            if values[m] >= floor and (least < 0 or values[m] <= values[least]):
                least = m
        values[least] = -math.inf
        near -= 1
    total = 0.0
    for k in range(n):
        if values[k] >= floor:
            total += math.exp((values[k] - values[best]) / temperature)
    wanted = number * total
    picked = best
    for k in range(n):
        if values[k] >= floor:
            picked = k
            wanted -= math.exp((values[k] - values[best]) / temperature)
            if wanted < 0.0:
                break
    return picked


@nb.njit(cache=True, nogil=True, error_model="numpy")
def choose(
    model, avatars, world, present, moment, due, first, last, nearest, counts, neighbours, cells, shares, values,
    out_chosen,
):  # fmt: skip
    """Choose an opponent and the next action for avatars ``due[first:last]``.

    ``nearest``, ``counts`` and ``neighbours`` are what was observed and run along with ``due``; ``moment`` is the row
    of ``world.targets`` for this frame; ``cells``, ``shares`` and ``values`` are scratch space. Writes the chosen
    actions along with ``due``. Returns -1, or the slot of an avatar whose values are no numbers.
    """
    whole, real = avatars.whole, avatars.real
    for q in range(first, last):
        own = due[q]
        opponent = _change_opponent(avatars, world, present, own, nearest[q])
        whole[OPPONENT_BEFORE, own] = whole[OPPONENT, own]
        whole[OPPONENT, own] = opponent
        x, z, heading, scale = real[X, own], real[Z, own], real[HEADING, own], real[SCALE, own]
        policy, mood = whole[POLICY, own], whole[MOOD, own]
        state = model.actions[whole[ACTION, own], NEXT]
        offset = model.offsets[state]
        seen = True
        tx, ty, tz = 0.0, 0.0, 0.0
        if opponent >= 0:
            j = avatars.slot_of[opponent]
            seen = j < present
            if seen:
                action = whole[ACTION, j]
                place = (
                    model.actions[action, ORIGIN]
                    + min(real[PHASE, j], model.actions[action, LENGTH]) * model.policies[whole[POLICY, j], STRIDE]
                )
                size = real[SCALE, j]
                hx, hz = _between(model.bodies, place, HEAD) * size, _between(model.bodies, place, HEAD + 2) * size
                ty = _between(model.bodies, place, HEAD + 1) * size
                cos, sin = math.cos(real[HEADING, j]), math.sin(real[HEADING, j])
                tx = real[X, j] + hx * cos + hz * sin
                tz = real[Z, j] - hx * sin + hz * cos
        elif opponent <= -2:
            target = -2 - opponent
            tx, ty, tz = (
                world.targets[moment, target, 0],
                world.targets[moment, target, 1],
                world.targets[moment, target, 2],
            )
        else:
            seen = False
        if world.arena[0] != 0.0 and _outside(world.arena, x, z) > world.crowding[5]:
            # Turn back: the middle counts until the avatar is inside again.
            tx, tz = world.arena[1], world.arena[2]
            ty = ty if seen else 1.5 * scale
            seen = True
        if seen:
            dx, dz = (tx - x) / scale, (tz - z) / scale
            cos, sin = math.cos(heading), math.sin(heading)
            n = value_actions(
                model, world.weights[mood], policy, state, dx * cos - dz * sin, ty / scale, dx * sin + dz * cos,
                cells, shares, values,
            )  # fmt: skip
        else:
            # Nobody to fight: captured motion keeps running.
            n = model.offsets[state + 1] - offset
            for k in range(n):
                values[k] = -model.moves[offset + k, COST]
        if counts[q] > 0 or world.arena[0] != 0.0:
            _crowd_out(model, avatars, world, own, offset, n, neighbours, q, counts[q], values)
        number = draw(world.stream[0], whole[NUMBER, own], whole[DECISIONS, own])
        picked = _pick(
            values, n, world.moods[mood, MARGIN], world.moods[mood, MOST], world.moods[mood, TEMPERATURE], number
        )
        if picked < 0:
            return own
        out_chosen[q] = offset + picked
    return -1


@nb.njit(cache=True, nogil=True, error_model="numpy")
def switch(model, avatars, due, chosen, first, last):
    """Start the chosen actions where the old ones have ended, with the motion that was left over."""
    whole, real = avatars.whole, avatars.real
    for q in range(first, last):
        i = due[q]
        old, new = whole[ACTION, i], chosen[q]
        stride, scale, speed = model.policies[whole[POLICY, i], STRIDE], real[SCALE, i], real[SPEED, i]
        phase = min(real[PHASE, i] - model.actions[old, LENGTH], speed)
        origin = model.actions[new, ORIGIN]
        x, z, heading = real[X, i], real[Z, i], real[HEADING, i]
        heading -= 2.0 * math.pi * math.floor(heading / (2.0 * math.pi) + 0.5)
        turn = heading - model.ground[origin, 2]
        cos, sin = math.cos(turn) * scale, math.sin(turn) * scale
        gx, gz = model.ground[origin, 0], model.ground[origin, 1]
        base_x, base_z = x - gx * cos - gz * sin, z + gx * sin - gz * cos
        real[BASE_X, i], real[BASE_Z, i] = base_x, base_z
        real[BASE_COS, i], real[BASE_SIN, i], real[BASE_TURN, i] = cos, sin, turn
        last_frame = origin + model.actions[new, LENGTH] * stride
        gx, gz = model.ground[last_frame, 0], model.ground[last_frame, 1]
        real[END_X, i], real[END_Z, i] = base_x + gx * cos + gz * sin, base_z - gx * sin + gz * cos
        if phase > 0.0:
            place = origin + min(phase, model.actions[new, LENGTH]) * stride
            gx, gz = _between(model.ground, place, 0), _between(model.ground, place, 1)
            x, z = base_x + gx * cos + gz * sin, base_z - gx * sin + gz * cos
            heading = turn + _between(model.ground, place, 2)
        real[X, i], real[Z, i], real[HEADING, i] = x, z, heading
        whole[ACTION_BEFORE, i] = old
        whole[ACTION, i] = new
        real[PHASE, i] = phase
        whole[DECISIONS, i] += 1


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _base_before(model, avatars, i):
    """Return where the action before the present one is based: x, z, cos, sin, turn."""
    whole, real = avatars.whole, avatars.real
    origin = model.actions[whole[ACTION, i], ORIGIN]
    gx, gz = model.ground[origin, 0], model.ground[origin, 1]
    cos, sin = real[BASE_COS, i], real[BASE_SIN, i]
    x = real[BASE_X, i] + gx * cos + gz * sin
    z = real[BASE_Z, i] - gx * sin + gz * cos
    old = whole[ACTION_BEFORE, i]
    end = model.actions[old, ORIGIN] + model.actions[old, LENGTH] * model.policies[whole[POLICY, i], STRIDE]
    turn = real[BASE_TURN, i] + model.ground[origin, 2] - model.ground[end, 2]
    cos, sin = math.cos(turn) * real[SCALE, i], math.sin(turn) * real[SCALE, i]
    gx, gz = model.ground[end, 0], model.ground[end, 1]
    return x - gx * cos - gz * sin, z + gx * sin - gz * cos, cos, sin, turn


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _surface_gap(model, avatars, world, moment, present, opponent, share, px, py, pz, sizes, scale):
    """Return how far a point is from the surface of an opponent's head or torso, ``share`` of the way to this frame."""
    whole, real = avatars.whole, avatars.real
    if opponent <= -2:
        target = -2 - opponent
        ax, ay, az = (
            world.targets[moment - 1, target, 0],
            world.targets[moment - 1, target, 1],
            world.targets[moment - 1, target, 2],
        )
        hx = ax + share * (world.targets[moment, target, 0] - ax)
        hy = ay + share * (world.targets[moment, target, 1] - ay)
        hz = az + share * (world.targets[moment, target, 2] - az)
        head_radius, torso_radius = sizes[0] * scale, sizes[1] * scale
        ux, uy, uz = hx, hy - sizes[2] * scale, hz
        lx, ly, lz = hx, hy - sizes[3] * scale, hz
    else:
        j = avatars.slot_of[opponent] if opponent >= 0 else present
        if j >= present:
            return math.inf
        action, phase = whole[ACTION, j], min(real[PHASE, j], model.actions[whole[ACTION, j], LENGTH])
        bx, bz, cos, sin = real[BASE_X, j], real[BASE_Z, j], real[BASE_COS, j], real[BASE_SIN, j]
        turn = real[BASE_TURN, j]
        if whole[ACTION_BEFORE, j] < 0:
            phase = real[PHASE_BEFORE, j] + share * (phase - real[PHASE_BEFORE, j])
        else:
            before = model.actions[whole[ACTION_BEFORE, j], LENGTH] - real[PHASE_BEFORE, j]
            moved = share * (before + phase)
            if moved < before:
                action = whole[ACTION_BEFORE, j]
                phase = real[PHASE_BEFORE, j] + moved
                bx, bz, cos, sin, turn = _base_before(model, avatars, j)
            else:
                phase = moved - before
        place = model.actions[action, ORIGIN] + phase * model.policies[whole[POLICY, j], STRIDE]
        gx, gz = _between(model.ground, place, 0), _between(model.ground, place, 1)
        x, z = bx + gx * cos + gz * sin, bz - gx * sin + gz * cos
        heading = turn + _between(model.ground, place, 2)
        size = real[SCALE, j]
        cos, sin = math.cos(heading) * size, math.sin(heading) * size
        gx, gz = _between(model.bodies, place, HEAD), _between(model.bodies, place, HEAD + 2)
        hx, hy, hz = x + gx * cos + gz * sin, _between(model.bodies, place, HEAD + 1) * size, z - gx * sin + gz * cos
        gx, gz = _between(model.bodies, place, NECK), _between(model.bodies, place, NECK + 2)
        ux, uy, uz = x + gx * cos + gz * sin, _between(model.bodies, place, NECK + 1) * size, z - gx * sin + gz * cos
        gx, gz = _between(model.bodies, place, PELVIS), _between(model.bodies, place, PELVIS + 2)
        lx, ly, lz = x + gx * cos + gz * sin, _between(model.bodies, place, PELVIS + 1) * size, z - gx * sin + gz * cos
        head_radius = model.sizes[whole[POLICY, j], 0] * size
        torso_radius = model.sizes[whole[POLICY, j], 1] * size
    gap = abs(math.sqrt((px - hx) ** 2 + (py - hy) ** 2 + (pz - hz) ** 2) - head_radius)
    dx, dy, dz = ux - lx, uy - ly, uz - lz
    square = dx * dx + dy * dy + dz * dz
    t = 0.0
    if square > 0.0:
        t = min(max(((px - lx) * dx + (py - ly) * dy + (pz - lz) * dz) / square, 0.0), 1.0)
    torso = math.sqrt((px - lx - t * dx) ** 2 + (py - ly - t * dy) ** 2 + (pz - lz - t * dz) ** 2)
    return min(gap, abs(torso - torso_radius))


@nb.njit(cache=True, nogil=True, error_model="numpy")
def strike(model, avatars, world, present, moment, frame, first, last, out_whole, out_real, held):
    """List the strikes that avatars have thrown on the way to this frame; return how many ``held`` and they are.

    Within a control frame motion runs evenly, through the end of an action where there is one; strikes and opponents
    are placed in between accordingly. Where ``out_whole`` and ``out_real`` have no room, strikes are only counted.
    """
    whole, real = avatars.whole, avatars.real
    for i in range(first, last):
        switched = whole[ACTION_BEFORE, i] >= 0
        before = whole[ACTION_BEFORE, i] if switched else whole[ACTION, i]
        now = whole[ACTION, i]
        if model.actions[before, STRIKES] == model.actions[before + 1, STRIKES] and (
            model.actions[now, STRIKES] == model.actions[now + 1, STRIKES]
        ):
            continue
        shown = min(real[PHASE, i], model.actions[now, LENGTH])
        rest = model.actions[before, LENGTH] - real[PHASE_BEFORE, i] if switched else 0.0
        motion = rest + shown if switched else shown - real[PHASE_BEFORE, i]
        scale = real[SCALE, i]
        sizes = model.sizes[whole[POLICY, i]]
        for part in range(2 if switched else 1):
            old = switched and part == 0
            action = before if old else now
            low = real[PHASE_BEFORE, i] if old or not switched else 0.0
            high = model.actions[before, LENGTH] if old else shown
            for k in range(model.actions[action, STRIKES], model.actions[action + 1, STRIKES]):
                time = np.float64(model.strikes[k, TIME])
                if not low < time <= high:
                    continue
                if old:
                    base_x, base_z, cos, sin, _ = _base_before(model, avatars, i)
                else:
                    base_x, base_z = real[BASE_X, i], real[BASE_Z, i]
                    cos, sin = real[BASE_COS, i], real[BASE_SIN, i]
                origin = model.actions[action, ORIGIN]
                gx, gz, gh = model.ground[origin, 0], model.ground[origin, 1], model.ground[origin, 2]
                wx, wz = math.cos(gh), math.sin(gh)
                fx, fz = model.strikes[k, FIST_X], model.strikes[k, FIST_Z]
                gx, gz = gx + fx * wx + fz * wz, gz - fx * wz + fz * wx
                px, pz = base_x + gx * cos + gz * sin, base_z - gx * sin + gz * cos
                py = model.strikes[k, FIST_Y] * scale
                share = (time - low + (0.0 if old or not switched else rest)) / motion
                opponent = whole[OPPONENT_BEFORE, i] if old else whole[OPPONENT, i]
                gap = _surface_gap(model, avatars, world, moment, present, opponent, share, px, py, pz, sizes, scale)
                if held < out_whole.shape[0]:
                    out_whole[held, 0] = whole[NUMBER, i]
                    out_whole[held, 1] = opponent
                    out_whole[held, 2] = model.strikes[k, HAND]
                    out_whole[held, 3] = 1 if gap <= sizes[4] * scale else 0
                    out_real[held, 0] = frame - 1.0 + share
                    out_real[held, 1], out_real[held, 2], out_real[held, 3] = px, py, pz
                    out_real[held, 4] = model.strikes[k, FIST_SPEED] * scale * real[SPEED, i]
                held += 1
    return held


@nb.njit(cache=True, nogil=True, error_model="numpy")
def write_record(model, avatars, record, row, first, last):
    """Write what the take keeps of avatars ``first`` to ``last`` into a row of the record, by number."""
    whole, real = avatars.whole, avatars.real
    for i in range(first, last):
        n = whole[NUMBER, i]
        action = whole[ACTION, i]
        heading = real[HEADING, i]
        record.whole[0, row, n] = action - model.policies[whole[POLICY, i], ACTIONS]
        record.real[0, row, n] = min(real[PHASE, i], model.actions[action, LENGTH])
        record.real[1, row, n] = real[X, i]
        record.real[2, row, n] = real[Z, i]
        record.real[3, row, n] = heading - 2.0 * math.pi * math.floor(heading / (2.0 * math.pi) + 0.5)
        record.whole[1, row, n] = whole[OPPONENT, i]


@nb.njit(cache=True, nogil=True, error_model="numpy")
def run_frames(model, avatars, world, present, frame, count, fresh, reach, most_near, record, strikes, timings, fault):
    """Run ``count`` control frames from ``frame`` on for a small crowd, and record them.

    ``fresh``: the first frame only decides, since nothing has moved yet. ``timings`` (count, 6) takes the time of
    index, observe, choose, advance, strikes and record [ns]; with None no clock is read. ``fault`` takes the frame and
    slot of an avatar that got lost. Returns the frames done, which are fewer where room for strikes may not last, and
    the number of strikes.
    """
    due, hits = np.empty(present, np.int32), np.empty(present, np.int64)
    nearest, counts = np.empty(present, np.int32), np.empty(present, np.int32)
    chosen = np.empty(present, np.int32)
    neighbours = np.empty((present, most_near), np.int32)
    distances = np.empty(present)
    cells, shares, values = np.empty(256, np.int64), np.empty(256), np.empty(4096)
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
            dues = advance(model, avatars, 0, present, due)
            if dues < 0:
                fault[0], fault[1] = frame + k, -1 - dues
                return k, held
        if timings is not None:
            times[1] = _now(clock)
        observe_all(avatars, present, due, 0, dues, reach, distances, hits, nearest, counts, neighbours)
        if timings is not None:
            times[2] = _now(clock)
        lost = choose(
            model,
            avatars,
            world,
            present,
            k + 1,
            due,
            0,
            dues,
            nearest,
            counts,
            neighbours,
            cells,
            shares,
            values,
            chosen,
        )
        if lost >= 0:
            fault[0], fault[1] = frame + k, lost
            return k, held
        if timings is not None:
            times[3] = _now(clock)
        switch(model, avatars, due, chosen, 0, dues)
        if timings is not None:
            times[4] = _now(clock)
        held = strike(model, avatars, world, present, k + 1, frame + k, 0, present, strikes.whole, strikes.real, held)
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
