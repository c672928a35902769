"""Interpretation of BVH files: unit, up axis, roles and body are found, and faults reported."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast, get_args

import numpy as np

from crowdsim.bvh.file import Bvh
from crowdsim.bvh.people import read_people
from crowdsim.capture import units
from crowdsim.capture.faults import FAULTS, Choice
from crowdsim.capture.faults.diagnosis import Outcome, decide
from crowdsim.capture.reading import Reading
from crowdsim.core.types import FileName
from crowdsim.errors import MotionError, nearest
from crowdsim.motion.analysis import ClipAnalysis, analyse_clip
from crowdsim.motion.body import Body
from crowdsim.motion.contacts import runs
from crowdsim.motion.joint_tree import JointTree
from crowdsim.motion.measuring import MeasuredClip, lead_in
from crowdsim.motion.resampling import resample
from crowdsim.motion.skeleton import Clip, Skeleton
from crowdsim.motion.strikers import HANDS_AND_FEET

ANALYSIS_RATE = 60.0
"""Rate at which contacts and strikes of a file are found [1/s]."""

_FLIP = np.deg2rad(100.0)
_FLIP_SPEED = 50.0
"""A joint that rotates further than this in one frame [rad], faster than this [rad/s], has flipped."""
_MOST_FLIPS = 20
RATE = "time_base"
"""The kind of fault for which a recipe may give frames a second."""
_LOOSE = 0.03
"""Share of the body's height by which a joint of a limb may move against its parent, as skin does."""
LEAST_SECONDS = 0.2
"""Least length of a clip that can be trained on: two whole control frames at the default rate, and one to spare [s]."""


@dataclass(frozen=True)
class Capture:
    """A BVH file and what was found out about it.

    Attributes:
        bvh: The file as it is.
        clip: Its motion, y up, in metres where the scale is known and in file units where it is not; all frames,
            lead-in included, repaired. Without a frame when the file has none.
        finite: Whether every number of the motion is finite.
        body: The human body on its skeleton; None when there is none, or no scale for it.
        roles: Joint of each role; empty when this is no human body.
        unit_scale: Metres in a file unit; None when unknown.
        up_axis: The axis that is up in the file; None when unknown (y is taken).
        spans: First and last frame of each stretch of motion, half-open: without the lead-in, and without frames in
            which tracking was lost. At least one.
        diagnoses: Faults that were recognised, and what was done about each.
        findings: What is odd, a line each.
        faults: Those of the findings for which the file cannot be trained on.
    """

    bvh: Bvh
    clip: Clip
    finite: bool
    body: Body | None
    roles: dict[str, int]
    unit_scale: float | None
    up_axis: str | None
    spans: tuple[tuple[int, int], ...]
    diagnoses: tuple[Outcome, ...]
    findings: tuple[str, ...]
    faults: tuple[str, ...]

    @property
    def lead_in(self) -> int:
        """Frames at the start that are a calibration pose, the jump out of it, or no motion for another reason."""
        return self.spans[0][0]

    @property
    def motion(self) -> Clip:
        """The clip without its lead-in and what comes after its motion; frames that are lost are bridged."""
        return self.clip.sliced(self.lead_in, self.spans[-1][1])

    @property
    def start(self) -> float:
        """Time in the file at which the motion begins [s]."""
        return self.lead_in / self.clip.fps

    @cached_property
    def analysis(self) -> ClipAnalysis | None:
        """Contacts and strikes of all limbs in the motion, at ``ANALYSIS_RATE``; None without a body that moves."""
        motion = self.motion
        if self.body is None or motion.frame_count < 2:
            return None
        if not (np.isfinite(motion.root_positions).all() and np.isfinite(motion.rotations).all()):
            return None
        return analyse_clip(resample(motion, ANALYSIS_RATE), self.body, limbs=HANDS_AND_FEET)


class _Notes:
    """Collects findings and faults of a file."""

    def __init__(self, bvh: Bvh) -> None:
        self.findings = [without_path(finding, bvh.path) for finding in bvh.findings]
        self.faults = [without_path(fault, bvh.path) for fault in bvh.faults]

    def find(self, *what: str) -> None:
        """Note findings."""
        self.findings.extend(what)

    def fault(self, *what: str) -> None:
        """Note findings for which the file cannot be trained on."""
        self.findings.extend(what)
        self.faults.extend(what)


def load_people(
    path: FileName,
    unit: str | float | None = None,
    up_axis: str | None = None,
    faults: Mapping[str, str | float] | None = None,
) -> list[Capture]:
    """Read a BVH file and find out what each person in it is; trees that are no people are left out where others are.

    Arguments and errors are those of ``load_capture``.
    """
    captures = [_interpret(bvh, unit, up_axis, faults) for bvh in read_people(path)]
    return [capture for capture in captures if capture.roles] or captures[:1]


def load_capture(
    path: FileName,
    unit: str | float | None = None,
    up_axis: str | None = None,
    faults: Mapping[str, str | float] | None = None,
) -> Capture:
    """Read a BVH file and find out what it is; of several people in it, the first.

    Args:
        path: The file, or one person in it: ``capture.bvh#2``.
        unit: Its unit, a name of ``crowdsim.capture.units.UNITS`` or metres; found when None.
        up_axis: Its up axis, 'y' or '-z' say; found when None.
        faults: What is done about kinds of faults, instead of what is usual: "repair" them, sure or not; "keep" the
            motion as it is in the file; or "refuse" the file. "time_base" may be a number of frames a second instead.

    Raises:
        BvhError: The file is no BVH.
        MotionError: The given unit, axis or kind of fault is unknown.
    """
    return load_people(path, unit, up_axis, faults)[0]


def _interpret(
    bvh: Bvh, unit: str | float | None, up_axis: str | None, faults: Mapping[str, str | float] | None
) -> Capture:
    """Find out what one tree of joints in a file is."""
    scale = None if unit is None else units.parse_unit(unit)
    axis = None if up_axis is None else units.parse_up_axis(up_axis)
    choices = check_choices(faults or {})
    notes = _Notes(bvh)
    rate = choices.pop(RATE, None)
    if isinstance(rate, float):
        notes.find(f"{RATE}: it is read at {rate:g} frames a second, as asked")
    elif rate is not None:
        choices[RATE] = rate
    reading = Reading(bvh if not isinstance(rate, float) else replace(bvh, fps=rate), scale, axis)
    # A frame rate that the user gives is taken as it is.
    reading, diagnoses = _without_faults(reading, choices, RATE if isinstance(rate, float) else "")
    roles, clip, body = reading.roles, reading.clip, reading.body
    if not roles:
        notes.fault(f"no human body found in {clip.skeleton.joint_count} joints: {_names(clip.skeleton)}")
    if reading.up_axis is None:
        notes.find("up axis unknown, y is taken: the body is neither upright nor keeps to a floor")
    if reading.scale is None:
        if reading.height is None:
            notes.fault("unknown scale: without a human body there is nothing to measure it by")
        else:
            notes.fault(units.describe_heights(reading.height))
    for diagnosis in diagnoses:
        (notes.fault if diagnosis.refused else notes.find)(diagnosis.words)
    if clip.frame_count <= 1:
        notes.fault("no frames, expected motion" if clip.frame_count == 0 else "a single frame, expected motion")
    spans = [(0, clip.frame_count)]
    if clip.frame_count > 1 and reading.finite:
        spans = _spans(reading)
        if body is not None:
            start, stop = spans[0]
            spans[0] = (start + lead_in(clip.sliced(start, stop), body), stop)
        notes.fault(*(flip for start, stop in spans for flip in _flips(clip, start, stop)))
        notes.find(*_moving_joints(clip, body))
    return Capture(
        bvh=bvh,
        clip=clip,
        finite=reading.finite,
        body=body,
        roles=roles,
        unit_scale=reading.scale,
        up_axis=reading.up_axis,
        spans=tuple(spans),
        diagnoses=tuple(diagnoses),
        findings=tuple(notes.findings),
        faults=tuple(notes.faults),
    )


def check_choices(faults: Mapping[str, str | float]) -> dict[str, Choice | float]:
    """Return what is to be done about kinds of faults if all of them, and what is asked for, exist.

    Raises:
        MotionError: A kind of fault is unknown, or what is asked for.
    """
    names = [fault.name for fault in FAULTS]
    checked: dict[str, Choice | float] = {}
    for name, choice in faults.items():
        if name not in names:
            raise MotionError(f"fault {name!r} is unknown{nearest(name, names)}; expected {', '.join(names)}")
        if name == RATE and isinstance(choice, int | float) and not isinstance(choice, bool) and 1 <= choice <= 2000:
            checked[name] = float(choice)
        elif choice in get_args(Choice):
            checked[name] = cast(Choice, choice)
        else:
            rates = ", or 1 to 2000 frames a second" if name == RATE else ""
            raise MotionError(f"fault {name!r}: {choice!r} is unknown, expected {', '.join(get_args(Choice))}{rates}")
    return checked


def _without_faults(
    reading: Reading, choices: Mapping[str, Choice | float], known: str = ""
) -> tuple[Reading, list[Outcome]]:
    """Examine a reading for every kind of fault; return it as repaired, and what was found and done.

    A file that is refused is returned as it is from there on; what else is wrong is looked for as if it were repaired.
    """
    outcomes: list[Outcome] = []
    examined = reading
    for fault in FAULTS:
        diagnosis = fault.examine(examined) if fault.name != known else None
        if diagnosis is None:
            continue
        outcome = decide(diagnosis, cast("Choice | None", choices.get(fault.name)))
        outcomes.append(outcome)
        if diagnosis.repair is None or outcome.done == "kept":
            continue
        examined = diagnosis.repair()
        if diagnosis.needed or not any(one.refused for one in outcomes):
            reading = examined
    return reading, outcomes


def _spans(reading: Reading) -> list[tuple[int, int]]:
    """Stretches of consecutive frames that are motion; the whole clip where nothing would be left."""
    count = reading.clip.frame_count
    usable = np.ones(count, bool) if reading.lost is None else ~reading.lost
    edges = [0, *reading.cuts, count]
    spans = [
        (first + int(a), first + int(b))
        for first, stop in itertools.pairwise(edges)
        for a, b in runs(usable[first:stop])
    ]
    return [(a, b) for a, b in spans if b - a > 1] or [(0, count)]


def usable_clips(capture: Capture, strict: bool = True) -> list[MeasuredClip]:
    """Return a capture's clips with their body and lead-in, if it can be trained on: one, or those between losses.

    Clips between losses are called by the frame that they begin with: ``walk@0``, ``walk@706``.

    Args:
        capture: The capture.
        strict: Refuse wrong row counts and flips of joints too, not only what has no motion of a body of known size.

    Raises:
        MotionError: It cannot: the file and every reason, a line each.
    """
    usable = capture.finite and capture.clip.frame_count > 1 and not (strict and capture.faults)
    usable &= not any(outcome.refused for outcome in capture.diagnoses)
    body = capture.body
    if body is None or not usable:
        source = capture.clip.source
        raise MotionError("\n".join(with_path(fault, source) for fault in capture.faults))
    if len(capture.spans) == 1 and capture.spans[0][1] == capture.clip.frame_count:
        return [MeasuredClip(capture.clip, body, capture.lead_in)]
    least = LEAST_SECONDS * capture.clip.fps
    spans = [span for span in capture.spans if span[1] - span[0] >= least] or [
        max(capture.spans, key=lambda span: span[1] - span[0])
    ]
    if len(spans) == 1:
        return [MeasuredClip(capture.clip.sliced(*spans[0]), body)]
    parts = [replace(capture.clip.sliced(*span), name=f"{capture.clip.name}@{span[0]}") for span in spans]
    return [MeasuredClip(part, body) for part in parts]


def without_path(finding: str, path: str) -> str:
    """Return a finding of the file, ``PATH:LINE:COLUMN: what``, without its path."""
    if not finding.startswith(path + ":"):
        return finding
    return re.sub(r"^(\d+):(\d+): ", r"line \1, column \2: ", finding[len(path) + 1 :]).lstrip()


def with_path(finding: str, path: FileName) -> str:
    """Return a finding of a capture, ``line LINE, column COLUMN: what``, as ``PATH:LINE:COLUMN: what``.

    What is found out about a file as a whole has no line of its own, and gets the first one.
    """
    found = re.match(r"line (\d+), column (\d+): ", finding)
    return f"{path}:1:1: {finding}" if found is None else f"{path}:{found[1]}:{found[2]}: {finding[found.end() :]}"


def _names(skeleton: Skeleton) -> str:
    shown = ", ".join(skeleton.names[:6])
    return shown + (" ..." if skeleton.joint_count > 6 else "")


def _flips(clip: Clip, start: int, stop: int) -> list[str]:
    """Joints that rotate further in one frame than a body can."""
    least = max(_FLIP, _FLIP_SPEED / clip.fps)
    if least >= np.pi:
        return []
    dots = np.abs(np.einsum("fjc,fjc->fj", clip.rotations[start + 1 : stop], clip.rotations[start : stop - 1]))
    flips = np.argwhere(dots < np.cos(0.5 * least))
    found = []
    for frame, joint in flips[:_MOST_FLIPS]:
        angle = np.rad2deg(2.0 * np.arccos(dots[frame, joint]))
        found.append(
            f"joint {clip.skeleton.names[joint]!r} flips by {angle:.0f} degrees "
            f"between frames {start + frame} and {start + frame + 1}"
        )
    if len(flips) > _MOST_FLIPS:
        found.append(f"{len(flips) - _MOST_FLIPS} more flips of joints")
    return found


def _moving_joints(clip: Clip, body: Body | None) -> list[str]:
    """Joints of limbs and trunk that move against their parents by more than skin does."""
    if clip.translations is None or body is None:
        return []
    tree = JointTree(clip.skeleton, None)
    bones = {joint for end in body.roles.values() for joint in tree.path(end)}
    bones -= set(tree.path(body.roles["pelvis"]))
    bones -= set(tree.path(body.roles["spine"])[:-1])
    chosen = np.array(sorted(bones))
    span = np.ptp(clip.translations[:, chosen], axis=0).max(axis=-1, initial=0.0)
    moving = np.flatnonzero(span > _LOOSE * body.height)
    if not len(moving):
        return []
    worst = int(moving[np.argmax(span[moving])])
    name = clip.skeleton.names[chosen[worst]]
    return [f"{len(moving)} joints move against their parents, {name!r} by {span[worst]:.3f} m"]
