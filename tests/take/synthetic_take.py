"""Takes for tests: walks through the motion of a short performance, without a policy or a simulation."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from crowdsim.motion import ground
from crowdsim.motion.body import Body
from crowdsim.motion.database import MotionDatabase, build_database
from crowdsim.motion.measuring import measure_clips
from crowdsim.performer.session import perform
from crowdsim.policy.rewards import target_body
from crowdsim.poses.capsules import PosedBodies
from crowdsim.poses.contacts import body_points
from crowdsim.poses.outlines import find_surface, striker_radii
from crowdsim.poses.sampler import PoseSampler
from crowdsim.take.take import Cast, Events, Take

RATE = 15.0
NO_EVENTS = Events(*(np.zeros((0, 3) if name == "point" else 0) for name in Events.__dataclass_fields__))


@cache
def database() -> MotionDatabase:
    """Motion of half a minute of performance."""
    return build_database(measure_clips([performed.clip for performed in perform(30, 3)]))


def actions(count: int, longest: int = 12, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """First frames and lengths of actions that lie in one clip each."""
    rng = np.random.default_rng(seed)
    starts = database().clip_starts
    lengths = rng.integers(1, longest + 1, count)
    clips = rng.integers(0, len(starts) - 1, count)
    room = starts[clips + 1] - starts[clips] - lengths - 1
    return (starts[clips] + 1 + (rng.random(count) * room)).astype(int), lengths


def build_take(
    chosen: list[list[int]],
    first: np.ndarray,
    lengths: np.ndarray,
    frames: int,
    speeds: list[float] | None = None,
    scales: list[float] | None = None,
    events: Events = NO_EVENTS,
    pushes: float = 0.0,
    start: list[tuple[float, float, float]] | None = None,
    shifts: np.ndarray | None = None,
    motion: MotionDatabase | None = None,
) -> tuple[Take, Any]:
    """Let avatars do actions one after another; returns the take and a stand-in for its policy."""
    motion = motion or database()
    count, stride = len(chosen), motion.stride
    speeds, scales = speeds or [1.0] * count, scales or [1.0] * count
    rng = np.random.default_rng(1)
    shifts = np.zeros((len(first), 3)) if shifts is None else shifts
    action, phase = np.zeros((frames, count), np.int32), np.zeros((frames, count))
    places = np.zeros((frames, count, 3))
    for n, queue in enumerate(chosen):
        place = np.array(start[n] if start else (2.0 * n, 0.0, 0.4 * n))
        at, done = 0, 0.0
        size = np.array([scales[n], scales[n], 1.0])
        for frame in range(frames):
            if frame:
                done += speeds[n]
                if done >= lengths[queue[at]] - 1e-9:
                    end = (first[queue[at]] - 1 + lengths[queue[at]]) * stride
                    place = _go(motion, place, (first[queue[at]] - 1) * stride, end, scales[n])
                    done -= lengths[queue[at]]
                    at += 1
                    place = ground.compose(place, shifts[queue[at]] * size)
                    place[:2] += rng.uniform(-pushes, pushes, 2)
            origin = (first[queue[at]] - 1) * stride
            action[frame, n], phase[frame, n] = queue[at], done
            places[frame, n] = _go(motion, place, origin, origin + done * stride, scales[n])
    zeros = np.zeros(count, np.int16)
    cast = Cast(
        np.array([f"a{n}" for n in range(count)]), zeros, zeros, zeros, np.array(scales, np.float32),
        np.array(speeds, np.float32), ("boxer",), ("all",), ("boxer",), np.full((1, 3), np.nan),
    )  # fmt: skip
    take = Take(
        action, phase.astype(np.float32), *(places[..., k].astype(np.float32) for k in range(3)),
        np.full((frames, count), -1, np.int32), cast, np.zeros((frames, 0, 3), np.float32), (), events, RATE, "test", 0,
        ("",), "done",
    )  # fmt: skip
    graph = SimpleNamespace(action_first=np.asarray(first), action_lengths=np.asarray(lengths))
    actions = SimpleNamespace(shifts=shifts)
    body = target_body(motion)
    return take, SimpleNamespace(
        database=motion, graph=graph, actions=actions, body=body, falls=None, rests=None, fingerprint=""
    )


def sampler(take: Take, policy: Any, **more: Any) -> PoseSampler:
    """Poses of a take whose one policy is a stand-in."""
    return PoseSampler(take, [policy], **more)


def _go(motion: MotionDatabase, place: np.ndarray, start: float, end: float, scale: float) -> np.ndarray:
    step = ground.compose(ground.inverse(_at(motion, start)), _at(motion, end))
    step[:2] *= scale
    return ground.compose(place, step)


def _at(motion: MotionDatabase, frame: float) -> np.ndarray:
    low = int(np.floor(frame + 1e-9))
    part = max(frame - low, 0.0)
    high = min(low + 1, len(motion.ground) - 1)
    return motion.ground[low] * (1 - part) + motion.ground[high] * part


def touch_gap(body: Body, poses: Any, limb: int) -> float:
    """How far the surface of what the first avatar strikes with is from the skin of the second one [m]."""
    (positions, turns), one = (a[0] for a in poses.joints()), np.ones(1)
    build = poses.scales[1:], one, np.ones((1, 3))
    victim = PosedBodies(body, np.arange(1), *build, positions[None, 1:], turns[None, 1:])
    strikers = body_points(body, positions, turns, poses.scales)[3]
    radius = striker_radii(body, np.array([limb]), poses.scales[:1], np.zeros(1, bool))
    return float((find_surface(victim, np.array(["male"])).gaps(strikers[:1, limb])[0] - radius)[0])
