"""Windows of motion around transitions: as avatars make them, one at a time, by plain methods, and as captured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from crowdsim.core.types import Array
from crowdsim.graph.motion_graph import MotionGraph
from crowdsim.motion import ground, quaternion
from crowdsim.motion.database import MotionDatabase
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.policy.alignment import align_transitions
from crowdsim.policy.policy import Policy
from crowdsim.policy.rewards import target_body
from crowdsim.poses.sampler import PoseSampler
from crowdsim.take.take import Cast, Events, Take

APART = 0.5
"""Time within which no other transition lies where one counts as apart [s]."""
FADE = 12
"""Playback frames of a cross-fade on either side of the transition."""
ROWS = 15
"""Control frames of motion before and after a transition."""


def inside(database: MotionDatabase, frames: Array, rows: int) -> Array:
    """Whether control frames have captured motion around them."""
    starts = np.asarray(database.clip_starts)
    clip = np.searchsorted(starts, frames, side="right") - 1
    return np.asarray((frames - rows - 1 >= starts[clip]) & (frames + rows + 1 < starts[clip + 1]))


def usable(database: MotionDatabase, graph: MotionGraph, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return control frames before and after some transitions that have motion around them: left, and landed on."""
    leave, enter = np.asarray(graph.transition_from), np.asarray(graph.transition_to) - 1
    fits = np.flatnonzero(inside(database, leave, ROWS) & inside(database, enter, ROWS))
    fits = rng.permutation(fits)[:count]
    return leave[fits], enter[fits]


def without_strikes(take: Take, policy: Policy) -> PoseSampler:
    """Poses of a take without what strikes do."""
    none = Events(*(getattr(take.events, name)[:0] for name in Events.__dataclass_fields__))
    return PoseSampler(replace(take, events=none), [policy], threads=2)


def made(
    sampler: PoseSampler,
    half: int,
    most: int,
    rng: np.random.Generator,
    counts: Callable[[Array, Array], Array] | None = None,
) -> tuple[Array, Array, Array, Array]:
    """Control frames left and entered by transitions, joint positions around them (n, T, roles, 3), which are apart.

    Args:
        sampler: Poses of the run.
        half: Playback frames of a window before and after the transition.
        most: Most transitions.
        rng: Where they are drawn from.
        counts: Which transitions count, by the playback frames that they leave and enter; all when None.
    """
    database, take = sampler.policies[0].database, sampler.take
    rate, stride = database.playback_rate, database.stride
    numbers = np.arange(take.avatar_count)
    window = sampler.window(0, numbers, np.array([0.0, take.seconds]))
    transitions = window.transitions
    leave, enter, centre = (
        transitions.before // stride,
        transitions.after // stride,
        np.round(transitions.times * rate).astype(int),
    )
    reach, last = half + 1, take.output_frames(rate) - 1
    rows = -(-reach // stride)
    fits = inside(database, leave, rows) & inside(database, enter, rows)
    fits &= (centre >= rate) & (centre < last - rate)
    if counts is not None:
        fits &= counts(transitions.before, transitions.after)
    gaps = np.where(transitions.owners[1:] == transitions.owners[:-1], np.diff(transitions.times), np.inf)
    apart = np.minimum(np.concatenate([[np.inf], gaps]), np.concatenate([gaps, [np.inf]])) > APART
    chosen = np.sort(rng.permutation(np.flatnonzero(fits))[:most])
    positions = []
    for transition in chosen:
        poses = sampler.sample(
            centre[transition] - reach, centre[transition] + reach + 1, rate, numbers[[transitions.owners[transition]]]
        )[0]
        base = transitions.ground[transition]
        rotations = np.array(poses.rotations[:, 0], dtype=float)
        rotations[:, 0] = quaternion.multiply(quaternion.about_y(-base[2]), rotations[:, 0])
        roots = ground.to_local(base, np.asarray(poses.root_positions[:, 0], dtype=float))
        positions.append(joints(database, roots[None], rotations[None])[0])
    return leave[chosen], enter[chosen], np.stack(positions), apart[chosen]


def take_of_transitions(database: MotionDatabase, leave: Array, enter: Array) -> PoseSampler:
    """A take in which every avatar shows one transition, in the middle, on the origin; they stand in one another."""
    count, stride = len(leave), database.stride
    steps = np.arange(-ROWS, ROWS + 1)
    past = steps[:, None] >= 0
    frames = np.where(past, enter + steps[:, None], leave + steps[:, None])
    middle = np.where(past, enter, leave)
    place = ground.compose(ground.inverse(database.ground[middle * stride]), database.ground[frames * stride])
    numbers = np.arange(count)
    shifts = np.zeros((2 * count, 3))
    shifts[1::2] = align_transitions(database, leave * stride, enter * stride).shifts
    place = np.where(past[..., None], ground.compose(shifts[1::2], place), place)
    action = np.where(past, 2 * numbers + 1, 2 * numbers)
    phase = np.where(past, steps[:, None], steps[:, None] + ROWS)
    shape = (2 * ROWS + 1, count)
    first = np.stack([leave - ROWS + 1, enter + 1], axis=1).ravel()
    graph = SimpleNamespace(action_first=first, action_lengths=np.full(2 * count, ROWS))
    zeros = np.zeros(count, np.int16)
    cast = Cast(numbers.astype(str), zeros, zeros, zeros, np.ones(count, np.float32), np.ones(count, np.float32),
                ("boxer",), ("all",), ("motion",), np.full((1, 3), np.nan))  # fmt: skip
    events = Events(*(np.zeros((0, 3) if name == "point" else 0) for name in Events.__dataclass_fields__))
    x, z, heading = (place[..., k].astype(np.float32) for k in range(3))
    take = Take(
        action=np.broadcast_to(action, shape).astype(np.int32),
        action_frame=np.broadcast_to(phase, shape).astype(np.float32),
        x=x,
        z=z,
        heading=heading,
        opponent=np.full(shape, -1, np.int32),
        cast=cast,
        targets=np.zeros((shape[0], 0, 3)),
        target_names=(),
        events=events,
        control_rate=database.control_rate,
        scenario="transitions",
        seed=0,
        fingerprints=("",),
        status="done",
        collision_avoidance=False,
    )
    actions = SimpleNamespace(shifts=shifts)
    body = target_body(database)
    policy: Any = SimpleNamespace(database=database, graph=graph, actions=actions, fingerprint="", body=body)
    return PoseSampler(take, [policy], threads=2)


def played(database: MotionDatabase, middle: Array, reach: int) -> tuple[Array, Array]:
    """Captured motion around frames in their ground frame: positions of roots (n, T, 3) and rotations (n, T, J, 4)."""
    frames = middle[:, None] * database.stride + np.arange(-reach, reach + 1)
    origin = database.ground[middle * database.stride][:, None]
    roots = ground.to_local(origin, database.root_positions[frames])
    rotations = np.array(database.rotations[frames], dtype=float)
    rotations[:, :, 0] = quaternion.multiply(quaternion.about_y(-origin[..., 2]), rotations[:, :, 0])
    return roots, rotations


def joints(database: MotionDatabase, roots: Array, rotations: Array) -> Array:
    """Positions of the joints that have roles (n, T, roles, 3)."""
    count, times = roots.shape[:2]
    flat = rotations.reshape(count * times, -1, 4).astype(np.float32)
    positions, _ = forward_kinematics(database.skeleton, roots.reshape(-1, 3), flat, threads=1)
    kept = sorted(set(database.body.roles.values()))
    return positions[:, kept].reshape(count, times, len(kept), 3).astype(float)


def plain_methods(database: MotionDatabase, leave: Array, enter: Array, half: int) -> dict[str, Array]:
    """Joint positions over windows of plain methods of transition, and of the capture. Shape (n, T, roles, 3)."""
    reach = half + 1
    before, after = played(database, leave, reach), played(database, enter, reach)
    steps = np.arange(-reach, reach + 1)
    hard = [
        np.where((steps >= 0).reshape(1, -1, *[1] * (a.ndim - 2)), b, a) for a, b in zip(before, after, strict=True)
    ]
    share = np.clip((steps + FADE) / (2 * FADE), 0.0, 1.0)
    share = (share * share * (3.0 - 2.0 * share)).reshape(1, -1, 1)
    sign = np.where(np.sum(before[1] * after[1], axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
    mixed = before[1] * (1.0 - share[..., None]) + sign * after[1] * share[..., None]
    faded = [before[0] * (1.0 - share) + after[0] * share, quaternion.normalise(mixed)]
    return {
        "crossfade": joints(database, *faded),
        "hard": joints(database, *hard),
        "left": joints(database, *before),
        "entered": joints(database, *after),
    }


def alone(database: MotionDatabase, leave: Array, enter: Array, half: int) -> Array:
    """Joint positions around transitions that are made one at a time. Shape (n, T, roles, 3)."""
    sampler, reach, centre = take_of_transitions(database, leave, enter), half + 1, ROWS * database.stride
    poses = sampler.sample(centre - reach, centre + reach + 1, database.playback_rate)[0]
    return joints(database, poses.root_positions.swapaxes(0, 1), poses.rotations.swapaxes(0, 1))
