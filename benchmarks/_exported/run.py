"""What a run's files show: posed avatars, the source motion behind them, and when avatars chose and struck."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zarr

from _exported.plain_bvh import Array
from _exported.witness import JOINTS, Figure, Sizes, pose_file, read_sizes
from _exported.witness_source import Source, read_source

PELVIS = JOINTS.index("pelvis")
BLOCKED = 2
"""Number of blocked strikes among the outcomes of a take."""
WORST = 10
"""How many moments are kept of a measure."""


@dataclass(frozen=True)
class ExportedRun:
    """A run as its BVH files show it; N avatars over F frames.

    Attributes:
        sizes: Numbers of the policy's bundle.
        source: The motion that the policy was trained on.
        names: Name of each avatar, the stem of its file. Length N.
        figures: The avatars.
        capsules: Ends of the capsules of each in the world [m]. Length N, each (F, K, 2, 3), float32.
        scales: Size of each, from its bones. Shape (N,).
        speeds: Pace of each, from the take. Shape (N,).
        girths: Girth of each, from the take. Shape (N,).
        sexes: Sex of each, from the take. Length N.
        fps: Frames a second.
        frames: Playback frame of the source at each output frame. Shape (N, F).
        decisions: Of each avatar the times at which it chose [s], the playback frame that it left, and the one that it
            went on from. Shape (n, 3) each.
        opponents: Opponent of each at each output frame, negative for no avatar. Shape (N, F).
        events: Strikes of the take by name: seconds, attacker, victim, limb (left hand, right hand, left foot, right
            foot), landed, blocked, speed [m/s].
    """

    sizes: Sizes
    source: Source
    names: list[str]
    figures: list[Figure]
    capsules: list[Array]
    scales: Array
    speeds: Array
    girths: Array
    sexes: list[str]
    fps: int
    frames: Array
    decisions: list[Array]
    opponents: Array
    events: dict[str, Array]

    @property
    def step(self) -> int:
        """Playback frames in an output frame."""
        return round(self.sizes.rate / self.fps)

    @property
    def count(self) -> int:
        """Number of output frames."""
        return len(self.figures[0].head)

    @property
    def seconds(self) -> Array:
        """Time of each output frame [s]. Shape (F,)."""
        return np.arange(self.count) / self.fps

    @property
    def minutes(self) -> float:
        """Minutes of all avatars together."""
        return len(self.figures) * self.count / self.fps / 60.0

    def transitions(self, avatar: int) -> Array:
        """Times of an avatar's transitions [s]. Shape (n,)."""
        chosen = self.decisions[avatar]
        return np.asarray(chosen[chosen[:, 1] != chosen[:, 2], 0])

    def strikes(self) -> list[Strike]:
        """Strikes at avatars that lie within the run."""
        names = ("seconds", "attacker", "victim", "limb", "landed")
        rows = [Strike(*row) for row in zip(*(self.events[name].tolist() for name in names), strict=True)]
        return [one for one in rows if one.victim >= 0 and 1 <= one.seconds * self.fps <= self.count - 2]

    def near(self, times: Array, before: float, after: float) -> Array:
        """Output frames from ``before`` to ``after`` seconds around any of some times. Shape (F,), bool."""
        marks = np.zeros(self.count + 1, int)
        first = np.clip(np.ceil((times - before) * self.fps - 1e-6), 0, self.count).astype(int)
        stop = np.clip(np.floor((times + after) * self.fps + 1e-6) + 1, 0, self.count).astype(int)
        np.add.at(marks, first, 1)
        np.add.at(marks, stop, -1)
        return np.asarray(np.cumsum(marks[:-1]) > 0)


@dataclass(frozen=True)
class Strike:
    """A strike at another avatar; see ``ExportedRun.events``."""

    seconds: float
    attacker: int
    victim: int
    limb: int
    landed: bool


def worst_moments(values: Array, avatars: Array, frames: Array, fps: float, **more: Any) -> list[dict[str, Any]]:
    """Return the moments of the greatest values, no two of one avatar within a second.

    Args:
        values: What is measured. Shape (n,).
        avatars: Whose it is. Shape (n,).
        frames: Output frames. Shape (n,).
        fps: Output frames a second.
        **more: Further columns, sequences of length n.
    """
    kept: list[dict[str, Any]] = []
    for row in np.argsort(-np.asarray(values, float), kind="stable"):
        avatar, frame = int(avatars[row]), int(frames[row])
        if all(one["avatar"] != avatar or abs(one["frame"] - frame) > fps for one in kept):
            columns = {name: column[row] for name, column in more.items()}
            plain = {name: one.item() if isinstance(one, np.generic) else one for name, one in columns.items()}
            kept.append({"value": float(values[row]), "avatar": avatar, "frame": frame, **plain})
        if len(kept) == WORST:
            break
    return kept


def typical_moments(values: Array, avatars: Array, frames: Array, fps: float, **more: Any) -> list[dict[str, Any]]:
    """Return the moments whose values are nearest to the median; see ``worst_moments``."""
    off = np.abs(np.asarray(values, float) - np.median(values))
    return worst_moments(-off, avatars, frames, fps, value=np.asarray(values, float), **more)


def between_frames(path: Array, frame: float) -> Array:
    """Return a path (F, ...) between its frames, by a cubic through four of them."""
    low = int(np.clip(np.floor(frame + 1e-6), 1, len(path) - 3))
    u = frame - low
    a, b, c, d = path[low - 1 : low + 3]
    return np.asarray(b + 0.5 * u * (c - a + u * (2 * a - 5 * b + 4 * c - d + u * (3 * (b - c) + d - a))))


def playback(
    sizes: Sizes, action: Array, phase: Array, pace: float, seconds: Array, rate: float
) -> tuple[Array, Array]:
    """Return where an avatar is in the source, from the actions of the take.

    Args:
        sizes: Numbers of the bundle.
        action: Its action in each control frame. Shape (C,).
        phase: Control frames of it done. Shape (C,).
        pace: Motion frames in a control frame.
        seconds: Times that are asked for. Shape (F,).
        rate: Control frames a second.

    Returns:
        The playback frame at each time, shape (F,); and of each decision its time [s], the playback frame that it left
        and the one that it went on from, shape (n, 3).
    """
    phase = np.minimum(phase, sizes.lengths[action])
    fresh = np.concatenate([[True], (action[1:] != action[:-1]) | (phase[1:] < phase[:-1] + 0.5 * pace)])
    clock = seconds * rate
    now = np.minimum(np.floor(clock + 1e-6).astype(int), len(action) - 1)
    later = np.minimum(now + 1, len(action) - 1)
    part = clock - now
    began = np.where((later > now) & fresh[later], 1.0 - phase[later] / pace, np.inf)
    # Beyond the last control frame motion goes on as captured.
    gone = np.minimum(phase[now] + part * pace, np.where(later > now, sizes.lengths[action[now]], np.inf))
    new = part >= began - 1e-6
    ahead = np.where(new, part - np.where(new, began, 0.0), 0.0) * pace
    frames = np.where(
        new, sizes.first[action[later]] + ahead * sizes.stride, sizes.first[action[now]] + gone * sizes.stride
    )
    rows = np.flatnonzero(fresh[1:]) + 1
    left = sizes.first[action[rows - 1]] + sizes.lengths[action[rows - 1]] * sizes.stride
    return frames, np.stack([(rows - phase[rows] / pace) / rate, left, sizes.first[action[rows]]], axis=1)


def read_run(run: Path, bundle: Path, clips: list[Path]) -> ExportedRun:
    """Read a run.

    Args:
        run: Its folder, with BVH files.
        bundle: The policy's bundle.
        clips: Files of the motion that the policy was trained on.

    Raises:
        ValueError: The run is none of this bundle, or avatars are not there all the time.
    """
    group: Any = zarr.open_group(store=str(run / "take.zarr"), mode="r")
    control = float(group.attrs["control_rate"])
    fingerprint = json.loads((bundle / "policy.json").read_text())["fingerprint"]
    if fingerprint != group.attrs["policy_fingerprints"][0]:
        raise ValueError(f"{run}: {bundle} is not the bundle that it was run with")
    sizes = read_sizes(bundle)
    action, phase = np.asarray(group["action"][:]).astype(int), np.asarray(group["action_frame"][:]).astype(float)
    if (action < 0).any():
        raise ValueError(f"{run}: avatars come late or leave, expected all of them all the time")
    posed = [pose_file(run / "bvh" / f"{name}.bvh", sizes) for name in group["name"][:]]
    fps, speeds = round(posed[0].fps), np.asarray(group["speed"][:]).astype(float)
    if fps > sizes.rate or sizes.rate % fps:
        raise ValueError(
            f"{run}: has BVH files of {fps} frames a second, expected {sizes.rate:g} or a whole part of it"
        )
    seconds = np.arange(len(posed[0].figure.head)) / fps
    played = [playback(sizes, action[:, n], phase[:, n], pace, seconds, control) for n, pace in enumerate(speeds)]
    strikes = group["events"]
    events = {name: np.asarray(strikes[name][:]) for name in ("attacker", "victim", "landed")}
    rows = np.minimum((seconds * control + 1e-6).astype(int), len(action) - 1)
    # A take names bodies of types where some are not the usual one.
    bodies = [one["sex"] for one in group.attrs.get("type_bodies", [])] or ["male"] * len(group.attrs["type_names"])
    return ExportedRun(
        sizes=sizes,
        source=read_source(clips, sizes),
        names=list(group["name"][:]),
        figures=[one.figure for one in posed],
        capsules=[one.capsules for one in posed],
        scales=np.array([one.scale for one in posed]),
        speeds=speeds,
        girths=np.asarray(group["girth"][:]).astype(float),
        sexes=[bodies[kind] for kind in np.asarray(group["type"][:]).tolist()],
        fps=fps,
        frames=np.stack([frames for frames, _ in played]),
        decisions=[decisions for _, decisions in played],
        opponents=np.asarray(group["opponent"][:]).astype(int)[rows].T,
        events={
            **events,
            "seconds": np.asarray(strikes["frame"][:]).astype(float) / control,
            "limb": np.asarray(strikes["limb" if "limb" in strikes else "hand"][:]).astype(int),
            "landed": events["landed"].astype(bool),
            "speed": np.asarray(strikes["speed"][:]).astype(float),
            "blocked": np.asarray(strikes["outcome"][:]) == BLOCKED,
        },
    )
