"""Figures of a run: strikes, opponents, transitions, feet that slide, jumps at transitions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import numpy as np

from crowdsim.core.types import Array, Progress
from crowdsim.crowd.events import OUTCOMES
from crowdsim.crowd.kernels.layout import LANDED
from crowdsim.motion import quaternion
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.poses.capsules import PosedBodies
from crowdsim.poses.contacts import body_points
from crowdsim.poses.kernels.records import Moments, Steps, Transitions
from crowdsim.poses.kernels.steps import STEP
from crowdsim.poses.outlines import find_surface, striker_radii
from crowdsim.poses.sampler import Poses, PoseSampler
from crowdsim.take.measures import measure_fights
from crowdsim.take.penetration import Depths, is_sampled, measure_penetration
from crowdsim.take.population_metrics import measure_people
from crowdsim.take.spreads import measure_spreads
from crowdsim.take.variety import measure_variety

TOUCH = 0.02
"""How far from a surface a fist or foot touches it [m]."""
_NEAR_TRANSITION = 0.1
"""Time around a transition in which accelerations count as its own [s]."""
_MOST_POSES, _FEW = 150_000, 30
"""Most poses that are measured, and avatars of which all that are picked are."""
_STRETCH = 256
"""Frames that are measured one after another of a run that is too long to be measured whole."""
_POSES_AT_ONCE = 20_000
_MOST_STRIKES = 4000


def measure_take(sampler: PoseSampler, progress: Progress | None = None, threads: int = 1) -> dict[str, Any]:
    """Return figures of a run, plain data.

    Poses of large crowds are measured on avatars evenly picked, those of long runs, and fists, in stretches evenly
    picked; strikes and the like on all. Of long runs of few avatars penetration is measured on the same poses.

    Args:
        sampler: Poses of its take.
        progress: Called with ("poses", poses done, poses), then, unless penetration is measured on these, with
            ("penetration", frames done, frames).
        threads: Threads that share the work.

    Returns:
        ``avatars``, ``control_frames``, ``seconds``; ``strikes_thrown`` and, of these, ``strikes_landed``,
        ``strikes_blocked``, ``strikes_evaded`` and ``strikes_missed``; ``knock_downs``;
        ``hits_per_minute_per_avatar``; the attributes of ``FightMeasures``, positions from 10 s on;
        ``opponent_changes`` of all avatars; ``transitions_per_second`` of an avatar; ``foot_slide_median`` and
        ``foot_slide_95``, speed over the floor of planted feet [m/s], those apart that make a step for a transition,
        and beside them the capture's own in the frames that are shown, and in all that there are;
        ``thrown_per_minute_captured``, strikes in a minute of the capture of the mean avatar;
        ``transition_jump_ratio``, accelerations of joints near transitions over those of the frames shown there;
        ``fist_gap_median``, ``fist_gap_95`` and ``fist_gap_most``, how far surfaces of fists and feet are from the
        skin of the avatars that they land on, outside or inside [m], and ``fists_off_share``, the share of them that
        are further than ``TOUCH`` from it; the attributes of ``Penetration``, of ``Variety`` and of ``Spreads``.
        Figures of which there is nothing to measure are None.
    """
    take = sampler.take
    present = np.asarray(take.action[:]) >= 0
    minutes = float(present.sum()) / take.control_rate / 60.0
    outcomes = np.bincount(take.events.outcome, minlength=len(OUTCOMES))
    landed = int(outcomes[LANDED])
    opponent = np.asarray(take.opponent[:])
    there = present[1:] & present[:-1] & (opponent[:-1] != -1) & (opponent[1:] != -1)
    report: dict[str, Any] = {
        "avatars": take.avatar_count,
        "control_frames": take.frame_count,
        "seconds": take.seconds,
        "strikes_thrown": len(take.events.frame),
        **{f"strikes_{name}": int(count) for name, count in zip(OUTCOMES, outcomes, strict=True)},
        "knock_downs": int(np.count_nonzero(take.events.down)),
        "hits_per_minute_per_avatar": landed / minutes if minutes else None,
        **asdict(measure_fights(take, sampler.policies)),
    }
    picked = _Picked(sampler)
    gaps = _FistGaps(sampler, picked)
    everybody = len(picked.avatars) == take.avatar_count and not picked.whole and is_sampled(take)
    depths = Depths(sampler, threads) if everybody else None
    report.update(_of_poses(sampler, picked, gaps, depths, progress))
    report.update(gaps.figures())
    penetration = depths.figures() if depths else measure_penetration(sampler, threads, progress)
    report.update(asdict(penetration))
    report.update(asdict(measure_variety(take, sampler.policies)))
    report.update(asdict(measure_spreads(take)))
    report.update(asdict(measure_people(take, sampler.policies)))
    report["opponent_changes"] = int(np.count_nonzero(there & (opponent[1:] != opponent[:-1])))
    report["thrown_per_minute_captured"] = _captured_strikes(sampler)
    report["transitions_per_second"] = _count_transitions(sampler) / (minutes * 60.0) if minutes else None
    return report


class _Picked:
    """Avatars, and stretches of output frames at the playback rate of the first policy, that are measured.

    Attributes:
        rate: That rate.
        avatars: Their numbers. Shape (n,).
        stretches: First frame of each, and one past the last.
        whole: Whether these are all frames.
    """

    def __init__(self, sampler: PoseSampler) -> None:
        take, self.rate = sampler.take, float(sampler.motions[0].frames.rate)
        frames = take.output_frames(self.rate)
        count = max(1, min(take.avatar_count, max(_MOST_POSES // max(frames, 1), _FEW)))
        self.avatars = np.unique(np.linspace(0, take.avatar_count - 1, count).astype(np.int64))
        most = _MOST_POSES // count
        self.whole = frames <= most
        starts = np.linspace(0, frames - _STRETCH, max(most // _STRETCH, 1)).astype(int)
        self.stretches = [(0, frames)] if self.whole else [(start, start + _STRETCH) for start in starts.tolist()]
        sampler.expect(np.concatenate([np.arange(*stretch) for stretch in self.stretches]) / self.rate)


def _of_poses(
    sampler: PoseSampler, picked: _Picked, gaps: _FistGaps, depths: Depths | None, progress: Progress | None
) -> dict[str, float | None]:
    slides: list[Array] = []
    jumps: list[Array] = []
    own: list[Array] = []
    beneath: list[Array] = []
    captured = [_CapturedMotion(sampler, index) for index in range(len(sampler.motions))]
    for poses, start, rate in _some_poses(sampler, picked, gaps, depths, progress):
        motion = captured[poses.policy]
        times = (start + np.arange(len(poses.rotations))) / rate
        window = sampler.window(poses.policy, poses.avatars, times)
        where = window.playback(Moments(np.arange(len(poses.avatars)), times[:, None]))
        frames, now = where.frames, np.maximum(where.frames, 0)
        later = now + (where.fractions > 0.0)
        positions, rotations = poses.joints()
        balls = _balls(sampler, poses, positions, rotations)
        transitions = window.transitions
        planted = motion.contacts[now] & motion.contacts[later] & (frames >= 0)[..., None]
        planted &= ~_stepping(transitions, window.steps, times, len(poses.avatars))
        speeds = np.linalg.norm(np.diff(balls, axis=0), axis=-1) * rate
        slides.append(speeds[planted[1:] & planted[:-1]])
        positions = positions[:, :, motion.joints]
        sizes = np.linalg.norm(np.diff(positions, 2, axis=0), axis=-1).mean(axis=-1) * rate * rate
        near = np.zeros(frames.shape, bool)
        for owner, time in zip(transitions.owners, transitions.times, strict=True):
            low, high = np.searchsorted(times, (time - _NEAR_TRANSITION, time + _NEAR_TRANSITION))
            near[low:high, owner] = True
        part = where.fractions[..., None, None]
        own_balls = motion.balls[now] * (1.0 - part) + motion.balls[later] * part
        own_speeds = np.linalg.norm(np.diff(own_balls, axis=0), axis=-1) * poses.scales[None, :, None] * rate
        both = planted[1:] & planted[:-1]
        # Over a transition the capture has no speed.
        both &= (np.diff(frames, axis=0) >= 0)[..., None] & (np.diff(frames, axis=0) < 4)[..., None]
        beneath.append(own_speeds[both])
        counts = near[1:-1] & np.isfinite(sizes)
        jumps.append(sizes[counts])
        pace = (poses.scales * sampler.take.cast.speeds[poses.avatars] ** 2)[None]
        own.append((motion.accelerations[np.maximum(frames[1:-1], 0)] * pace)[counts])
    whole = [motion.slides for motion in captured]

    def percentile(values: list[Array], share: float) -> float | None:
        joined = np.concatenate(values) if values else np.zeros(0)
        joined = joined[np.isfinite(joined)]
        return float(np.percentile(joined, share)) if len(joined) else None

    reference = float(np.concatenate(own).mean()) if own and len(np.concatenate(own)) else 0.0
    return {
        "foot_slide_median": percentile(slides, 50),
        "foot_slide_95": percentile(slides, 95),
        "foot_slide_median_captured": percentile(beneath, 50),
        "foot_slide_95_captured": percentile(beneath, 95),
        "foot_slide_median_all_capture": percentile(whole, 50),
        "foot_slide_95_all_capture": percentile(whole, 95),
        "transition_jump_ratio": float(np.concatenate(jumps).mean()) / reference if reference > 0.0 else None,
    }


class _FistGaps:
    """Gaps between landed fists and feet and the surface of their victims; of many strikes, an even selection."""

    def __init__(self, sampler: PoseSampler, picked: _Picked) -> None:
        events = sampler.take.events
        landed = np.flatnonzero(np.asarray(events.landed, dtype=bool) & (np.asarray(events.victim) >= 0))
        times = np.asarray(events.frame, dtype=np.float64)[landed] / sampler.take.control_rate * picked.rate
        if picked.whole:
            groups = [landed]
        else:
            groups = [landed[(times >= start) & (times < stop)] for start, stop in picked.stretches]
        chosen = np.concatenate(groups)
        kept = chosen[np.unique(np.linspace(0, len(chosen) - 1, min(len(chosen), _MOST_STRIKES)).astype(np.int64))]
        self._sampler, self._groups = sampler, [group[np.isin(group, kept)] for group in groups]
        self._found: list[Array] = []

    def add(self, stretch: int) -> None:
        """Measure those of a stretch, given by its number."""
        self._found.append(_gaps(self._sampler, self._groups[stretch]))

    def figures(self) -> dict[str, float | None]:
        """Return what has been measured."""
        gaps = np.concatenate(self._found)
        gaps = gaps[np.isfinite(gaps)]
        there = len(gaps) > 0
        return {
            "fist_gap_median": float(np.median(gaps)) if there else None,
            "fist_gap_95": float(np.percentile(gaps, 95)) if there else None,
            "fist_gap_most": float(gaps.max()) if there else None,
            "fists_off_share": float(np.mean(gaps > TOUCH)) if there else None,
        }


def _gaps(sampler: PoseSampler, some: Array) -> Array:
    """How far the surfaces of fists and feet are from those whom they hit, outside or inside, in strikes (E,) [m]."""
    events = sampler.take.events
    times = np.asarray(events.frame, dtype=np.float64)[some] / sampler.take.control_rate
    fists, radii, gaps = np.full((len(some), 3), np.nan), np.zeros(len(some)), np.full(len(some), np.nan)
    limbs, cast = np.asarray(events.limb)[some].astype(np.int64), sampler.take.cast
    attackers, victims = (np.asarray(values)[some].astype(int) for values in (events.attacker, events.victim))
    for which, body, scales, positions, rotations in sampler.moments(attackers, times):
        fists[which] = body_points(body, positions, rotations, scales)[3][np.arange(len(which)), limbs[which]]
        radii[which] = striker_radii(body, limbs[which], scales, cast.bare[attackers[which]])
    for which, body, scales, positions, rotations in sampler.moments(victims, times):
        build = scales, cast.girths[victims[which]], cast.stretches[victims[which]]
        bodies = PosedBodies(body, np.arange(len(which)), *build, positions[None], rotations[None])
        gaps[which] = find_surface(bodies, cast.sexes[victims[which]]).gaps(fists[which])[0] - radii[which]
    return np.abs(gaps)


class _CapturedMotion:
    """What poses of a policy are held against: accelerations and sliding feet of its own capture."""

    def __init__(self, sampler: PoseSampler, index: int) -> None:
        database = sampler.policies[index].database
        positions, rotations = forward_kinematics(
            database.skeleton, database.root_positions, database.rotations, threads=1
        )
        self.joints = sorted(set(database.body.roles.values()))
        self.contacts = np.asarray(database.contacts) & ~sampler.motions[index].down[:, None]
        rate = database.playback_rate
        sizes = np.linalg.norm(np.diff(positions[:, self.joints], 2, axis=0), axis=-1).mean(axis=-1) * rate * rate
        self.accelerations = np.pad(sizes, 1, mode="edge")
        starts = np.asarray(database.clip_starts[:-1]) * database.stride
        # A difference over the border of two clips means nothing.
        for border in starts[1:]:
            self.accelerations[[border - 1, border]] = np.nan
        self.accelerations = _filled(self.accelerations)
        roles, body = database.body.roles, database.body
        feet = [roles["left_foot"], roles["right_foot"]]
        self.balls = (positions[:, feet] + quaternion.rotate(rotations[:, feet], body.sole_offsets[:, 1]))[..., [0, 2]]
        speeds = np.linalg.norm(np.diff(self.balls, axis=0), axis=-1) * rate
        both = self.contacts[1:] & self.contacts[:-1]
        both[starts[1:] - 1] = False
        self.slides = speeds[both]


def _filled(values: Array) -> Array:
    """Values with gaps closed by what lies before them."""
    last = np.maximum.accumulate(np.where(np.isnan(values), 0, np.arange(len(values))))
    return np.asarray(values[last])


def _stepping(transitions: Transitions, steps: Steps, times: Array, avatars: int) -> Array:
    """Whether feet make a step at times (T,). Shape (T, avatars, 2)."""
    stepping = np.zeros((len(times), avatars, 2), bool)
    for k, foot in zip(*np.nonzero(steps.kinds == STEP), strict=True):
        low, high = np.searchsorted(times, steps.moves[k, foot, :2])
        stepping[low : high + 1, transitions.owners[k], foot] = True
    return stepping


def _balls(sampler: PoseSampler, poses: Poses, positions: Array, rotations: Array) -> Array:
    """Balls of the feet over the floor. Shape (T, n, 2, 2)."""
    body = sampler.motions[poses.policy].body
    feet = [body.roles["left_foot"], body.roles["right_foot"]]
    soles = quaternion.rotate(rotations[:, :, feet], body.sole_offsets[:, 1]) * poses.scales[:, None, None]
    return np.asarray((positions[:, :, feet] + soles)[..., [0, 2]])


def _some_poses(
    sampler: PoseSampler, picked: _Picked, gaps: _FistGaps, depths: Depths | None, progress: Progress | None
) -> Iterator[tuple[Poses, int, float]]:
    """Poses of what is picked, some at once: poses, first frame and rate.

    In each stretch ``gaps`` are measured, and ``depths`` of poses of everybody, where these are wanted.
    """
    total = len(picked.avatars) * sum(stop - start for start, stop in picked.stretches)
    done = 0
    for number, (start, stop) in enumerate(picked.stretches):
        at_once = max(1, _POSES_AT_ONCE // max(stop - start, 1))
        for low in range(0, len(picked.avatars), at_once):
            group = picked.avatars[low : low + at_once]
            for first in range(start, stop, _POSES_AT_ONCE):
                posed = sampler.sample(first, min(first + _POSES_AT_ONCE, stop), picked.rate, group)
                if depths is not None:
                    depths.add(posed)
                for poses in posed:
                    yield poses, first, picked.rate
            done += len(group) * (stop - start)
            if low + at_once >= len(picked.avatars):
                # What limbs give way to is known there already.
                gaps.add(number)
            if progress is not None:
                progress("poses", done, total)


def _captured_strikes(sampler: PoseSampler) -> float | None:
    """Strikes in a minute of the capture, played as fast as avatars play it; mean of all avatars."""
    cast = sampler.take.cast
    rates = np.zeros(len(sampler.policies))
    for index, policy in enumerate(sampler.policies):
        database = policy.database
        rates[index] = 60.0 * len(database.strike_frames) * database.control_rate / database.frame_count
    return float(np.mean(rates[cast.policies] * cast.speeds)) if len(cast.policies) else None


def _count_transitions(sampler: PoseSampler) -> int:
    """Number of transitions of a take."""
    take, count = sampler.take, 0
    for index in range(len(sampler.motions)):
        avatars = np.flatnonzero(take.cast.policies == index)
        for low in range(0, len(avatars), 1000):
            window = sampler.window(index, avatars[low : low + 1000], np.array([0.0, take.seconds]))
            count += len(window.transitions.times)
    return count
