"""Compiled hit reactions: a blow turns spine, neck and head, pushes the pelvis, and they spring back.

Each is a critically damped mass on a spring that a soft push sets in motion: of x'' + 2 w x' + w^2 x = f, with a push f
in proportion to t exp(-w t), the solution is in proportion to t^3 exp(-w t), which is greatest after 3 / w.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdsim.core.easing import minimum_jerk
from crowdsim.core.quaternions import multiply, rotate_by_vector, unrotate
from crowdsim.jit import kernel
from crowdsim.poses.kernels.columns import HEAD, LOWER, TORSO
from crowdsim.poses.kernels.fists import move_over_feet, point_arm
from crowdsim.poses.kernels.limbs import World, pose_chain

LENGTH, FADES = 0.85, 0.45
"""How long a reaction lasts, and for how long it is that of the spring alone [s]."""
RISE = 0.24
"""Time from a blow to its highest [s]; as smooth as it is, heads turn no more suddenly than in captured motion."""
QUICK = 2.0
"""How much sooner a hand that a blow pushes is furthest, and at rest."""
SHARE, MORE = 0.3, 0.15
"""Share of its reach that a blow keeps at the least where the victim's own motion already brings it there, and how much
more it is given at the most where that comes against it [m]."""
ROUNDS = 2
"""Rounds in which blows are strengthened."""


class Blows(NamedTuple):
    """Strikes that landed on avatars of a window, by victim's column and time; E strikes of n avatars.

    Attributes:
        starts: Those on column i are ``starts[i]`` up to ``starts[i + 1]``. Shape (n + 1,).
        times: When [s]. Shape (E,).
        axes: What they turn spine, neck and head by, of ``Trunk.gives``. Shape (E, 3).
        parts: ``HEAD`` or ``TORSO``, which was hit. Shape (E,).
        pushes: How far they push the pelvis [m]. Shape (E, 3).
        gloves: How far they push the left and the right hand, of those that an arm stops [m]. Shape (E, 2, 3).
    """

    starts: NDArray[np.int64]
    times: NDArray[np.float64]
    axes: NDArray[np.float64]
    parts: NDArray[np.int64]
    pushes: NDArray[np.float64]
    gloves: NDArray[np.float64]


class Trunk(NamedTuple):
    """Joints from the root to the head of a body.

    Attributes:
        parents: Parent of each joint of the skeleton. Shape (J,).
        chain: The joints, parents first. Shape (n,).
        gives: How far each gives way in a blow to head and torso [rad]. Shape (n, 2).
        limits: How far blows turn each at the most [rad]. Shape (n,).
        gains: How far that brings the head, of a blow to the torso the neck, about, in a body of scale 1 [m].
            Shape (2,).
    """

    parents: NDArray[np.int64]
    chain: NDArray[np.int64]
    gives: NDArray[np.float64]
    limits: NDArray[np.float64]
    gains: NDArray[np.float64]


@kernel
def _response(since):
    """Return the response to a blow: 1 after ``RISE``, at rest after ``LENGTH``."""
    part = since / RISE
    return part**3 * math.exp(3.0 - 3.0 * part) * (1.0 - minimum_jerk((since - FADES) / (LENGTH - FADES)))


@kernel(allocates=True)
def strengthen(blows, gains, own, rooms):
    """Return how far each blow turns its victim: so far that head or neck come as far as the blow alone brings them.

    With those before it, it brings them no further than there is room.

    A victim may be on its way towards the attacker, or springing back from blows before. Those count as strong as they
    are themselves, or, in the first of ``ROUNDS``, as if nothing had been before them: so that a blow depends on no
    others than those of ``ROUNDS`` times ``LENGTH`` before it.

    Args:
        blows: The ``Blows``.
        gains: How far each brings head or neck with a level axis of length 1 [m]; 0 of those that stay as they are.
            Shape (E,).
        own: How far the victim's motion brings it the same way in ``RISE`` seconds [m]. Shape (E,).
        rooms: How far all blows bring it the same way at the most, inf for any way [m]. Shape (E,).

    Returns:
        Their axes. Shape (E, 3).
    """
    axes, stronger = blows.axes.copy(), blows.axes.copy()
    for _ in range(ROUNDS):
        for n in range(len(blows.starts) - 1):
            for blow in range(blows.starts[n], blows.starts[n + 1]):
                x, z = blows.axes[blow, 0], blows.axes[blow, 2]
                strength = math.sqrt(x * x + z * z)
                if strength == 0.0 or gains[blow] == 0.0:
                    continue
                expected, there = own[blow], 0.0
                for before in range(blows.starts[n], blow):
                    since = blows.times[blow] - blows.times[before]
                    if since < LENGTH:
                        brought = (x * axes[before, 0] + z * axes[before, 2]) * gains[before] / strength
                        expected += (_response(since + RISE) - _response(since)) * brought
                        there += _response(max(since, RISE)) * max(brought, 0.0)
                far = strength * gains[blow]
                wanted = min(max(far - expected, SHARE * far), far + MORE)
                wanted = min(wanted, max(rooms[blow] - there, 0.0))
                for k in range(3):
                    stronger[blow, k] = blows.axes[blow, k] * wanted / far
        axes[:] = stronger
    return axes


@kernel
def _sum_blows(blows, n, time, recent, spin, push, gloves):
    """Write what all blows at a time turn head and torso by, and push pelvis and hands; return if there are any."""
    active = False
    spin[:] = 0.0
    push[:] = 0.0
    gloves[:] = 0.0
    for blow in range(blows.starts[n], blows.starts[n + 1]):
        since = time - blows.times[blow]
        if 0.0 < since < min(LENGTH, recent):
            active = True
            response, quick = _response(since), _response(QUICK * since)
            for k in range(3):
                for hand in range(2):
                    gloves[hand, k] += quick * blows.gloves[blow, hand, k]
                spin[blows.parts[blow], k] += response * blows.axes[blow, k]
                push[k] += response * blows.pushes[blow, k]
    return active


@kernel
def _turn_trunk(trunk, pose, spin, rotations):
    """Turn the joints of a trunk in the world, each by its share of what head and torso turn, up to its limit."""
    for at in range(trunk.chain.shape[0]):
        j = trunk.chain[at]
        head, torso, p = trunk.gives[at, HEAD], trunk.gives[at, TORSO], trunk.parents[j]
        if p >= 0 and head + torso > 0.0:
            x = head * spin[HEAD, 0] + torso * spin[TORSO, 0]
            y = head * spin[HEAD, 1] + torso * spin[TORSO, 1]
            z = head * spin[HEAD, 2] + torso * spin[TORSO, 2]
            square = (x * x + y * y + z * z) / trunk.limits[at] ** 2
            kept = 1.0 / math.sqrt(math.sqrt(1.0 + square * square))
            x, y, z = unrotate(rotations[p], kept * x, kept * y, kept * z)
            rotate_by_vector(pose[j], x, y, z)
        q = rotations[j]
        if p < 0:
            for k in range(4):
                q[k] = pose[j, k]
        else:
            q[0], q[1], q[2], q[3] = multiply(rotations[p], pose[j])


@kernel
def _push_hands(arms, sizes, root, pose, world, gloves):
    """Move the wrists of a pose."""
    for hand in range(2):
        if gloves[hand].any():
            pose_chain(arms, sizes, root, pose, world)
            wrist = world.positions[arms.joints[hand, LOWER]]
            target = wrist[0] + gloves[hand, 0], wrist[1] + gloves[hand, 1], wrist[2] + gloves[hand, 2]
            point_arm(arms, hand, pose, world, target)


@kernel(allocates=True)
def show_reactions(first, stop, moments, blows, trunk, arms, legs, sizes, recent, poses):
    """Add reactions to poses, in place.

    Args:
        first: First of the moments' avatars.
        stop: One past the last.
        moments: Who and when, a ``Moments``.
        blows: A ``Blows``.
        trunk: A ``Trunk``.
        arms: A ``motion.Limbs``.
        legs: Likewise.
        sizes: Sizes of bones by column, see ``Rows``. Shape (n, 3).
        recent: Time after which a blow is left out [s].
        poses: Changed, a ``Posed``.
    """
    joints, times = trunk.parents.shape[0], moments.times
    world = World(np.empty((joints, 3)), np.empty((joints, 4)))
    spin, push, gloves, ankles = np.empty((2, 3)), np.empty(3), np.empty((2, 3)), np.empty((2, 3))
    shared = times.shape[1] == 1
    for i in range(first, stop):
        n = moments.columns[i]
        for t in range(times.shape[0]):
            time = times[t, 0 if shared else i]
            root, pose = poses.roots[t, i], poses.rotations[t, i]
            if not math.isfinite(root[0]) or not _sum_blows(blows, n, time, recent, spin, push, gloves):
                continue
            move_over_feet(legs, sizes[n], root, pose, world, push, ankles)
            _turn_trunk(trunk, pose, spin, world.rotations)
            _push_hands(arms, sizes[n], root, pose, world, gloves)
