"""Compiled search for the times over which feet are planted, through transitions."""

import math

from crowdsim.core.easing import minimum_jerk
from crowdsim.jit import kernel
from crowdsim.poses.kernels.columns import BEGIN, END
from crowdsim.poses.kernels.placement import SNAP

SHORT = 0.11
"""Time between two foot plants with a transition between them that is too short for a swing [s]."""
_EASE = 0.08
"""How long after a foot has lifted off, and before it lands, it is wholly free [s]."""


@kernel
def _piece(rows, row, n, began, later):
    """Return what an avatar plays in a part of a control frame.

    ``later`` is 1 for what comes after the start of an action at share ``began`` of the frame, 0 for what comes before.

    Returns:
        Playback frame of the action's start, control frames of it that are done, and the shares of the control frame
        at which the piece begins and ends.
    """
    if later == 0:
        return rows.origins[row, n], rows.phase[row, n], 0.0, began
    return rows.origins[row + 1, n], 0.0, began, 1.0


@kernel
def _follow_foot(rows, motion, n, foot, spans):
    """Write beginnings and ends of the plants of one foot, and return how many there are."""
    speed, stride, most = rows.speeds[n], motion.stride, spans.shape[0]
    count, standing, last = 0, False, -math.inf
    for r in range(rows.phase.shape[0] - 1):
        if not rows.present[r, n]:
            standing = False
            continue
        starts = rows.fresh[r + 1, n] and rows.present[r + 1, n]
        began = 1.0 - rows.phase[r + 1, n] / speed if starts else 1.0
        if starts:
            last = (rows.first + r + began) / rows.rate
        for later in range(2 if starts else 1):
            origin, phase, low, high = _piece(rows, r, n, began, later)
            begin = origin + phase * stride
            end = origin + min(phase + (high - low) * speed, rows.lengths[r + later, n]) * stride
            frame = math.floor(begin + SNAP)
            while frame < end - SNAP:
                planted = motion.contacts[frame, foot] and motion.contacts[frame + 1, foot]
                if planted != standing:
                    share = low + max(frame - begin, 0.0) / (speed * stride)
                    time = (rows.first + r + share) / rows.rate
                    hops = count > 0 and last > spans[max(count - 1, 0), END] - 1e-6
                    hops = hops and time - spans[max(count - 1, 0), END] < SHORT
                    if planted and count < most and not hops:
                        spans[count, BEGIN] = time
                        count += 1
                    standing = planted
                if planted:
                    share = min(low + (min(frame + 1.0, end) - begin) / (speed * stride), high)
                    spans[count - 1, END] = (rows.first + r + share) / rows.rate
                frame += 1
    return count


@kernel
def find_foot_plants(first, stop, rows, motion, plants):
    """Find when the feet of avatars are planted.

    A foot that leaves the floor before a transition and is down again right after it is planted all along.

    Args:
        first: First column.
        stop: One past the last.
        rows: The control frames, a ``Rows``.
        motion: The playback frames, a ``motion.Frames``.
        plants: Written, a ``FootPlants``.
    """
    for n in range(first, stop):
        for foot in range(2):
            plants.counts[n, foot] = _follow_foot(rows, motion, n, foot, plants.spans[n, foot])


@kernel
def foot_freedom(plants, n, foot, at, time):
    """Return how free a foot is to move, 0 while it is planted and 1 in the air, and the first plant that is not over.

    Args:
        plants: A ``FootPlants``.
        n: Column of the avatar.
        foot: 0 left, 1 right.
        at: A plant before which all are over.
        time: The time [s].
    """
    count, spans, apart = plants.counts[n, foot], plants.spans[n, foot], math.inf
    while at < count and spans[at, END] < time:
        at += 1
    if at > 0:
        apart = time - spans[at - 1, END]
    if at < count:
        apart = min(apart, spans[at, BEGIN] - time)
    return minimum_jerk(apart / _EASE), at


@kernel
def free_feet(first, stop, moments, plants, freedom):
    """Write how free the feet of avatars are to move.

    Args:
        first: First of the moments' avatars.
        stop: One past the last.
        moments: Who and when, a ``Moments``.
        plants: A ``FootPlants``.
        freedom: Written, from 0 to 1. Shape (T, n, 2).
    """
    times, shared = moments.times, moments.times.shape[1] == 1
    for i in range(first, stop):
        for foot in range(2):
            at = 0
            for t in range(times.shape[0]):
                found, at = foot_freedom(plants, moments.columns[i], foot, at, times[t, 0 if shared else i])
                freedom[t, i, foot] = found
