"""Any BVH file as a lit figure, which is how motion is looked at."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from crowdsim.capture.loading import Capture, load_people, with_path
from crowdsim.core.types import Array, FileName
from crowdsim.errors import BvhError
from crowdsim.motion.analysis import on_floor
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.resampling import resample
from crowdsim.motion.skeleton import Clip
from crowdsim.motion.tracks import clip_tracks
from crowdsim.render.figure import Figure, bone_capsules
from crowdsim.render.source import Shown, no_strikes
from crowdsim.scenario.camera import Camera

BVH_CAMERA = "front+side"
MOST_FPS = 60.0
"""Files of a higher rate are shown at the greatest whole share of it that is no higher."""
_ANIMAL_SIZE = 1.2
"""Height to which a figure of unknown scale is brought [m]."""


@dataclass(frozen=True)
class ClipSource:
    """One figure that performs a clip; a ``PoseSource``.

    Attributes:
        name: What it is called in captions.
        fingerprint: Differs whenever a picture would.
        fps: Frames a second.
        avatar_names: One name.
        avatar_teams: Shape (1,).
        avatar_scales: Shape (1,).
        avatar_girths: Shape (1,).
        avatar_stretches: Shape (1, 3).
        avatar_heights: How high the figure reaches over the clip, or how wide, where that is more [m]. Shape (1,).
        figures: One figure.
        avatar_figures: Shape (1,).
        positions: Joint positions [m]. Shape (F, J, 3).
        rotations: Joint rotations. Shape (F, J, 4).
        grounds: Ground transforms. Shape (F, 3).
    """

    name: str
    fingerprint: str
    fps: float
    avatar_names: Sequence[str]
    avatar_teams: Array
    avatar_scales: Array
    avatar_girths: Array
    avatar_stretches: Array
    avatar_heights: Array
    figures: Sequence[Figure]
    avatar_figures: Array
    positions: Array
    rotations: Array
    grounds: Array

    @property
    def frame_count(self) -> int:
        """Number of frames."""
        return len(self.positions)

    @property
    def cameras(self) -> Mapping[str, Camera]:
        """No cameras: BVH files define none."""
        return {}

    def ground(self, frames: Array) -> Array:
        """Return the ground transforms at some frames. Shape (n, 1, 3)."""
        return self.grounds[np.asarray(frames), None]

    def poses(self, frame: int, shown: Shown | None = None) -> list[tuple[Array, Array]]:
        """Return the pose at a frame."""
        return [(self.positions[frame : frame + 1], self.rotations[frame : frame + 1])]

    @property
    def avatar_colours(self) -> Array:
        """Colour of the figure: its team's. Shape (1, 3)."""
        return np.full((1, 3), np.nan)

    @property
    def arena(self) -> Array:
        """Return that the ground is open. Shape (5,)."""
        return np.zeros(5)

    def markers(self, frame: int) -> Array:
        """Return that there is nothing but the figure."""
        return np.zeros((0, 3))

    def recent_strikes(self, frame: int) -> tuple[Array, Array, Array, Array]:
        """Return that there are none."""
        return no_strikes()


def show_rate(fps: float, wanted: float | None = None) -> float:
    """Return the rate at which a clip of some rate is shown, ``wanted`` where that is given."""
    return float(wanted) if wanted else fps / max(1, int(np.ceil(fps / MOST_FPS - 1e-6)))


def clip_source(clip: Clip, figure: Figure | None = None, grounds: Array | None = None, team: int = 0) -> ClipSource:
    """Return a clip in metres, y up, as a source of pictures.

    Args:
        clip: The clip, at the rate of the pictures.
        figure: Its body; capsules along its bones by default.
        grounds: Ground transforms (F, 3); where its root is and where it moves to by default.
        team: Number of the team whose colours it wears.

    Raises:
        BvhError: It has no frame, or values that are not finite.
    """
    if clip.frame_count < 1:
        raise BvhError(f"{clip.source or clip.name}: no frames, expected motion to draw")
    positions, rotations = clip_kinematics(clip)
    finite = np.isfinite(positions).all(axis=(1, 2)) & np.isfinite(rotations).all(axis=(1, 2))
    if not finite.all():
        raise BvhError(f"{clip.source or clip.name}: frame {int(np.argmin(finite))} holds a value that is no number")
    middles = 0.5 * (positions.min(axis=1) + positions.max(axis=1))
    if grounds is None:
        way = positions[-1, 0] - positions[0, 0]
        heading = float(np.arctan2(way[0], way[2])) if np.hypot(way[0], way[2]) > 0.3 else 0.0
        grounds = np.stack([middles[:, 0], middles[:, 2], np.full(len(middles), heading)], axis=1)
    wide = np.abs(positions[..., [0, 2]] - grounds[:, None, :2]).max() / 0.45
    height = max(float(positions[..., 1].max()), float(wide) * 0.9, 0.2)
    digest = hashlib.sha256()
    for array in (positions, rotations):
        digest.update(np.ascontiguousarray(array, np.float32).tobytes())
    return ClipSource(
        name=clip.name,
        fingerprint=digest.hexdigest(),
        fps=clip.fps,
        avatar_names=(clip.name,),
        avatar_teams=np.array([team]),
        avatar_scales=np.ones(1),
        avatar_girths=np.ones(1),
        avatar_stretches=np.ones((1, 3)),
        avatar_heights=np.array([height]),
        figures=(bone_capsules(clip.skeleton) if figure is None else figure,),
        avatar_figures=np.zeros(1, np.int32),
        positions=positions.astype(np.float32),
        rotations=rotations.astype(np.float32),
        grounds=grounds,
    )


@dataclass(frozen=True)
class PeopleSource:
    """Several figures that perform clips of one file side by side; a ``PoseSource``.

    Attributes:
        name: What they are called in captions.
        people: A source of one figure each, all of one rate.
    """

    name: str
    people: Sequence[ClipSource]

    @property
    def fingerprint(self) -> str:
        """Differs whenever a picture would."""
        return hashlib.sha256("".join(one.fingerprint for one in self.people).encode()).hexdigest()

    @property
    def fps(self) -> float:
        """Frames a second."""
        return self.people[0].fps

    @property
    def frame_count(self) -> int:
        """Number of frames, of the shortest clip."""
        return min(one.frame_count for one in self.people)

    @property
    def cameras(self) -> Mapping[str, Camera]:
        """No cameras: BVH files define none."""
        return {}

    @property
    def avatar_names(self) -> Sequence[str]:
        """Name of each figure."""
        return tuple(one.name for one in self.people)

    @property
    def avatar_teams(self) -> Array:
        """Number of each figure's team."""
        return np.concatenate([one.avatar_teams for one in self.people])

    @property
    def avatar_scales(self) -> Array:
        """Size of each figure."""
        return np.ones(len(self.people))

    @property
    def avatar_girths(self) -> Array:
        """How thick each figure is."""
        return np.ones(len(self.people))

    @property
    def avatar_stretches(self) -> Array:
        """How long the bones of each figure are."""
        return np.ones((len(self.people), 3))

    @property
    def avatar_heights(self) -> Array:
        """How high each figure reaches [m]."""
        return np.concatenate([one.avatar_heights for one in self.people])

    @property
    def figures(self) -> Sequence[Figure]:
        """The bodies, one of each."""
        return tuple(one.figures[0] for one in self.people)

    @property
    def avatar_figures(self) -> Array:
        """Index of each figure's body."""
        return np.arange(len(self.people), dtype=np.int32)

    @property
    def avatar_colours(self) -> Array:
        """Colours of the figures: those of their teams."""
        return np.full((len(self.people), 3), np.nan)

    @property
    def arena(self) -> Array:
        """Return that the ground is open. Shape (5,)."""
        return np.zeros(5)

    def ground(self, frames: Array) -> Array:
        """Return the ground transforms at some frames. Shape (n, N, 3)."""
        return np.concatenate([one.ground(frames) for one in self.people], axis=1)

    def poses(self, frame: int, shown: Shown | None = None) -> list[tuple[Array, Array]]:
        """Return the poses at a frame, a pair a figure."""
        return [pose for one in self.people for pose in one.poses(frame)]

    def markers(self, frame: int) -> Array:
        """Return that there is nothing but the figures."""
        return np.zeros((0, 3))

    def recent_strikes(self, frame: int) -> tuple[Array, Array, Array, Array]:
        """Return that there are none."""
        return no_strikes()


def bvh_source(
    path: FileName, fps: float | None = None, lead_in: bool = False
) -> tuple[ClipSource | PeopleSource, tuple[str, ...]]:
    """Return a BVH file as a source of pictures, and findings about the file.

    A human body is measured and put on the floor; anything else gets capsules along its bones, is brought to a size
    at which it can be seen where its unit is unknown, and put on its lowest point. Several people are drawn together.

    Args:
        path: The file, or one of several people in it: ``capture.bvh#2``.
        fps: Frames a second; the file's own, halved until it is 60 at the most, by default.
        lead_in: Whether to show a calibration pose at the start too.

    Raises:
        BvhError: The file is no BVH, has no frame or has values that are not finite.
    """
    people = load_people(path)
    start = 0 if lead_in else max(capture.lead_in for capture in people)
    sources = [_person(capture, start, fps, team) for team, capture in enumerate(people)]
    findings = dict.fromkeys(finding for capture in people for finding in capture.findings)
    source = sources[0] if len(sources) == 1 else PeopleSource(Path(path).stem, sources)
    return source, tuple(findings)


def _person(capture: Capture, start: int, fps: float | None, team: int) -> ClipSource:
    """Return one person of a file as a source of pictures, from a frame on."""
    clip, grounds = shown_clip(capture, start, fps)
    return clip_source(clip, capture.body, grounds, team)


def shown_clip(capture: Capture, start: int, fps: float | None = None) -> tuple[Clip, Array | None]:
    """Return one person of a file as it is shown from a frame on, on the floor, and its ground transforms (F, 3).

    There are none of what is no human body.

    Raises:
        BvhError: There is no such frame, or a value is not finite.
    """
    path = capture.clip.source
    clip = capture.clip.sliced(start, capture.clip.frame_count)
    if clip.frame_count < 1:
        raise BvhError(with_path("no frames, expected motion to draw", path))
    if not np.isfinite(clip.rotations).all() or not np.isfinite(clip.root_positions).all():
        bad = ~(np.isfinite(clip.rotations).all(axis=(1, 2)) & np.isfinite(clip.root_positions).all(axis=1))
        raise BvhError(f"{path}:1:1: frame {start + int(np.argmax(bad))} holds a value that is no number")
    clip = resample(clip, show_rate(clip.fps, fps))
    if capture.body is None:
        return _settled(clip, capture.unit_scale is None), None
    if clip.frame_count > 1:
        clip, _ = on_floor(clip, capture.body)
    return clip, clip_tracks(clip, capture.body).ground


def _settled(clip: Clip, free: bool) -> Clip:
    """Return a clip on the floor; brought to a common size first where its scale is ``free``."""
    positions, _ = clip_kinematics(clip)
    scale = 1.0
    if free:
        size = np.median((positions.max(axis=1) - positions.min(axis=1)).max(axis=1))
        scale = _ANIMAL_SIZE / float(size) if size > 1e-9 else 1.0
    floor = np.array([0.0, scale * float(np.quantile(positions[..., 1].min(axis=1), 0.1)), 0.0])
    roots = clip.root_positions * scale - floor
    moved = clip.translations
    if moved is not None:
        moved = moved * scale
        moved[:, 0] -= floor
    return replace(clip, skeleton=clip.skeleton.scaled(scale), root_positions=roots, translations=moved)
