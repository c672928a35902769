"""What a folder of capture holds: the BVH files that can be trained on together, and why others cannot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from crowdsim.capture.loading import LEAST_SECONDS, load_capture, usable_clips, without_path
from crowdsim.core.types import FileName, Progress
from crowdsim.errors import BvhError, MotionError, PolicyError
from crowdsim.motion.skeleton import Skeleton
from crowdsim.motion.strikes import ALL_LIMBS, LIMBS
from crowdsim.training.fingerprint import bvh_files
from crowdsim.training.no_strikes_report import Fists, measure_fists

_SHOWN = 4


@dataclass(frozen=True)
class SurveyedFile:
    """A BVH file of a folder.

    Attributes:
        name: Its path below the folder, with forward slashes.
        reason: Why it cannot be trained on; empty when it can.
        seconds: Its motion without the lead-in [s].
        strikes: Strikes found in it by limb, in the order of ``motion.strikes.LIMBS``.
        fists: How fast its fists are; None where that is not known.
        skeleton: Its skeleton; None where it cannot be trained on.
    """

    name: str
    reason: str
    seconds: float = 0.0
    strikes: tuple[int, ...] = (0,) * len(LIMBS)
    fists: Fists | None = None
    skeleton: Skeleton | None = None


@dataclass(frozen=True)
class Survey:
    """A folder of capture.

    Attributes:
        folder: The folder.
        used: The files that can be trained on together, by name.
        left_out: The others, by name, each with its reason.
    """

    folder: Path
    used: tuple[SurveyedFile, ...]
    left_out: tuple[SurveyedFile, ...]

    @property
    def seconds(self) -> float:
        """Motion of the files that can be trained on [s]."""
        return sum(file.seconds for file in self.used)

    @property
    def strikes(self) -> tuple[int, ...]:
        """Strikes found in them by limb."""
        return tuple(sum(file.strikes[limb] for file in self.used) for limb in ALL_LIMBS)


def survey_capture(folder: FileName, progress: Progress | None = None) -> Survey:
    """Return which BVH files of a folder, and of all folders in it, can be trained on together.

    Where skeletons differ, those are taken that more than half of the usable files have.

    Args:
        folder: The folder.
        progress: Called with (stage, files done, files).

    Raises:
        PolicyError: There is no such folder, or no BVH file in it.
        MotionError: No file can be used: each with its reason; or no skeleton is that of most files.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise PolicyError(f"{folder}: no such folder, expected motion capture (--mocap DIR or CROWDSIM_MOCAP)")
    paths = bvh_files(folder)
    if not paths:
        raise PolicyError(f"{folder}: holds no BVH file, nor does a folder in it")
    files = []
    for path in paths:
        files.append(_survey_file(path, path.relative_to(folder).as_posix()))
        if progress is not None:
            progress("survey capture", len(files), len(paths))
    groups = group_by_skeleton([file for file in files if not file.reason])
    if not groups:
        lines = "\n".join(f"  {file.name}: {file.reason}" for file in files)
        raise MotionError(f"{folder}: none of its BVH files can be trained on\n{lines}")
    most = max(groups, key=len)
    if 2 * len(most) <= sum(map(len, groups)):
        raise MotionError(_describe_groups(folder, groups))
    names = {file.name for file in most}
    left_out = [file if file.reason else _of_another(file, most[0]) for file in files if file.name not in names]
    return Survey(folder, tuple(most), tuple(left_out))


def group_by_skeleton(files: Sequence[SurveyedFile]) -> list[list[SurveyedFile]]:
    """Return usable files in groups of one skeleton, in the order of their first files."""
    groups: list[list[SurveyedFile]] = []
    for file in files:
        for group in groups:
            if not _difference(group[0], file):
                group.append(file)
                break
        else:
            groups.append([file])
    return groups


def _survey_file(path: Path, name: str) -> SurveyedFile:
    try:
        capture = load_capture(path)
        clip = usable_clips(capture)[0].clip
    except (BvhError, MotionError) as error:
        return SurveyedFile(name, _first_line(str(error), path))
    motion = capture.motion
    if motion.seconds < LEAST_SECONDS:
        return SurveyedFile(name, f"{motion.seconds:.2f} s after the lead-in, expected {LEAST_SECONDS:.2f} s or more")
    if capture.analysis is None:
        return SurveyedFile(name, "no motion of a body")
    limbs = capture.analysis.strikes.limbs
    strikes = tuple(int((limbs == limb).sum()) for limb in ALL_LIMBS)
    return SurveyedFile(name, "", motion.seconds, strikes, measure_fists(name, capture), clip.skeleton)


def _first_line(message: str, path: Path) -> str:
    """Return the first of an error's lines without its path, and how many more there are."""
    lines = message.splitlines()
    more = f" (and {len(lines) - 1} more findings)" if len(lines) > 2 else " (and 1 more finding)" * (len(lines) - 1)
    return without_path(lines[0], str(path)) + more


def _difference(first: SurveyedFile, other: SurveyedFile) -> str:
    assert first.skeleton is not None
    assert other.skeleton is not None
    return first.skeleton.difference(other.skeleton)


def _of_another(file: SurveyedFile, first: SurveyedFile) -> SurveyedFile:
    return replace(file, reason=f"another skeleton than {first.name}: {_difference(first, file)}")


def _describe_groups(folder: Path, groups: list[list[SurveyedFile]]) -> str:
    """Return in words that no skeleton is that of most files, and which there are."""
    lines = [f"{folder}: its files have {len(groups)} skeletons, none of them that of most files; expected one"]
    for group in sorted(groups, key=lambda group: -len(group)):
        names = ", ".join(file.name for file in group[:_SHOWN]) + (", ..." if len(group) > _SHOWN else "")
        files = "1 file" if len(group) == 1 else f"{len(group)} files"
        lines.append(f"  {files}, {sum(file.seconds for file in group):.1f} s: {names}")
    lines.append("  put the files of one skeleton into a folder of their own, and give that by --mocap DIR")
    return "\n".join(lines)
