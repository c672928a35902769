"""The motion that a policy plays, read from its BVH files."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from _exported.plain_bvh import Array
from _exported.witness import HINGES, OTHER_SIDE, Figure, Sizes, hinge_axes, join, pose_file

MIRROR = "~mirror"


def folds(figure: Figure, sizes: Sizes) -> Array:
    """Return how far knees fold backward and elbows forward, 1 wholly and -1 the other way, in the rest pose's frame.

    Shape (4,). In the rest pose joints are not turned, so that forward is what is square to the hips and up.
    """
    rest, forward = sizes.rest(), sizes.forward()
    outcome = []
    for hinge, axis in zip(HINGES, hinge_axes(figure), strict=True):
        side, what = hinge.split("_")
        upper = rest[sizes.roles[f"{side}_{'hip' if what == 'knee' else 'shoulder'}"]]
        way = np.cross(axis, rest[sizes.roles[hinge]] - upper)
        outcome.append((-1.0 if what == "knee" else 1.0) * float(np.dot(way, forward)) / np.linalg.norm(way))
    return np.array(outcome)


def mirror(figure: Figure) -> Figure:
    """Return a figure's mirror image in x = 0."""
    flip = np.array([-1.0, 1.0, 1.0])
    swapped = [1, 0, 3, 2]
    return Figure(
        joints=figure.joints[:, OTHER_SIDE] * flip,
        fists=figure.fists[:, ::-1] * flip,
        head=figure.head * flip,
        soles=figure.soles[:, ::-1] * flip,
        # Frames of joints are mirrored too; a cross product keeps its part along the mirror's normal.
        crosses=figure.crosses[:, swapped] * -flip,
        dots=figure.dots[:, swapped],
        turns=figure.turns[:, OTHER_SIDE] * np.outer(flip, flip),
        pelvises=figure.pelvises * flip,
        faces=figure.faces * flip,
    )


def ground(figure: Figure, fps: float) -> float:
    """Return the height of the floor under a figure: the median of its lowest sole over its stiller half."""
    soles = figure.soles.reshape(len(figure.soles), 4, 3)
    speeds = np.linalg.norm(np.diff(soles, axis=0), axis=-1).min(axis=1) * fps
    still = np.flatnonzero(speeds <= np.median(speeds))
    return float(np.median(soles[still, :, 1].min(axis=1)))


@dataclass(frozen=True)
class Source:
    """The captured motion that a policy plays, by the database's playback frames.

    Attributes:
        figure: What it shows there, its floor at 0.
        clips: Clip of each frame; a clip and its mirror image have one number. Shape (P,).
        starts: First playback frame of each clip, mirror images counted apart, and the end.
        apart: How far roots of the bundle's database lie from those of the files at the most, over the floor [m].
        floors: How far the two disagree on each clip's floor [m]. Shape (clips,).
        backward: Clips whose knees fold forward or elbows backward in the file, seen from the rest pose, and which.
            Such elbows are turned here.
    """

    figure: Figure
    clips: Array
    starts: Array
    apart: float
    floors: Array
    backward: list[tuple[str, str]]


def read_source(paths: list[Path], sizes: Sizes) -> Source:
    """Read the clips of a policy from their files, frames in the order of its database."""
    found = {path.stem: path for path in paths}
    parts: list[Figure] = []
    numbers: list[int] = []
    clips: list[Array] = []
    floors: list[float] = []
    backward: list[tuple[str, str]] = []
    apart = 0.0
    starts = sizes.clip_starts * sizes.stride
    seen: dict[str, tuple[int, Figure]] = {}
    for clip, name in enumerate(sizes.clip_names):
        low, high = starts[clip], starts[clip + 1]
        plain = name.removesuffix(MIRROR)
        if name.endswith(MIRROR):
            number, shown = seen[plain]
            parts.append(mirror(shown))
        else:
            posed = pose_file(found[plain], sizes)
            wrong = [HINGES[k] for k in np.flatnonzero(folds(posed.figure, sizes) < 0.0)]
            backward += [(plain, hinge) for hinge in wrong]
            if wrong:
                posed = pose_file(found[plain], sizes, tuple(name for name in wrong if "elbow" in name))
            figure, fps = posed.figure, posed.fps
            step, roots = round(fps / sizes.rate), sizes.roots[low:high]
            # Where the database begins in the file, which may open with a calibration pose.
            last = len(figure.joints) - step * (high - low - 1)
            own = figure.joints[:, 0]
            level = [0, 2]
            gaps = [np.abs(own[k::step][: high - low, level] - roots[:, level]).max() for k in range(last)]
            begin = int(np.argmin(gaps))
            apart = max(apart, float(gaps[begin]))
            shown = figure.part(slice(begin, begin + step * (high - low), step))
            floor = ground(figure.part(slice(begin, None)), fps)
            floors.append(float(np.median(shown.joints[:, 0, 1] - roots[:, 1])) - floor)
            shown = _lowered(shown, floor)
            number = len(seen)
            seen[plain] = number, shown
            parts.append(shown)
        numbers.append(number)
        clips.append(np.full(high - low, number))
    return Source(join(parts), np.concatenate(clips), starts, apart, np.array(floors), backward)


def _lowered(figure: Figure, floor: float) -> Figure:
    down = np.array([0.0, floor, 0.0])
    return replace(
        figure,
        joints=figure.joints - down,
        fists=figure.fists - down,
        head=figure.head - down,
        soles=figure.soles - down,
    )
