"""Variety of a run: how often captured motion is repeated, by whom, and how much of it is still; and how hits come."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from crowdsim.core.types import Array
from crowdsim.crowd.model import strong_speed
from crowdsim.crowd.record import TakeData
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.policy.policy import Policy

LATELY, AROUND = 2.0, 8.0
"""Time [s] and distance [m] within which others count that show the same motion."""
SAME = 1
"""Control frames of captured motion up to which motion is the same."""
TOGETHER = 0.5
"""Time within which two strikes are thrown at once [s]."""
BEHIND = np.deg2rad(120.0)
"""Bearing beyond which a hit comes from behind [rad]."""
STILL = 0.2
"""Mean speed of joints below which a body is still, over its height [1/s]."""
YIELDING = 1.0
"""Time after a strong hit in which the victim's step is measured [s]."""
_MOST_AVATARS, _MOST_FRAMES, _MOST_STRIKES = 400, 300, 20_000


@dataclass(frozen=True)
class Variety:
    """Figures of a run; None where there is nothing to measure.

    Motion is captured motion, of one side: mirror images are other motion, but where strikes are compared.

    Attributes:
        repeated_second_per_minute: How often an avatar comes by the moment of captured motion that it shows most often,
            per minute; the mean avatar.
        same_source_share: Share of avatar-frames in which another avatar within ``AROUND`` shows the same motion, or
            did in the last ``LATELY``.
        same_strike_share: Share of strikes at an opponent that fights back, which throws the same strike, or its mirror
            image, within ``TOGETHER``.
        stillness_share: Share of avatar-frames in which the motion shown is still.
        stillness_share_captured: Share of the captured motion that is still.
        hits_from_behind_share: Share of hits whose attacker is further than ``BEHIND`` off the heading of the victim.
        step_after_hit: How far victims go along a strong hit within ``YIELDING``, the mean [m]. Strong hits are faster
            than three quarters of the strikes in the attacker's motion.
    """

    repeated_second_per_minute: float | None
    same_source_share: float | None
    same_strike_share: float | None
    stillness_share: float | None
    stillness_share_captured: float | None
    hits_from_behind_share: float | None
    step_after_hit: float | None


def measure_variety(take: TakeData, policies: Sequence[Policy]) -> Variety:
    """Measure the variety of a take; of many avatars those evenly picked, of many strikes the first ones."""
    count = take.avatar_count
    some = (
        np.unique(np.linspace(0, count - 1, min(count, _MOST_AVATARS)).astype(np.int64)) if count else np.zeros(0, int)
    )
    source = _sources(take, policies, slice(None), some)
    there = source >= 0
    still = _still_frames(policies)
    behind, step = _hits(take, policies)
    return Variety(
        repeated_second_per_minute=_repeated(source, take.control_rate),
        same_source_share=_same_source(take, policies, some),
        same_strike_share=_same_strikes(take, policies),
        stillness_share=float(still[source[there]].mean()) if there.any() else None,
        stillness_share_captured=float(still.mean()) if len(still) else None,
        hits_from_behind_share=behind,
        step_after_hit=step,
    )


def _starts(policies: Sequence[Policy]) -> Array:
    """First control frame of the motion of each policy, where they follow one another."""
    return np.concatenate([[0], np.cumsum([policy.database.frame_count for policy in policies])]).astype(np.int64)


def _places(take: TakeData, policies: Sequence[Policy], action: Array, done: Array, avatars: Array) -> Array:
    """Place in the captured motion of all policies that avatars show in actions [control frames].

    NaN in falls and rests.
    """
    places = np.full(np.shape(action), np.nan)
    whose = np.broadcast_to(take.cast.policies[avatars], np.shape(action))
    for index, (policy, start) in enumerate(zip(policies, _starts(policies), strict=False)):
        own = (whose == index) & (action >= 0)
        if policy.falls is not None:
            own &= ~np.isin(action, policy.falls.actions)
        if policy.rests is not None:
            own &= ~np.isin(action, policy.rests.actions)
        places[own] = start + np.asarray(policy.graph.action_first)[action[own]] - 1.0 + done[own]
    return places


def _sources(take: TakeData, policies: Sequence[Policy], rows: slice, avatars: Array) -> Array:
    """Captured control frame that avatars show, -1 while absent. Shape (frames, n)."""
    action, done = (np.asarray(values[rows])[:, avatars] for values in (take.action, take.action_frame))
    places = _places(take, policies, action, done.astype(float), avatars)
    return np.where(np.isfinite(places), np.floor(np.nan_to_num(places) + 1e-3), -1.0).astype(np.int64)


def _repeated(source: Array, rate: float) -> float | None:
    """How often the mean avatar comes by the captured frame that it shows most often, per minute."""
    found = []
    for own in source.T:
        new = np.concatenate([own[:1], own[1:][own[1:] != own[:-1]]])
        new = new[new >= 0]
        if len(new):
            found.append(np.bincount(new).max() / (np.count_nonzero(own >= 0) / rate / 60.0))
    return float(np.mean(found)) if found else None


def _same_source(take: TakeData, policies: Sequence[Policy], some: Array) -> float | None:
    """Share of frames of some avatars in which another one around shows the same motion, or did lately."""
    frames, lately = take.frame_count, round(LATELY * take.control_rate)
    same = seen = 0
    everyone = np.arange(take.avatar_count)
    few = np.unique(np.linspace(min(lately, frames - 1), frames - 1, min(frames, _MOST_FRAMES)).astype(np.int64))
    for frame in few if take.avatar_count > 1 else ():
        shown = _sources(take, policies, slice(max(frame - lately, 0), frame + 1), everyone)
        here = np.flatnonzero(shown[-1] >= 0)
        points = np.column_stack([take.x[frame], take.z[frame]])[here]
        mine = some[shown[-1, some] >= 0]
        if not len(mine):
            continue
        near = cKDTree(points).query_ball_point(np.column_stack([take.x[frame], take.z[frame]])[mine], AROUND)
        for avatar, others in zip(mine, near, strict=True):
            around = here[others]
            around = around[around != avatar]
            seen += 1
            same += bool((np.abs(shown[:, around] - shown[-1, avatar]) <= SAME).any())
    return same / seen if seen else None


def _same_strikes(take: TakeData, policies: Sequence[Policy]) -> float | None:
    """Share of strikes at opponents that fight back which these throw too, at once."""
    events, rate = take.events, take.control_rate
    times, attackers, victims = (
        np.asarray(values[:_MOST_STRIKES]) for values in (events.frame, events.attacker, events.victim)
    )
    if take.frame_count < 2 or not len(times):
        return None
    frame = np.clip(np.floor(times).astype(np.int64), 0, take.frame_count - 2)
    opponent = np.asarray(take.opponent[:])
    back = (victims >= 0) & (opponent[frame, np.maximum(victims, 0)] == attackers)
    if not back.any():
        return None
    places = _strike_places(take, policies, frame, times - frame, attackers)
    order = np.argsort(times, kind="stable")
    lows, highs = (np.searchsorted(times[order], times + apart) for apart in (-TOGETHER * rate, TOGETHER * rate))
    same = 0
    for k in order:
        if back[k]:
            near = order[lows[k] : highs[k]]
            theirs = near[(attackers[near] == victims[k]) & (victims[near] == attackers[k])]
            same += bool((np.abs(places[theirs] - places[k]) < SAME).any())
    return same / int(np.count_nonzero(back))


def _strike_places(take: TakeData, policies: Sequence[Policy], frame: Array, share: Array, avatars: Array) -> Array:
    """Where in the captured motion strikes lie, mirror images where what they mirror does [control frames]."""
    action, done = np.asarray(take.action[:]), np.asarray(take.action_frame[:], dtype=float)
    speeds = np.asarray(take.cast.speeds, dtype=float)[avatars]
    now = _places(take, policies, action[frame, avatars], done[frame, avatars], avatars) + share * speeds
    then = frame + 1
    later = _places(take, policies, action[then, avatars], done[then, avatars], avatars) - (1.0 - share) * speeds
    found = np.full(len(frame), np.nan)
    for index, (policy, start) in enumerate(zip(policies, _starts(policies), strict=False)):
        own = np.flatnonzero(take.cast.policies[avatars] == index)
        database = policy.database
        known = start + np.asarray(database.strike_frames) / database.stride
        if len(known) and len(own):
            # Where a strike lies in the frame's action or in the next one, and which it is.
            both = np.stack([now[own], later[own]])
            after = np.minimum(np.searchsorted(known, both), len(known) - 1)
            before = np.maximum(after - 1, 0)
            best = np.where(np.abs(known[before] - both) <= np.abs(known[after] - both), known[before], known[after])
            gaps = np.nan_to_num(np.abs(best - both), nan=np.inf)
            place = np.where(gaps[0] <= gaps[1], best[0], best[1])
            found[own] = start + (place - start) % database.captured_frames
    return found


def _still_frames(policies: Sequence[Policy]) -> Array:
    """Whether each captured control frame is still, of all policies one after another. Shape (F,), bool."""
    found = []
    for policy in policies:
        database = policy.database
        positions, _ = forward_kinematics(database.skeleton, database.root_positions, database.rotations, threads=1)
        joints = sorted(set(database.body.roles.values()))
        steps = np.linalg.norm(np.diff(positions[:, joints], axis=0), axis=-1).mean(axis=-1) * database.playback_rate
        starts = np.asarray(database.clip_starts[1:-1], np.int64) * database.stride
        steps[starts - 1] = np.nan
        speeds = np.concatenate([steps, steps[-1:]]).reshape(-1, database.stride)
        found.append(np.nanmean(speeds, axis=1) < STILL * database.body.height)
    return np.concatenate(found)


def _hits(take: TakeData, policies: Sequence[Policy]) -> tuple[float | None, float | None]:
    """Share of hits that come from behind, and how far victims go along strong ones [m]."""
    events = take.events
    landed = np.flatnonzero(np.asarray(events.landed, bool) & (np.asarray(events.victim) >= 0))
    if not len(landed):
        return None, None
    attacker, victim = np.asarray(events.attacker)[landed], np.asarray(events.victim)[landed]
    frame = np.clip(np.rint(np.asarray(events.frame)[landed]).astype(np.int64), 0, take.frame_count - 1)
    x, z, heading = (np.asarray(values[:], dtype=float) for values in (take.x, take.z, take.heading))
    dx, dz = x[frame, attacker] - x[frame, victim], z[frame, attacker] - z[frame, victim]
    bearing = np.arctan2(dx, dz) - heading[frame, victim]
    bearing = np.abs((bearing + np.pi) % (2.0 * np.pi) - np.pi)
    strong = np.array([strong_speed(policy) for policy in policies])[take.cast.policies[attacker]]
    then = frame + round(YIELDING * take.control_rate)
    counts = (np.asarray(events.speed)[landed] >= strong) & (then < take.frame_count)
    f, t, v = frame[counts], then[counts], victim[counts]
    along = -(dx[counts] * (x[t, v] - x[f, v]) + dz[counts] * (z[t, v] - z[f, v]))
    steps = along / np.maximum(np.hypot(dx[counts], dz[counts]), 1e-9)
    steps = steps[np.isfinite(steps)]
    known = np.isfinite(bearing)
    behind = float(np.mean(bearing[known] > BEHIND)) if known.any() else None
    return behind, float(steps.mean()) if len(steps) else None
