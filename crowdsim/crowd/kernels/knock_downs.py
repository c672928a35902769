"""Knock-downs: an avatar leaves what it is doing at the blow, throws nothing any more, and falls."""

import math
from typing import Any, NamedTuple

import numpy as np

from crowdsim.crowd.kernels.advance import start_action
from crowdsim.crowd.kernels.bases import base_at
from crowdsim.crowd.kernels.confinement import confine
from crowdsim.crowd.kernels.fall_clearance import slide
from crowdsim.crowd.kernels.falling import SHOWN, note_fall, pick_fall, shown_anywhere, shown_before
from crowdsim.crowd.kernels.interpolation import ground_at
from crowdsim.crowd.kernels.kd_queries import Query, gather
from crowdsim.crowd.kernels.kd_tree import widen
from crowdsim.crowd.kernels.layout import DROPS, FALLING, FALLS
from crowdsim.crowd.kernels.positions import position_of
from crowdsim.jit import kernel


class Room(NamedTuple):
    """Scratch space of knock-downs.

    Attributes:
        shown: What it costs one avatar to fall as others have fallen. Shape (rows of ``Model.falls``,).
        anywhere: The same without those near it. Likewise.
        stack: Nodes of a tree. Shape (64,), int64.
        distances: Of neighbours. Shape (as many as are observed at most,).
    """

    shown: Any
    anywhere: Any
    stack: Any
    distances: Any


@kernel(allocates=True)
def empty_room(model, most):
    """Return scratch space of knock-downs among avatars that observe ``most`` neighbours."""
    falls = model.falls.shape[0]
    return Room(np.empty(falls), np.empty(falls), np.empty(64, np.int64), np.empty(most))


@kernel
def knock_down(model, avatars, world, now, strikes, first, last, tree, observed, room):
    """Let avatars fall that strikes ``first`` to ``last`` have knocked down, from the blow on, by their numbers.

    ``tree`` is fitted to where avatars are, and is kept so; ``observed`` and ``room`` are scratch space.
    """
    number, reach = -1, world.crowding.sight
    shown, anywhere, stack, distances = room
    shown_anywhere(model, avatars, now.frame, anywhere)
    while True:
        blow = _next_blow(strikes, first, last, number)
        if blow < 0:
            return
        number, hit, by = np.int64(strikes[blow].victim), strikes[blow].frame, strikes[blow].attacker
        own = np.int64(avatars.slot_of[number])
        if avatars.conditions[number].standing != DROPS:
            continue
        avatars.conditions[by].felled, avatars.conditions[by].felled_frame = number + 1.0, now.frame
        left = leave_action(model, avatars, now.frame, own, hit)
        x, z = position_of(avatars, own)
        around = Query(x, z, own, -1)
        observed.counts[0] = gather(tree, around, reach * reach, observed.neighbours[0], distances, stack)
        shown_before(model, avatars, now.frame, own, tree, anywhere, stack, shown)
        row = pick_fall(model, avatars, world, now.frame, own, FALLS, 0.0, left[1], shown, observed, 0)
        condition = avatars.conditions[number]
        condition.fall, condition.standing_next, condition.piece = row, FALLING, 0.0
        note_fall(model, avatars, now.frame, number, SHOWN, -1.0, anywhere)
        condition.fell, condition.fell_frame = row + 1.0, now.frame
        note_fall(model, avatars, now.frame, number, SHOWN, 1.0, anywhere)
        slide(model, avatars, world, now.frame, own, row, observed, 0)
        start_action(model, avatars, world, now.frame, own, np.int64(model.falls[row].action), left[0])
        avatars.playback[own].pending = model.actions[avatars.motion[own].action].first_strike
        avatars.playback[own].action_before, avatars.playback[own].phase_before = -1, left[0]
        avatars.opponent[own] = avatars.fight[own].next_opponent = -1
        avatars.fight[own].decisions += 1
        if world.places.parts.shape[0] > 0:
            confine(model, avatars, world, now.frame, own)
        widen(tree, own)


@kernel(inline=True)
def _next_blow(strikes, first, last, number):
    """Return the strike that has knocked down the avatar with the next number, or -1."""
    found = -1
    for k in range(first, last):
        felled = strikes[k].down > 0 and strikes[k].victim > number
        if felled and (found < 0 or strikes[k].victim < strikes[found].victim):
            found = k
    return found


@kernel(inline=True)
def leave_action(model, avatars, frame, i, hit):
    """Put an avatar where it was at a blow, at a whole playback frame of its action.

    Returns the frames of motion from there to the end of this control frame, and the playback frame.
    """
    motion, playback = avatars.motion, avatars.playback
    action, stride = motion[i].action, model.policies[avatars.policy[i]].stride
    origin, length = model.actions[action].origin, np.float64(model.actions[action].length)
    shown = min(motion[i].phase, length)
    before = math.ceil(max(shown - (frame - hit) * motion[i].speed, 0.0) * stride - 1e-6)
    before = min(before, math.floor(shown * stride + 1e-6))
    gx, gz, turned = ground_at(model.ground, np.float64(origin + before))
    if playback[i].action_before >= 0:
        # The action began after the last control frame, and is not seen: the fall follows the one before.
        before = 0
        gx, gz, turned = model.starts[action].x, model.starts[action].z, model.starts[action].heading
    x, z, cos, sin = base_at(model, avatars, i)
    avatars.x[i], avatars.z[i] = x + gx * cos + gz * sin, z - gx * sin + gz * cos
    avatars.heading[i] = playback[i].base_turn + turned
    return min(max(shown - before / stride, 0.0), motion[i].speed), np.int64(origin + before)
