"""What follows a knock-down and what fills a break, measured from takes and from the BVH files of whole runs.

Poses come from the files, by the reader of ``_exported``. Times are counted from the blow. No window is chosen: every
knock-down counts whose next seconds are inside the run, and every break. Figures:

- `struck_after`: strikes that victims throw within 2 s after the blow that knocks them down.
- `left_within`: share of falls that begin within 0.1 s of the blow, by the take.
- `crumple_down`, `topple_down`: share of falls in which the pelvis is 20 % lower within 0.4 s where the trunk is less
  than 40 degrees off upright then, and within 0.8 s where it is further off.
- `most_frequent`: share of the fall that is seen most often, by the motion that the take names, mirrored or not;
  `alike` is the share of the largest group of falls in the files: two are alike where the mean joint is less than 12 cm
  apart at four times within 1.2 s, one of them mirrored or not.
- `poses`: how many different ways to lie there are 2.5 s after blows, by the files likewise. Both are goals of scenes
  with ten knock-downs and more.
- `attacker_faces`: share of knock-downs after which the attacker's head points within 45 degrees of the fallen's pelvis
  for nine tenths of 1.5 s. Attackers that are knocked down meanwhile do not count.
- `someone_looks`: share of knock-downs with others standing within 3 m, one of which looks at the fallen within 20
  degrees for half a second, within 3 s, without fighting it.
- `astride`: share of the time that bodies lie in which another stands with its pelvis over a trunk or thighs.
- `dropped`, `apart`, `faces`: share of boxers in breaks that hang both hands within 3 s and go on so until the break's
  last second; that are no more than 0.5 m nearer to one another from then on than asked for; whose chest is within 60
  degrees of the opponent or of the middle of the ring.
- `struck_early`: strikes thrown in breaks, or before both guards are up again.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from _exported.plain_bvh import pose, read_plain
from _scene_goals import Goal

import crowdsim
from _fights.breaks import BREAKS
from crowdsim.core.types import Array
from crowdsim.take.take import Take

GOALS = {
    "struck_after": ("strikes of victims after the blow", Goal(most=0.0)),
    "left_within": ("falls begin within 0.1 s", Goal(least=0.95)),
    "crumple_down": ("crumple: pelvis down by 20 % within 0.4 s", Goal(least=0.95)),
    "topple_down": ("topple: pelvis down by 20 % within 0.8 s", Goal(least=0.95)),
    "most_frequent": ("share of the most frequent fall", Goal(most=0.2)),
    "alike": ("share of the largest group of falls alike", Goal(most=0.2)),
    "poses": ("different ways to lie", Goal(least=8.0)),
    "attacker_faces": ("attackers face the fallen for 1.5 s", Goal(least=0.8)),
    "someone_looks": ("someone within 3 m looks", Goal(least=0.6)),
    "astride": ("time in which others stand astride the lying", Goal(most=0.01)),
}
BREAK_GOALS = {
    "dropped": ("hands hang within 3 s of a break", Goal(least=1.0)),
    "apart": ("and boxers are as far apart as asked", Goal(least=1.0)),
    "faces": ("and face the opponent or the middle", Goal(least=1.0)),
    "struck_early": ("strikes in breaks or before both guards are up", Goal(most=0.0)),
}
"""Label and goal of each figure, the latter after knock-downs and in breaks."""
MANY = 10
"""Knock-downs from which on there is a goal for how falls differ."""
ASKED = 3.0
"""Distance that `bout` asks for in breaks [m]."""
_SAME, _AT, _LIES = 0.12, (0.3, 0.6, 0.9, 1.2), 2.5
_SHOWN = (
    "Hips", "Spine2", "Head", "LeftForeArm", "LeftHand", "LeftLeg", "LeftFoot", "RightForeArm", "RightHand", "RightLeg",
    "RightFoot",
)  # fmt: skip
_MIRROR = (0, 1, 2, 7, 8, 9, 10, 3, 4, 5, 6)
HIPS = 0


class Posed(NamedTuple):
    """The files of a run; N avatars, F frames.

    Attributes:
        take: The take.
        joints: Positions of ``_SHOWN``. Shape (N, F, 11, 3), float32.
        neck: Position of the neck. Shape (N, F, 3).
        looks, chests: Directions of face and chest over the ground. Shape (N, F, 2).
        fps: Frames a second.
    """

    take: Take
    joints: Array
    neck: Array
    looks: Array
    chests: Array
    fps: float


def read_posed(folder: Path) -> Posed:
    """Read the take and the files of a run."""
    take = crowdsim.open_run(folder)
    take = replace(take, action=np.asarray(take.action), action_frame=np.asarray(take.action_frame))
    joints, necks, looks, chests = [], [], [], []
    fps = 0.0
    for name in take.cast.names:
        bvh = read_plain(folder / "bvh" / f"{name}.bvh")
        positions, turns = pose(bvh)
        fps = round(bvh.fps)
        joints.append(positions[:, [bvh.names.index(one) for one in _SHOWN]].astype(np.float32))
        necks.append(positions[:, bvh.names.index("Neck")].astype(np.float32))
        looks.append(turns[:, bvh.names.index("Head")][:, [0, 2], 2].astype(np.float32))
        chests.append(turns[:, bvh.names.index("Spine2")][:, [0, 2], 2].astype(np.float32))
    return Posed(take, np.stack(joints), np.stack(necks), np.stack(looks), np.stack(chests), fps)


def _angle(ways: Array, towards: Array) -> Array:
    """Return the angle between directions over the ground [degrees]. Shape (...)."""
    cross = ways[..., 0] * towards[..., 1] - ways[..., 1] * towards[..., 0]
    return np.degrees(np.abs(np.arctan2(cross, np.sum(ways * towards, axis=-1))))


def _level(points: Array) -> Array:
    return points[..., [0, 2]]


def _standing(posed: Posed) -> Array:
    """Return which avatars stand. Shape (N, F), bool."""
    heights = posed.joints[..., HIPS, 1]
    return heights > 0.75 * np.median(heights, axis=1, keepdims=True)


def _seen_from_pelvis(joints: Array, heading: float) -> Array:
    """Return poses (T, 11, 3) seen from where the pelvis is over the ground in the first, both ways round. (2, ...)."""
    cos, sin = np.cos(heading), np.sin(heading)
    moved = joints - joints[:1, :1] * [1.0, 0.0, 1.0]
    turned = np.stack(
        [moved[..., 0] * cos - moved[..., 2] * sin, moved[..., 1], moved[..., 0] * sin + moved[..., 2] * cos], axis=-1
    )
    return np.stack([turned, turned[:, _MIRROR] * [-1.0, 1.0, 1.0]])


def _groups(poses: Sequence[Array]) -> Array:
    """Return sizes of groups of poses that are alike, the greatest first: each belongs to the first that it is like."""
    leaders: list[Array] = []
    sizes: list[int] = []
    for both in poses:
        gaps = [np.linalg.norm(both - one[0], axis=-1).mean(axis=(1, 2)).min() for one in leaders]
        if gaps and min(gaps) < _SAME:
            sizes[int(np.argmin(gaps))] += 1
        else:
            leaders.append(both)
            sizes.append(1)
    return np.sort(np.array(sizes, int))[::-1]


def _falls(posed: Posed, falls: Array, motion: Array) -> Iterator[dict[str, Any]]:
    """Yield what follows each knock-down."""
    take, fps = posed.take, posed.fps
    events, rate = take.events, take.control_rate
    standing = _standing(posed)
    count = posed.joints.shape[1]
    heights = posed.joints[..., HIPS, 1]
    action = np.asarray(take.action)
    for k in np.flatnonzero(events.down):
        victim, attacker, blow = int(events.victim[k]), int(events.attacker[k]), float(events.frame[k])
        at = blow / rate * fps
        first = int(np.ceil(at))
        if first + 3.2 * fps >= count:
            continue
        own = events.attacker == victim
        after = own & (events.frame > blow + 1e-4) & (events.frame <= blow + 2.0 * rate)
        row = int(np.ceil(blow))
        began = np.flatnonzero(np.isin(action[row : row + round(3 * rate), victim], falls))
        left, kind = np.inf, -1
        if len(began):
            begin = row + int(began[0])
            phase = float(np.asarray(take.action_frame[begin])[victim]) / float(take.cast.speeds[victim])
            left = max(begin - phase - blow, 0.0) / rate
            kind = int(motion[np.flatnonzero(falls == action[begin, victim])[0]])
        usual = heights[victim, max(first - round(0.5 * fps), 0) : first + 1].mean()
        low = first + int(np.argmax(heights[victim, first : first + 3 * round(fps)] < 0.8 * usual))
        trunk = posed.neck[victim, low] - posed.joints[victim, low, HIPS]
        tilt = np.degrees(np.arctan2(np.hypot(trunk[0], trunk[2]), trunk[1]))
        pelvis = _level(posed.joints[victim, :, HIPS])
        stop = first + round(1.5 * fps)
        face = _angle(posed.looks[attacker, first:stop], pelvis[first:stop] - _level(posed.neck[attacker, first:stop]))
        felled = (events.victim == attacker) & events.down & (np.abs(events.frame - blow) <= 1.5 * rate)
        heading = float(np.arctan2(*posed.chests[victim, first]))
        frames = first + np.round(np.array(_AT) * fps).astype(int)
        lies = first + round(_LIES * fps)
        way = posed.neck[victim, lies] - posed.joints[victim, lies, HIPS]
        yield {
            "struck": int(after.sum()),
            "left": left,
            "kind": kind,
            "down": (low - at) / fps,
            "tilt": tilt,
            "fall": _seen_from_pelvis(posed.joints[victim, frames], heading),
            "lying": _seen_from_pelvis(posed.joints[victim, lies][None], float(np.arctan2(way[0], way[2]))),
            "faces": None if felled.any() else float(np.mean(face < 45.0)) >= 0.9,
            "looks": _someone_looks(posed, standing, victim, attacker, first, pelvis),
        }


def _someone_looks(posed: Posed, standing: Array, victim: int, attacker: int, first: int, pelvis: Array) -> bool | None:
    """Return whether another avatar near a fallen one looks at it; None where nobody is near."""
    fps = posed.fps
    last = first + round(3.0 * fps)
    near = looked = False
    for other in range(len(posed.joints)):
        if other in (victim, attacker):
            continue
        away = pelvis[first:last] - _level(posed.neck[other, first:last])
        here = (np.linalg.norm(away, axis=-1) < 3.0) & standing[other, first:last]
        near |= bool(here[: round(fps)].any())
        runs = np.convolve(
            here & (_angle(posed.looks[other, first:last], away) < 20.0), np.ones(round(0.5 * fps)), "valid"
        )
        looked |= bool((runs >= round(0.5 * fps) - 0.5).any())
    return looked if near or looked else None


def _astride(posed: Posed) -> tuple[int, int]:
    """Return in how many frames bodies lie with another over them, and in how many they lie."""
    standing = _standing(posed)
    pelvis, neck = _level(posed.joints[:, :, HIPS]), _level(posed.neck)
    knees = _level(posed.joints[:, :, [5, 9]].mean(axis=2))
    lies = (posed.joints[..., HIPS, 1] < 0.3) & (posed.neck[..., 1] < 0.5)
    over = total = 0
    for avatar in range(len(lies)):
        frames = np.flatnonzero(lies[avatar])[:: max(1, round(posed.fps / 15))]
        found = np.zeros(len(frames), bool)
        for start, stop in ((neck, pelvis), (pelvis, knees)):
            a, b = start[avatar, frames], stop[avatar, frames]
            line = b - a
            for other in range(len(lies)):
                if other != avatar:
                    to = pelvis[other, frames] - a
                    share = np.clip(np.sum(to * line, axis=1) / np.maximum(np.sum(line * line, axis=1), 1e-6), 0, 1)
                    off = np.linalg.norm(to - share[:, None] * line, axis=1)
                    found |= (off < 0.15) & standing[other, frames]
        over, total = over + int(found.sum()), total + len(frames)
    return over, total


def measure_consequences(runs: Sequence[Posed], falls: Array, motion: Array) -> dict[str, Any]:
    """Return the figures of knock-downs in runs of one policy.

    Args:
        runs: The runs.
        falls: Its actions that lead from standing to lying.
        motion: What captured motion each shows, mirrored or not. Shape of ``falls``.
    """
    found = [one for run in runs for one in _falls(run, falls, motion)]
    over, lying = np.sum([_astride(run) for run in runs], axis=0)
    if not found:
        return {"knock_downs": 0, **dict.fromkeys(GOALS)}

    def share(flags: list[bool]) -> float | None:
        return float(np.mean(flags)) if flags else None

    groups, (_, kinds) = (
        _groups([one["fall"] for one in found]),
        np.unique([one["kind"] for one in found], return_counts=True),
    )
    many = len(found) >= MANY
    return {
        "knock_downs": len(found),
        "struck_after": float(sum(one["struck"] for one in found)),
        "left_within": share([one["left"] <= 0.1 for one in found]),
        "crumple_down": share([one["down"] <= 0.4 for one in found if one["tilt"] < 40.0]),
        "topple_down": share([one["down"] <= 0.8 for one in found if one["tilt"] >= 40.0]),
        "down_median": float(np.median([one["down"] for one in found])),
        "most_frequent": float(kinds.max() / len(found)) if many else None,
        "alike": float(groups[0] / len(found)) if many else None,
        "poses": float(len(_groups([one["lying"] for one in found]))) if many else None,
        "attacker_faces": share([one["faces"] for one in found if one["faces"] is not None]),
        "someone_looks": share([one["looks"] for one in found if one["looks"] is not None]),
        "astride": float(over / lying) if lying else None,
    }


def measure_break_poses(runs: Sequence[Posed]) -> dict[str, Any]:
    """Return the figures of the breaks of runs of two boxers (``breaks.SCENE``)."""
    dropped, apart, faces, early = [], [], [], 0
    for run in runs:
        fps, times = run.fps, run.take.events.frame / run.take.control_rate
        trunk = run.neck[..., 1] - run.joints[..., HIPS, 1]
        hands = run.joints[..., [4, 8], 1] - run.joints[..., HIPS, 1, None]
        hang = hands.max(axis=-1) < 0.5 * trunk
        guard = hands.min(axis=-1) > 0.55 * trunk
        pelvis = _level(run.joints[:, :, HIPS])
        for start, stop in BREAKS:
            first, last = round((start + 3.0) * fps), round((stop - 1.0) * fps)
            if round(stop * fps) >= hang.shape[1]:
                continue
            dropped += np.mean(hang[:, first:last], axis=1).tolist()
            between = np.linalg.norm(pelvis[0, first:last] - pelvis[1, first:last], axis=-1)
            apart.append(float(np.mean(between > ASKED - 0.5)))
            to = np.stack([pelvis[1] - pelvis[0], pelvis[0] - pelvis[1]])[:, first:last]
            off = np.minimum(
                _angle(run.chests[:, first:last], to), _angle(run.chests[:, first:last], -pelvis[:, first:last])
            )
            faces += np.mean(off < 60.0, axis=1).tolist()
            both = guard.all(axis=0)
            ready = round(stop * fps) + int(np.argmax(both[round(stop * fps) :]))
            # A strike that was thrown before the break may still be on its way.
            early += int(np.count_nonzero((times > start + 0.7) & (times < ready / fps)))

    def share(values: list[float]) -> float | None:
        return float(np.mean(np.array(values) > 0.95)) if values else None

    return {"breaks": len(apart), "dropped": share(dropped), "apart": share(apart), "faces": share(faces),
            "struck_early": float(early) if apart else None}  # fmt: skip


def lines(outcome: Mapping[str, Any]) -> Iterator[str]:
    """Yield the figures with their goals, a line each; those that are missed between asterisks."""
    for scene, figures in outcome.items():
        in_breaks = "breaks" in figures
        count = figures["breaks" if in_breaks else "knock_downs"]
        yield f"{scene}: {count} {'breaks' if in_breaks else 'knock-downs'}"
        for key, (label, goal) in (BREAK_GOALS if in_breaks else GOALS).items():
            value = figures[key]
            number = "none" if value is None else f"{value:.2f}".rstrip("0").rstrip(".")
            missed = value is not None and not goal.met(value)
            yield f"  {label:<50}{'**' + number + '**' if missed else number:>10}   {goal}"
