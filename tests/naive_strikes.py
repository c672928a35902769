"""Strikes, slow and plain: when avatars of ``naive_crowd`` throw them, and what becomes of each."""

import itertools
import math

import naive_ground as ground
import numpy as np
from naive_policy import comes_through

from crowdsim.crowd.kernels.guards import STEPS
from crowdsim.crowd.kernels.layout import BLOCKED, EVADED, LANDED, MISSED
from crowdsim.crowd.model import TOLERANCE
from crowdsim.motion import quaternion
from crowdsim.motion.body import PARTS
from crowdsim.motion.strikes import LIMBS


def at(rows, place):
    """Row of an array at a fractional place."""
    below = int(place)
    if place == below:
        return np.asarray(rows[below], float)
    return np.asarray(rows[below], float) + (place - below) * (np.asarray(rows[below + 1], float) - rows[below])


def what_is_seen(one, opponent, avatars, targets):
    """Head and torso of an opponent as they are now."""
    if opponent <= -2:
        return ball(one, targets[1, -2 - opponent])
    if opponent < 0:
        return None
    other = avatars[opponent]
    return trunk(other, other.action, min(other.phase, other.length), other.start)


def thrown(one, avatars, frame, targets):
    """Strikes of one avatar since the frame before."""
    parts = [(one.action, one.phase_before, min(one.phase, one.length), one.start, one.opponent, 0.0)]
    motion = parts[0][2] - parts[0][1]
    if one.decided:
        rest = float(one.policy.actions.lengths[one.action_before]) - one.phase_before
        old = (one.action_before, one.phase_before, one.phase_before + rest, one.start_before, one.opponent_before, 0.0)
        parts = [old, (one.action, 0.0, min(one.phase, one.length), one.start, one.opponent, rest)]
        motion = rest + parts[1][2]
    found = []
    database, actions = one.policy.database, one.policy.actions
    tolerance = tolerance_of(one.policy)
    for place, (action, low, high, start, opponent, passed) in enumerate(parts):
        seen = one.seen_before if place == 0 and one.decided else one.seen
        for k in range(actions.strike_offsets[action], actions.strike_offsets[action + 1]):
            time, strike = float(actions.strike_times[k]), actions.strike_ids[k]
            if not low < time <= high:
                continue
            share = (time - low + passed) / motion
            point = ground.to_world(start, actions.strike_positions[k] * one.scale)
            gap, neck = surface_gap(one, avatars, opponent, share, point, targets)
            from_x, from_z = actions.strike_origins[k] * one.scale
            origin = ground.to_world(start, np.array([from_x, 0.0, from_z]))[[0, 2]]
            speed = float(database.strike_speeds[strike]) * one.scale * one.speed
            outcome = MISSED
            if abs(gap) <= tolerance * one.scale and not comes_through(point, origin, neck):
                way = [ground.to_world(start, p * one.scale) for p in way_of(one.policy, action, k)]
                met = meets_guard([*way, point], avatars[opponent], share) if opponent >= 0 else None
                outcome, point = (LANDED, point) if met is None else (BLOCKED, met)
            elif seen is not None:
                gap_then, neck_then = gap_to(point, *seen)
                if abs(gap_then) <= tolerance * one.scale and not comes_through(point, origin, neck_then):
                    outcome = EVADED
            found.append(
                (
                    frame - 1 + share,
                    one.number,
                    opponent,
                    int(database.strike_limbs[strike]),
                    *point,
                    speed,
                    outcome,
                    gap,
                )
            )
    return found


def surface_gap(one, avatars, opponent, share, point, targets):
    """Signed distance of a point from whom it strikes, and the neck of that one.

    Head and torso are one body, inside of which the distance is negative.
    """
    if opponent == -1:
        return math.inf, np.zeros(3)
    if opponent <= -2:
        head = targets[0, -2 - opponent] + share * (targets[1, -2 - opponent] - targets[0, -2 - opponent])
        return gap_to(point, *ball(one, head))
    other = avatars[opponent]
    return gap_to(point, *trunk(other, *other.meanwhile(share)))


def ball(one, centre):
    """Points and sizes of a scripted target: a ball as large as the head of the avatar that strikes it."""
    return centre, centre, centre, one.policy.body.head_radius * one.scale, 0.0


def tolerance_of(policy):
    """How far from a surface strikes of a policy land [m]."""
    return max([t.tolerance for b in policy.behaviours for t in b.terms if hasattr(t, "tolerance")] or [TOLERANCE])


def trunk(other, action, phase, start):
    """Points and sizes of head and torso of an avatar."""
    points = (other.body(name, action, phase, start) for name in ("heads", "necks", "pelvises"))
    return (*points, other.policy.body.head_radius * other.scale, other.policy.body.torso_radius * other.width)


def gap_to(point, head, neck, pelvis, head_radius, torso_radius):
    """Signed distance of a point from the surface of head and torso, and the neck."""
    torso = from_line(point, neck, pelvis) - torso_radius
    return min(float(np.linalg.norm(point - head)) - head_radius, torso), neck


def from_line(point, start, end):
    """Distance of a point from the line between two others."""
    axis = end - start
    t = min(max(float((point - start) @ axis) / max(float(axis @ axis), 1e-12), 0.0), 1.0)
    return float(np.linalg.norm(point - start - t * axis))


def limb_at(policy, frame, role, offset):
    """Position of a point of a joint in the clip's world, by walking up from the joint to the root."""
    database, joint = policy.database, policy.database.body.roles[role]
    parents, rotations = database.skeleton.parents, database.rotations[frame].astype(float)
    point = np.asarray(offset, float)
    while True:
        point = quaternion.rotate(rotations[joint], point)
        if parents[joint] < 0:
            return point + database.root_positions[frame]
        point, joint = point + database.skeleton.offsets[joint], int(parents[joint])


def way_of(policy, action, k):
    """Where fist or foot is 0.1 s and 0.05 s before a strike, seen from the action's start."""
    database, strike = policy.database, policy.actions.strike_ids[k]
    at, limb = int(database.strike_frames[strike]), int(database.strike_limbs[strike])
    clip = max(int(start) * database.stride for start in database.clip_starts if start * database.stride <= at)
    body, role = database.body, LIMBS[limb]
    offset = [*body.fist_offsets, *body.foot_offsets][limb]
    first = database.stride * (int(policy.graph.action_first[action]) - 1)
    from_start = ground.compose(policy.actions.shifts[action], ground.inverse(database.ground[first]))
    frames = [max(at - round(before * database.playback_rate), clip) for before in (0.1, 0.05)]
    return [ground.to_world(from_start, limb_at(policy, frame, role, offset)) for frame in frames]


def meets_guard(way, other, share):
    """Where a strike on its way meets forearm or glove of an avatar before it is in head or torso, or None."""
    action, phase, start = other.meanwhile(share)
    policy, database, place = other.policy, other.policy.database, other.place(action, phase)
    stands = ground.compose(start, other.displacement(action, phase))

    def elbow(side, frame):
        return ground.to_local(database.ground[frame], limb_at(policy, frame, f"{side}_elbow", np.zeros(3)))

    arms = []
    for number, side in enumerate(("left", "right")):
        local = (at({f: elbow(side, f) for f in (int(place), int(place) + 1) if f < len(database.ground)}, place),
                 at(database.fists[:, number], place))  # fmt: skip
        arms.append([ground.to_world(stands, point * other.scale) for point in local])
    body, head = database.body, trunk(other, action, phase, start)
    elbows = [body.roles[f"{side}_elbow"] for side in ("left", "right")]
    forearm = np.mean([r for r, j in zip(body.capsule_radii, body.capsule_joints, strict=True) if j in elbows])
    glove = np.max([r for r, p in zip(body.capsule_radii, body.capsule_parts, strict=True) if PARTS[p] == "glove"])
    for here, there in itertools.pairwise(way):
        for step in range(1, STEPS + 1):
            point = here + step / STEPS * (there - here)
            for hinge, fist in arms:
                if from_line(point, hinge, fist) <= forearm * other.width:
                    return point
                if np.linalg.norm(point - fist) <= glove * other.scale:
                    return point
            if gap_to(point, *head)[0] <= 0:
                return None
    return None
