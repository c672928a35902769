"""Several people in a file: each tree of a BVH file as a file of its own, named ``capture.bvh#2``."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from crowdsim.bvh.file import Bvh
from crowdsim.bvh.reader import read_bvh
from crowdsim.core.types import FileName
from crowdsim.errors import BvhError

_NUMBERED = re.compile(r"(.+)#([1-9]\d{0,3})")


def split_name(path: FileName) -> tuple[Path, int | None]:
    """Return the file that a name means, and the number of the person in it: 2 of ``capture.bvh#2``.

    The number is None without one, and where a file has that name.
    """
    path = Path(path)
    found = _NUMBERED.fullmatch(path.name)
    if found is None or path.is_file():
        return path, None
    return path.with_name(found[1]), int(found[2])


def read_people(path: FileName) -> list[Bvh]:
    """Read a BVH file, each tree of joints in it by itself; paths of several are numbered from 1.

    Args:
        path: The file, or one person in it.

    Raises:
        BvhError: The file is no BVH, or has no person of that number.
    """
    file, number = split_name(path)
    bvh = read_bvh(file)
    roots = np.flatnonzero(bvh.parents < 0)
    if number is not None and number > len(roots):
        raise BvhError(f"{file}: no person {number}; the file has {len(roots)} ROOT{'s' * (len(roots) > 1)}")
    if len(roots) == 1 and number is None:
        return [bvh]
    wanted = range(len(roots)) if number is None else [number - 1]
    return [_person(bvh, index, f"{file}#{index + 1}") for index in wanted]


def _person(bvh: Bvh, index: int, path: str) -> Bvh:
    """Return one tree of a file, with its columns; what was found about the file stays."""
    roots = [*np.flatnonzero(bvh.parents < 0).tolist(), bvh.joint_count]
    first, last = roots[index], roots[index + 1]
    columns = bvh.first_channels()
    ends = np.flatnonzero((bvh.end_parents >= first) & (bvh.end_parents < last))
    parents = bvh.parents[first:last]
    return replace(
        bvh,
        names=bvh.names[first:last],
        parents=np.where(parents < 0, -1, parents - first).astype(np.int32),
        offsets=bvh.offsets[first:last],
        channels=bvh.channels[first:last],
        end_parents=(bvh.end_parents[ends] - first).astype(np.int32),
        end_offsets=bvh.end_offsets[ends],
        end_names=tuple(bvh.end_names[end] for end in ends),
        motion=np.ascontiguousarray(bvh.motion[:, columns[first] : columns[last]]),
        path=path,
        findings=tuple(finding.replace(bvh.path, path, 1) for finding in bvh.findings),
        faults=tuple(fault.replace(bvh.path, path, 1) for fault in bvh.faults),
    )
