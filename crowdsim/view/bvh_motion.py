"""BVH files as motion for the player."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from crowdsim.body.palette import avatar_paints
from crowdsim.bvh.people import split_person
from crowdsim.capture.loading import ANALYSIS_RATE, Capture, load_people
from crowdsim.core.types import Array, FileName
from crowdsim.errors import BvhError
from crowdsim.files import entries, exists_plain, read_plain
from crowdsim.motion import ground
from crowdsim.motion.contacts import runs
from crowdsim.motion.skeleton import Clip
from crowdsim.motion.strikes import LIMBS
from crowdsim.poses.builds import joint_segments
from crowdsim.render.bvh_figure import PeopleSource, clip_source, show_rate, shown_clip
from crowdsim.render.crowd_path import watch
from crowdsim.render.figure import bone_capsules
from crowdsim.scenario.frame_ranges import parse_frames
from crowdsim.view.recording import Recording, describe_figure, pack_paints, plan_cameras

MOST_FILES = 200
"""Most files of a folder that are shown together."""
_GAP = 1.0
"""Room between people of several files that are shown side by side [m]."""
AVATAR_LIST, _LONGEST_LIST = "avatars.csv", 64 << 20
"""Beside this list, which is no longer, files of a folder are avatars of one world."""


def is_bvh(path: Path) -> bool:
    """Whether a path names a BVH file, or one person in it, or a folder that has BVH files and is no run."""
    return split_person(path)[0].suffix.lower() == ".bvh" or (path.is_dir() and bool(bvh_files(path)))


def bvh_files(folder: Path) -> list[Path]:
    """Return the BVH files in a folder, by name."""
    return [folder / name for name in entries(folder) if name.lower().endswith(".bvh") and exists_plain(folder, name)]


def record_bvh(
    path: FileName, fps: float | None = None, frames: str | None = None, avatars: Sequence[int] | None = None
) -> tuple[Recording, tuple[str, ...]]:
    """Return a BVH file, or those of a folder, for the player; and findings about them.

    People of several files stand side by side, those that ``export`` wrote where they are in their world.

    Args:
        path: The file, one person in it (``capture.bvh#2``), or the folder.
        fps: Frames a second; the first file's own, halved until it is 60 at the most, when None.
        frames: Frames ``A:B``, in frames or seconds; all when None.
        avatars: Numbers of the people, from 0; all when None.

    Raises:
        BvhError: A file is no BVH, has no frame or has values that are not finite, or there is no such person.
        TakeError: There are no such frames.
    """
    path = Path(path)
    found = bvh_files(path) if path.is_dir() else [path]
    if len(found) > MOST_FILES:
        raise BvhError(f"{path}: holds {len(found)} BVH files, expected {MOST_FILES} at most")
    people: list[tuple[str, Capture]] = []
    findings: list[str] = []
    for file in found:
        captures = load_people(file)
        single = len(captures) == 1
        people += [
            (file.stem if single else f"{file.stem}#{number}", one) for number, one in enumerate(captures, start=1)
        ]
        findings += [f"{file.name}: {line}" for one in captures for line in one.findings]
    if avatars is not None:
        if max(avatars) >= len(people):
            raise BvhError(f"{path}: there is no person {max(avatars)}, expected 0 to {len(people) - 1}")
        people = [people[avatar] for avatar in avatars]
    rate = show_rate(people[0][1].clip.fps, fps)
    delays = _read_delays(path) if path.is_dir() else {}
    in_world = len(found) == 1 or bool(delays)
    motion = BvhMotion(
        [name for name, _ in people],
        [one for _, one in people],
        rate,
        frames,
        [delays.get(Path(one.clip.source).name, 0) for _, one in people] if in_world else None,
        lead_in=bool(delays),
    )
    source = _Comers(path.stem, motion.sources(), motion.stays())
    tracks, sun = plan_cameras(source, watch(source), motion.first, motion.frames, True)
    motion.sun = sun
    return Recording(motion, path.stem, tracks), tuple(dict.fromkeys(findings))


class BvhMotion:
    """Motion of people of BVH files; a ``recording.Motion``. Each has a figure of its own.

    Args:
        names: What they are called.
        captures: The people.
        fps: Frames a second.
        frames: Frames ``A:B``; all when None.
        delays: Frames of each file after which each of them begins, where all are in one world; side by side when None.
        lead_in: Whether calibration poses at the start are shown.
    """

    def __init__(
        self,
        names: Sequence[str],
        captures: Sequence[Capture],
        fps: float,
        frames: str | None,
        delays: Sequence[int] | None,
        lead_in: bool,
    ) -> None:
        self.names, self.captures, self.fps, self.avatars = list(names), list(captures), fps, len(names)
        self.sun = np.array([0.3, 0.8, 0.5])
        self.starts = [0 if lead_in else capture.lead_in for capture in captures]
        if delays is not None:
            self.starts = [max(self.starts)] * len(captures)
        self.delays = [
            round(delay * fps / capture.clip.fps)
            for delay, capture in zip(delays or [0] * len(captures), captures, strict=True)
        ]
        shown = [shown_clip(one, start, fps) for one, start in zip(captures, self.starts, strict=True)]
        self.clips, self.grounds = [clip for clip, _ in shown], [ground for _, ground in shown]
        if delays is None:
            self._stand_side_by_side()
        longest = max(end for _, end in self.stays())
        self.first, stop = (0, longest) if frames is None else parse_frames(frames).resolve(longest, fps)
        self.frames = stop - self.first
        self._figures = []
        for clip, capture in zip(self.clips, captures, strict=True):
            body = capture.body
            figure = bone_capsules(clip.skeleton) if body is None else body
            joints = clip.skeleton.joint_count
            segments = np.zeros(joints, int) if body is None else joint_segments(clip.skeleton, body)
            moving = [0] if clip.translations is None else list(range(joints))
            self._figures.append(describe_figure(clip.skeleton, figure, segments, moving))
        self.bits = [np.array(figure["bits"]) for figure in self._figures]

    def _stand_side_by_side(self) -> None:
        """Move each clip along x, so that none is where another one is."""
        edge = 0.0
        for i, clip in enumerate(self.clips):
            roots = clip.root_positions
            reach = max(0.5, 0.5 * float(np.linalg.norm(clip.skeleton.rest_positions().max(axis=0))))
            low, high = float(roots[:, 0].min()) - reach, float(roots[:, 0].max()) + reach
            shift = np.array([edge - low, 0.0, -float(roots[:, 2].mean())])
            edge += high - low + _GAP
            self.clips[i] = _moved(clip, shift)
            grounds = self.grounds[i]
            self.grounds[i] = None if grounds is None else grounds + np.array([shift[0], shift[2], 0.0])

    def stays(self) -> list[tuple[int, int]]:
        """Return the first frame of each person and one past the last."""
        return [(delay, delay + clip.frame_count) for delay, clip in zip(self.delays, self.clips, strict=True)]

    def sources(self) -> list[Any]:
        """Return each person as a source of pictures, which cameras look at."""
        return [
            clip_source(clip, capture.body, grounds, team)
            for team, (clip, capture, grounds) in enumerate(zip(self.clips, self.captures, self.grounds, strict=True))
        ]

    def poses(self, start: int, stop: int) -> list[tuple[Array, Array]]:
        """Return poses of frames ``start`` to ``stop``, counted from the first."""
        found = []
        frames = np.arange(self.first + start, self.first + stop)
        for clip, (begin, end) in zip(self.clips, self.stays(), strict=True):
            rows = np.clip(frames - begin, 0, clip.frame_count - 1)
            moves = clip.root_positions[rows, None] if clip.translations is None else clip.translations[rows]
            moves[(frames < begin) | (frames >= end)] = np.nan
            found.append((moves[:, None], clip.rotations[rows][:, None]))
        return found

    def describe(self) -> tuple[dict[str, Any], dict[str, Array]]:
        """Return what the player shows beside motion."""
        count = self.avatars
        teams = np.arange(count)
        paints = avatar_paints(teams if count > 1 else np.zeros(1, int))
        heights = [
            float(clip.root_positions[:, 1].max()) if capture.body is None else capture.body.height
            for clip, capture in zip(self.clips, self.captures, strict=True)
        ]
        stays = np.clip(np.array(self.stays()) - self.first, 0, self.frames)
        document = {
            "kind": "bvh",
            "arena": [0.0] * 5,
            "sun": [round(float(value), 5) for value in self.sun],
            "rate": self.fps,
            "names": self.names,
            "teams": [],
            "team_colours": [],
            "types": [],
            "figures": self._figures,
            "limbs": list(LIMBS),
            "outcomes": ["thrown"],
            "targets": [],
            "clips": [],
        }
        tables = {
            "figure": np.arange(count, dtype=np.int32),
            "scale": np.ones(count, np.float32),
            "girth": np.ones(count, np.float32),
            "stretch": np.ones((count, 3), np.float32),
            "height": np.array(heights, np.float32),
            "paint": pack_paints(paints),
            "present": np.column_stack([np.arange(count), stays])[stays[:, 1] > stays[:, 0]].astype(np.int32),
            **self._found(),
        }
        return document, tables

    def _found(self) -> dict[str, Array]:
        """Return contacts of feet and strikes of all people whose motion could be analysed."""
        contacts: list[tuple[int, int, float, float]] = []
        strikes: list[tuple[float, int, int, Array, float]] = []
        for person, capture in enumerate(self.captures):
            analysis, start = capture.analysis, self.starts[person] / capture.clip.fps
            if analysis is None:
                continue
            offset = capture.start - start + self.delays[person] / self.fps
            for foot in (0, 1):
                for low, high in runs(analysis.contacts[:, foot]):
                    contacts.append((person, foot, low / ANALYSIS_RATE + offset, high / ANALYSIS_RATE + offset))
            found = analysis.strikes
            points = ground.to_world(analysis.tracks.ground[found.frames], found.positions)
            # The analysis puts motion on its floor by itself.
            grounds = self.grounds[person]
            shift = np.zeros(3)
            if grounds is not None:
                row = int(np.clip(round((capture.start - start) * self.fps), 0, len(grounds) - 1))
                gap = grounds[row, :2] - analysis.tracks.ground[0, :2]
                shift = np.array([gap[0], 0.0, gap[1]])
            for at, limb, point, speed in zip(found.frames, found.limbs, points, found.speeds, strict=True):
                strikes.append((int(at) / ANALYSIS_RATE + offset, person, int(limb), point + shift, float(speed)))
        begin, end = self.first / self.fps, (self.first + self.frames) / self.fps
        strikes = sorted((one for one in strikes if begin <= one[0] < end), key=lambda strike: strike[:2])
        count = len(strikes)
        return {
            "contact": np.array([row[:2] for row in contacts], np.int32).reshape(-1, 2),
            "contact_time": np.array([row[2:] for row in contacts], np.float32).reshape(-1, 2),
            "strike_time": np.array([row[0] for row in strikes], np.float32),
            "strike_attacker": np.array([row[1] for row in strikes], np.int32),
            "strike_victim": np.full(count, -1, np.int32),
            "strike_limb": np.array([row[2] for row in strikes], np.uint8),
            "strike_outcome": np.zeros(count, np.uint8),
            "strike_down": np.zeros(count, np.uint8),
            "strike_point": np.array([row[3] for row in strikes], np.float32).reshape(-1, 3),
            "strike_speed": np.array([row[4] for row in strikes], np.float32),
            "strike_damage": np.zeros(count, np.float32),
        }


@dataclass(frozen=True)
class _Comers(PeopleSource):
    """People of whom each comes and goes.

    Attributes:
        stays: First frame of each and one past the last.
    """

    stays: Sequence[tuple[int, int]] = ()

    @property
    def frame_count(self) -> int:
        """Number of frames until all have gone."""
        return max(end for _, end in self.stays)

    def ground(self, frames: Array) -> Array:
        """Return the ground transforms at some frames, NaN of those who are not there. Shape (n, N, 3)."""
        found = []
        for one, (begin, end) in zip(self.people, self.stays, strict=True):
            rows = one.ground(np.clip(frames - begin, 0, end - begin - 1)).astype(float)
            rows[(frames < begin) | (frames >= end)] = np.nan
            found.append(rows)
        return np.concatenate(found, axis=1)


def _moved(clip: Clip, shift: Array) -> Clip:
    """Return a clip elsewhere."""
    moved = clip.translations
    if moved is not None:
        moved = moved.copy()
        moved[:, 0] += shift
    return replace(clip, root_positions=clip.root_positions + shift, translations=moved)


def _read_delays(folder: Path) -> dict[str, int]:
    """Return the first frame of each file that ``export`` wrote into a folder; none where it wrote none."""
    if not exists_plain(folder, AVATAR_LIST):
        return {}
    rows = csv.DictReader(read_plain(folder, AVATAR_LIST, _LONGEST_LIST).decode("utf-8", "replace").splitlines())
    try:
        found = [(row.get("file") or "", row.get("first_frame") or "") for row in rows]
    except csv.Error as error:
        raise BvhError(f"{folder / AVATAR_LIST}: no list of avatars: {error}") from None
    return {file: int(frame) for file, frame in found if file and re.fullmatch("[0-9]{1,9}", frame)}


def parse_people(text: str | None) -> list[int] | None:
    """Return the numbers of people that '0-2,5' means, ascending; None for all.

    Raises:
        BvhError: It means none.
    """
    if text is None:
        return None
    numbers: set[int] = set()
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,6})\s*(?:-\s*(\d{1,6})\s*)?", part)
        if match is None or int(match[2] or match[1]) < int(match[1]):
            raise BvhError(f"avatars {text!r}: expected numbers and ranges of them, as in 0-2,5")
        numbers.update(range(int(match[1]), int(match[2] or match[1]) + 1))
    return sorted(numbers)
