"""How a body moves, in the terms in which faults of capture show: what stands, what slides, what bends which way.

Lengths are those of a body of ``HEIGHT``, so that nothing depends on the unit of a file or the size of an actor.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import quaternion
from crowdsim.motion.body import HEIGHT, Body
from crowdsim.motion.contacts import runs
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.skeleton import Clip
from crowdsim.motion.tracks import Tracks, build_tracks

_WINDOW, _WINDOWS = 2000, 10
"""Frames that are looked at in a row, and how many such windows of a clip that is longer."""
_SMOOTH, _STEP = 0.02, 0.1
"""Widths of the smoothing of paths, and of what is looked at over the time of a step [s]."""
_FLIES, _ABOVE = 0.045, 0.6
"""Heights over the floor of the lower sole and of the trunk of someone who flies [m]."""
_TRUE = (0.3, 2.5)
"""Bounds of ``Evidence.ratio`` over the ground, for a root in the unit of the bones."""
_FLIGHT, _SAG = 6, 0.02
"""Frames that a flight has, at the least, and how much its path departs from a straight line [m]."""
_STANDS, _SWINGS = 0.25, 1.0
"""Speeds, as shares of the trunk's, of a foot that bears a body alone, at the most, and of the other, at the least."""
_CALM = 3.0
"""Width of the smoothing of these speeds, in frames."""
_STANCE, _LEAVES, _STANCES = 8, 0.1, 4
"""Frames that a stance on one foot has, how far the trunk goes over it, and number of stances that suffice [m]."""
_STRIDE, _LIKE, _STEADY, _STEPS = 0.3, (0.6, 1.6), 1.3, 3
"""How far feet get from one another in steps of a walk, at the least [m]; how far the root goes meanwhile, as shares of
that; how much more than the lower quartile the upper one of a steady walk is, at the most; and steps that suffice."""
_WALKED, _SMOOTHED = 0.4, 0.1
"""Share of a clip that steps of a walk are, at the least, for it to be one, and the width of the smoothing of the
trunk's path, as a share of the time of a step."""
_COUNTED = 0.94
"""Share of frames that count, by the speed of the root."""
SIDES = ("left", "right")


@dataclass(frozen=True)
class Evidence:
    """A body in the frames of a clip, or in windows of consecutive frames of a long one. N frames.

    Attributes:
        fps: Frames a second.
        roles: Joint of each role.
        positions: Joint positions. Shape (N, J, 3).
        tracks: Paths of the body's points [m].
        size: Metres in the length unit of everything but ``tracks``.
        frames: Number of each frame in the clip. Shape (N,).
        toes: Direction of each foot in the world, heel to toe; None where the skeleton does not show it. (N, 2, 3).
    """

    fps: float
    roles: Mapping[str, int]
    positions: Array
    tracks: Tracks
    size: float
    frames: Array
    toes: Array | None

    def at(self, role: str) -> Array:
        """Path of the joint of a role. Shape (N, 3)."""
        return np.asarray(self.positions[:, self.roles[role]])

    @cached_property
    def inside(self) -> Array:
        """Frames that neighbours surround on both sides. Shape (N,), bool."""
        steps = np.diff(self.frames) == 1
        return np.asarray(np.concatenate([[False], steps]) & np.concatenate([steps, [False]]))

    @cached_property
    def ends(self) -> Array:
        """Hands, feet and head relative to the pelvis. Shape (N, 5, 3)."""
        joints = [self.roles[name] for name in ("left_hand", "right_hand", "left_foot", "right_foot", "head")]
        return np.asarray(self.positions[:, joints] - self.at("pelvis")[:, None])

    @cached_property
    def extent(self) -> float:
        """How far the limb that moves most gets about the pelvis, along one axis."""
        return float(np.ptp(self.ends, axis=0).max())

    @cached_property
    def speeds(self) -> Array:
        """Speed of the fastest of hands, feet and head against the pelvis, frame to frame [1/s]. Shape (n,)."""
        steps = np.linalg.norm(np.diff(self.ends, axis=0), axis=-1).max(axis=1) * self.fps
        return np.asarray(steps[np.diff(self.frames) == 1])

    @cached_property
    def soles(self) -> Array:
        """Middle of each sole. Shape (N, 2, 3)."""
        return self._smooth(0.5 * (self.tracks.heels + self.tracks.balls) / self.size)

    @cached_property
    def root(self) -> Array:
        """Path of the pelvis. Shape (N, 3)."""
        return self._smooth(self.at("pelvis"))

    @cached_property
    def lowest(self) -> Array:
        """The lower foot of each frame. Shape (N,)."""
        return np.asarray(self.soles[..., 1].argmin(axis=1))

    @cached_property
    def root_velocity(self) -> Array:
        """Velocity of the pelvis. Shape (N, 3)."""
        return self._velocity(self.root)

    @cached_property
    def _pushes(self) -> Array:
        """Velocity that the pelvis would have if each foot stood still. Shape (N, 2, 3)."""
        legs = self.root[:, None] - self.soles
        return np.stack([self._velocity(legs[:, side]) for side in range(2)], axis=1)

    @cached_property
    def push(self) -> Array:
        """Velocity that the pelvis would have if the lower foot stood still. Shape (N, 3)."""
        return np.asarray(self._pushes[np.arange(len(self._pushes)), self.lowest])

    @cached_property
    def bearing(self) -> Array:
        """As ``push``, of the slower foot of those near the floor, over the time of a step. Shape (N, 3)."""
        heights = self.soles[..., 1]
        near = heights < heights.min(axis=1, keepdims=True) + 0.05
        slower = np.where(near, np.linalg.norm(self._pushes, axis=-1), np.inf).argmin(axis=1)
        return self._smooth(self._pushes[np.arange(len(slower)), slower], _STEP)

    @cached_property
    def travel(self) -> Array:
        """Velocity of the pelvis over the time of a step. Shape (N, 3)."""
        return self._smooth(self.root_velocity, _STEP)

    @cached_property
    def speed(self) -> float:
        """Median speed of the pelvis over the ground [m/s]."""
        return float(np.median(np.linalg.norm(self.travel[self.inside][:, [0, 2]], axis=1)))

    @cached_property
    def gravity(self) -> float | None:
        """Median acceleration downward of the trunk while both feet are off the floor [1/s^2].

        None without flights, or where the root does not travel as far as the feet push it: then it shows no gravity.
        """
        if not self._travels:
            return None
        low = self.soles[..., 1].min(axis=1)
        trunk = self._trunk[:, 1]
        floor = float(np.quantile(low, 0.1))
        found = []
        for start, stop in runs(self.inside & (low > floor + _FLIES) & (trunk > floor + _ABOVE)):
            if stop - start < _FLIGHT:
                continue
            frames = np.arange(stop - start) - 0.5 * (stop - start - 1)
            parts = np.polyfit(frames, trunk[start:stop], 2)
            sag = abs(parts[0]) * (0.5 * (stop - start)) ** 2
            if sag > _SAG and np.std(trunk[start:stop] - np.polyval(parts, frames)) < 0.15 * sag:
                found.append(-2.0 * parts[0] * self.fps**2)
        return float(np.median(found)) if len(found) > 1 else None

    @cached_property
    def balance(self) -> float | None:
        """Gravity by how hard the trunk is accelerated while one foot bears it, as that of a pendulum on it [1/s^2].

        A trunk at a distance from the foot below it falls away from it, the slower the lower gravity is. None where
        there are few such stances, or where the root does not travel as far as the feet push it.
        """
        if not self._travels:
            return None
        # Smoothed over frames, whatever their time.
        paths = np.concatenate([self._trunk[:, None], self.soles], axis=1)
        velocities = self._velocity(self._smooth(paths, _CALM / self.fps))
        speed, *feet = np.linalg.norm(velocities[..., [0, 2]], axis=-1).T
        found = []
        for foot in range(2):
            alone = (feet[foot] < _STANDS * speed) & (feet[1 - foot] > _SWINGS * speed)
            for start, stop in runs(self.inside & alone):
                legs = self._trunk[start:stop] - self.soles[start:stop, foot]
                level = legs[:, [0, 2]]
                if stop - start < _STANCE or np.ptp(level, axis=0).max() < _LEAVES:
                    continue
                # The second derivative of a cubic through the stance, whatever its time.
                frames = np.arange(stop - start) - 0.5 * (stop - start - 1)
                parts = np.polyfit(frames, self._trunk[start:stop][:, [0, 2]], 3)
                pull = 6.0 * parts[0] * frames[:, None] + 2.0 * parts[1]
                found.append((np.sum(pull**2), np.sum(level**2), np.sum(legs[:, 1]), stop - start))
        if len(found) < _STANCES:
            return None
        pulls, levels, heights, frames_alone = np.sum(found, axis=0)
        return float(np.sqrt(pulls / levels) * heights / frames_alone * self.fps**2)

    @cached_property
    def _steps(self) -> tuple[list[tuple[int, int]], Array]:
        """First frames of steps of a steady walk and of what follows each, and how far it goes; none without one."""
        spans: list[tuple[int, int]] = []
        found: list[float] = []
        if not self._travels:
            return spans, np.array(found)
        ways = unit(self.travel * np.array([1.0, 0.0, 1.0]))
        apart = np.sum((self.soles[:, 0] - self.soles[:, 1]) * ways, axis=1)
        for run in self._runs():
            root, passes = self.root[run][:, [0, 2]], np.flatnonzero(np.diff(apart[run] > 0.0)) + 1
            for start, stop in pairwise(passes):
                way = float(np.linalg.norm(root[stop] - root[start]))
                reach = float(np.abs(apart[run][start:stop]).max())
                if reach > _STRIDE and _LIKE[0] * reach < way < _LIKE[1] * reach:
                    spans.append((run.start + int(start), run.start + int(stop)))
                    found.append(way)
        low, high = np.quantile(np.array(found) * np.diff(spans)[:, 0], (0.25, 0.75)) if spans else (0.0, 0.0)
        return (spans, np.array(found)) if len(spans) >= _STEPS and high < _STEADY * low else ([], np.empty(0))

    @cached_property
    def pace(self) -> float | None:
        """How far a step of a steady walk goes, times how long it takes [m s]; None without a steady walk.

        Those who walk faster take longer steps and more of them, in one proportion: the walk ratio (Sekiya and others,
        The invariant relationship between step length and step rate during free walking, 1996).
        """
        spans, found = self._steps
        return float(np.median(found * np.diff(spans)[:, 0])) / self.fps if spans else None

    @cached_property
    def drive(self) -> float | None:
        """How hard the trunk is accelerated over the ground in the softer steps of a steady walk [m/s^2].

        Legs push a body on and brake it as it falls away from each foot, in all walks about as hard. None where steps
        of a steady walk are not most of the clip.
        """
        spans, _ = self._steps
        if sum(stop - start for start, stop in spans) < _WALKED * len(self.frames):
            return None
        # Smoothed over a share of a step, whatever its time.
        width = _SMOOTHED * float(np.median(np.diff(spans)))
        pushes = self._velocity(self._velocity(self._smooth(self._trunk, width / self.fps, np.inf)))[:, [0, 2]]
        hard = [np.mean(np.sum(pushes[max(start, 4) : stop] ** 2, axis=1)) for start, stop in spans]
        # A root that jumps does so in few steps.
        return float(np.sqrt(np.quantile(hard, 0.25)))

    @cached_property
    def _trunk(self) -> Array:
        """Path of the middle of the trunk. Shape (N, 3)."""
        return np.asarray(0.5 * (self.at("pelvis") + self.at("chest")))

    @cached_property
    def _travels(self) -> bool:
        """Whether the root travels about as far as the feet push it."""
        push, travel = (path[self.counted][:, [0, 2]] for path in (self.bearing, self.travel))
        return bool(_TRUE[0] * np.sum(travel**2) < np.sum(push * travel) < _TRUE[1] * np.sum(travel**2))

    @cached_property
    def counted(self) -> Array:
        """Frames in which the root does not jump, by its speed: all but the fastest. Shape (N,), bool."""
        speeds = np.linalg.norm(self.travel, axis=1)
        return np.asarray(self.inside & (speeds <= np.quantile(speeds, _COUNTED)))

    @cached_property
    def relation(self) -> float:
        """Correlation of the root's velocity with that at which the feet that bear it stand still."""
        return correlation(self.bearing[self.counted], self.travel[self.counted])

    @cached_property
    def ratio(self) -> float:
        """How much further the root would travel if feet that bear it stood still; below 1 where soles slide."""
        push, travel = self.bearing[self.counted], self.travel[self.counted]
        return float(np.sum(push * travel) / max(np.sum(travel**2), 1e-12))

    @cached_property
    def accelerations(self) -> Array:
        """Greatest acceleration of hands, feet and head against the pelvis [1/s^2]. Shape (n,)."""
        path = self._smooth(self.ends, _SMOOTH, 4.0)
        found = np.linalg.norm(np.diff(path, 2, axis=0), axis=-1).max(axis=1) * self.fps**2
        return np.asarray(found[self.inside[1:-1]])

    @cached_property
    def planted(self) -> Array:
        """Velocity of the foot that is slower over the floor, of those near it. Shape (N, 3)."""
        velocities = np.stack([self._velocity(self.soles[:, side]) for side in range(2)], axis=1)
        speeds = np.linalg.norm(velocities[..., [0, 2]], axis=-1)
        heights = self.soles[..., 1]
        near = heights < heights.min(axis=1, keepdims=True) + 0.06
        return np.asarray(velocities[np.arange(len(speeds)), np.where(near, speeds, np.inf).argmin(axis=1)])

    @cached_property
    def slip(self) -> Array:
        """Horizontal speed of that foot. Shape (N,)."""
        return np.asarray(np.linalg.norm(self.planted[:, [0, 2]], axis=-1))

    @cached_property
    def forward(self) -> Array:
        """Where the body faces by which of its sides are left and right. Shape (N, 3), unit length."""
        across = self.at("left_hip") - self.at("right_hip") + self.at("left_shoulder") - self.at("right_shoulder")
        return unit(np.cross(across, self.at("neck") - self.at("pelvis")))

    @cached_property
    def toe_sense(self) -> float | None:
        """How far toes point ahead, 1 wholly and -1 back; None where the skeleton does not show it."""
        if self.toes is None:
            return None
        return float(np.median(np.sum(self.toes * self.forward[:, None], axis=-1)))

    @cached_property
    def knee_sense(self) -> float:
        """How far knees lie before the lines from hips to ankles, in the median."""
        ahead = []
        for side in SIDES:
            hip, knee, foot = (self.at(f"{side}_{role}") for role in ("hip", "knee", "foot"))
            line = unit(hip - foot)
            off = knee - foot
            off = off - np.sum(off * line, axis=1, keepdims=True) * line
            ahead.append(np.sum(off * self.forward, axis=1))
        return float(np.median(ahead))

    @cached_property
    def unrest(self) -> float:
        """How much what bears the body moves: the median slip, and the spread of the lowest sole as of a second."""
        low = self.soles[..., 1].min(axis=1)
        spread = float(np.quantile(low, 0.9) - np.quantile(low, 0.1))
        return float(np.median(self.slip[self.inside])) + spread if self.inside.any() else spread

    def _runs(self) -> list[slice]:
        edges = np.flatnonzero(np.diff(self.frames) != 1) + 1
        return [slice(a, b) for a, b in zip([0, *edges], [*edges, len(self.frames)], strict=True)]

    def _smooth(self, path: Array, width: float = _SMOOTH, most: float = 60.0) -> Array:
        """The path, smoothed by a width [s] of so many frames at the most."""
        from scipy.ndimage import gaussian_filter1d

        result = np.array(path, dtype=float)
        for run in self._runs():
            result[run] = gaussian_filter1d(result[run], min(width * self.fps, most), axis=0, mode="nearest")
        return result

    def _velocity(self, path: Array) -> Array:
        result = np.zeros_like(path)
        for run in self._runs():
            if run.stop - run.start > 1:
                result[run] = np.gradient(path[run], axis=0) * self.fps
        return result


def gather_evidence(clip: Clip, body: Body, lost: Array | None = None, whole: bool = False) -> Evidence:
    """Follow a body through a clip, or through windows of one that is longer than those.

    Args:
        clip: The clip in metres, y up; at least two frames, all finite.
        body: The body on its skeleton.
        lost: Frames that do not count. Shape (F,), bool.
        whole: Take all frames, however many there are.
    """
    frames = np.arange(clip.frame_count) if whole else _looked_at(clip.frame_count)
    if lost is not None and not lost.all():
        frames = frames[~lost[frames]]
    positions, rotations = clip_kinematics(picked(clip, frames))
    size = body.height / HEIGHT
    return Evidence(
        fps=clip.fps,
        roles=body.roles,
        positions=positions / size,
        tracks=build_tracks(body, positions, rotations),
        size=size,
        frames=frames,
        toes=_toes(clip, body, positions, rotations),
    )


def picked(clip: Clip, frames: Array) -> Clip:
    """Return some frames of a clip, by their numbers or as a mask."""
    moved = clip.translations
    return replace(
        clip,
        root_positions=clip.root_positions[frames],
        rotations=clip.rotations[frames],
        translations=None if moved is None else moved[frames],
    )


def _looked_at(count: int) -> Array:
    """Frames of a clip of so many that are looked at."""
    if count <= _WINDOW * _WINDOWS:
        return np.arange(count)
    starts = np.linspace(0, count - _WINDOW, _WINDOWS).astype(int)
    return np.asarray((starts[:, None] + np.arange(_WINDOW)).ravel())


def _toes(clip: Clip, body: Body, positions: Array, rotations: Array) -> Array | None:
    """Directions of the feet by toe joints or end sites, without the part along the shank."""
    found = []
    for side in SIDES:
        foot, knee = body.roles[f"{side}_foot"], body.roles[f"{side}_knee"]
        toe = body.roles.get(f"{side}_toe")
        ends = clip.skeleton.end_offsets[clip.skeleton.end_parents == foot]
        if toe is not None:
            way = positions[:, toe] - positions[:, foot]
        elif len(ends):
            longest = ends[int(np.argmax(np.linalg.norm(ends, axis=1)))]
            way = quaternion.rotate(rotations[:, foot], longest)
        else:
            return None
        shank = unit(positions[:, foot] - positions[:, knee])
        level = way - np.sum(way * shank, axis=1, keepdims=True) * shank
        if np.median(np.linalg.norm(level, axis=1)) < 0.02 * body.height:
            return None
        found.append(unit(level))
    return np.stack(found, axis=1)


def correlation(a: Array, b: Array) -> float:
    """Return the correlation of vectors (N, k) about 0; 0 where all are 0."""
    scale = float(np.sqrt(np.sum(a**2) * np.sum(b**2)))
    return float(np.sum(a * b)) / scale if scale > 1e-12 else 0.0


def unit(vectors: Array) -> Array:
    """Return vectors (..., 3) of unit length."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12))
