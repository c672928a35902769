"""What a folder of capture holds: the BVH files that can be trained on together, and why others cannot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from crowdsim.capture.loading import LEAST_SECONDS, Capture, load_capture, load_people, usable_clips, without_path
from crowdsim.core.types import FileName, Progress
from crowdsim.errors import BvhError, MotionError, PolicyError
from crowdsim.motion.measuring import MeasuredClip, rests_like_a_body
from crowdsim.motion.retargeting import retarget
from crowdsim.motion.skeleton import Skeleton
from crowdsim.motion.strikers import HANDS_AND_FEET
from crowdsim.training.fingerprint import bvh_files
from crowdsim.training.no_strikes_report import Fists, measure_fists


@dataclass(frozen=True)
class SurveyedFile:
    """A BVH file of a folder.

    Attributes:
        name: Its path below the folder, with forward slashes; with its number where it is one of several people.
        reason: Why it cannot be trained on; empty when it can.
        seconds: Its motion without the lead-in [s].
        strikes: Strikes found in it by limb, in the order of ``motion.strikes.LIMBS``.
        fists: How fast its fists are; None where that is not known.
        skeleton: Its skeleton; None where it cannot be trained on.
        change: What is changed to bring it to the skeleton of most motion, in words; empty when it has that one.
    """

    name: str
    reason: str
    seconds: float = 0.0
    strikes: tuple[int, ...] = (0,) * len(HANDS_AND_FEET)
    fists: Fists | None = None
    skeleton: Skeleton | None = None
    change: str = ""


@dataclass(frozen=True)
class Survey:
    """A folder of capture.

    Attributes:
        folder: The folder.
        used: The files that can be trained on together, by name.
        left_out: The others, by name, each with its reason.
        mirrors: Whether motion on their skeleton can be mirrored: its rest pose has to be that of a body.
    """

    folder: Path
    used: tuple[SurveyedFile, ...]
    left_out: tuple[SurveyedFile, ...]
    mirrors: bool = True

    @property
    def seconds(self) -> float:
        """Motion of the files that can be trained on [s]."""
        return sum(file.seconds for file in self.used)

    @property
    def strikes(self) -> tuple[int, ...]:
        """Strikes found in them by limb."""
        return tuple(sum(file.strikes[limb] for file in self.used) for limb in HANDS_AND_FEET)


def survey_capture(folder: FileName, progress: Progress | None = None) -> Survey:
    """Return which BVH files of a folder, and of all folders in it, can be trained on together.

    Files with other skeletons than most of the motion has note what is changed to bring them to that one; they are
    left out where they are too unlike. Each of several people in a file is a file of the survey.

    Raises:
        PolicyError: There is no such folder, or no BVH file in it.
        MotionError: No file can be used: each with its reason.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise PolicyError(f"{folder}: no such folder, expected motion capture (--mocap DIR or CROWDSIM_MOCAP)")
    paths = bvh_files(folder)
    if not paths:
        raise PolicyError(f"{folder}: holds no BVH file, nor does a folder in it")
    files: list[SurveyedFile] = []
    for done, path in enumerate(paths, start=1):
        files.extend(_survey_file(path, path.relative_to(folder).as_posix()))
        if progress is not None:
            progress("survey capture", done, len(paths))
    groups = group_by_skeleton([file for file in files if not file.reason])
    if not groups:
        lines = "\n".join(f"  {file.name}: {file.reason}" for file in files)
        raise MotionError(f"{folder}: none of its BVH files can be trained on\n{lines}")
    most = max(groups, key=lambda group: sum(file.seconds for file in group))
    names = {file.name for file in most}
    target = _measured(folder / most[0].name)
    files = [file if file.reason or file.name in names else _brought(folder, file, target) for file in files]
    used, left_out = (tuple(one for one in files if bool(one.reason) == out) for out in (False, True))
    return Survey(folder, used, left_out, rests_like_a_body(target.clip.skeleton, target.body.roles))


def group_by_skeleton(files: Sequence[SurveyedFile]) -> list[list[SurveyedFile]]:
    """Return usable files in groups of one skeleton, in the order of their first files."""
    groups: list[list[SurveyedFile]] = []
    for file in files:
        for group in groups:
            assert file.skeleton is not None
            assert group[0].skeleton is not None
            if not group[0].skeleton.difference(file.skeleton):
                group.append(file)
                break
        else:
            groups.append([file])
    return groups


def _survey_file(path: Path, name: str) -> list[SurveyedFile]:
    """Return what a file holds: one entry, or one for each of several people."""
    try:
        people = load_people(path)
    except (BvhError, MotionError) as error:
        return [SurveyedFile(name, _first_line(str(error), path))]
    if len(people) == 1 and people[0].clip.source == str(path):
        return [_survey_person(people[0], name)]
    return [_survey_person(one, name + one.clip.source.removeprefix(str(path))) for one in people]


def _survey_person(capture: Capture, name: str) -> SurveyedFile:
    try:
        clip = usable_clips(capture)[0].clip
    except MotionError as error:
        return SurveyedFile(name, _first_line(str(error), capture.clip.source))
    motion = capture.motion
    if motion.seconds < LEAST_SECONDS:
        return SurveyedFile(name, f"{motion.seconds:.2f} s after the lead-in, expected {LEAST_SECONDS:.2f} s or more")
    if capture.analysis is None:
        return SurveyedFile(name, "no motion of a body")
    limbs = capture.analysis.strikes.limbs
    strikes = tuple(int((limbs == limb).sum()) for limb in HANDS_AND_FEET)
    return SurveyedFile(name, "", motion.seconds, strikes, measure_fists(name, capture), clip.skeleton)


def _measured(path: Path) -> MeasuredClip:
    return usable_clips(load_capture(path))[0]


def _brought(folder: Path, file: SurveyedFile, target: MeasuredClip) -> SurveyedFile:
    """Return a file with what is changed when it is brought to another skeleton, or why it cannot be."""
    try:
        return replace(file, change=retarget(_measured(folder / file.name), target).describe())
    except MotionError as error:
        return replace(file, reason=f"another skeleton: {error}")


def _first_line(message: str, path: FileName) -> str:
    """Return the first of an error's lines without its path, and how many more there are."""
    lines = message.splitlines()
    more = f" (and {len(lines) - 1} more findings)" if len(lines) > 2 else " (and 1 more finding)" * (len(lines) - 1)
    return without_path(lines[0], str(path)) + more
