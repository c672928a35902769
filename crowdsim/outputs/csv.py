"""Positions of joints as CSV, one file for each avatar: what ``Take.joints`` returns, to the micrometre."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from crowdsim.config.files import Finding
from crowdsim.config.schema import some
from crowdsim.core.types import Array
from crowdsim.errors import nearest
from crowdsim.export.avatar_files import AvatarFiles, GrowingFile
from crowdsim.export.stream import Block
from crowdsim.scenario.names import harmless_cell

if TYPE_CHECKING:
    from crowdsim.policy.policy import Policy
    from crowdsim.poses.sampler import PoseSampler

# Bytes of frame and time in a row, and of a joint; joints of most bodies. Measured with the shipped scenarios.
_ROW_BYTES, _JOINT_BYTES, _MANY = 16.0, 30.0, 22
_JOINTS = (
    "Joints to write, by their names in the skeleton or by roles that all bodies have, such as `head` or `left_hand`; "
    "without it all."
)


class CsvOutput(AvatarFiles):
    """Positions of joints as CSV [m], one file per avatar: output frame, its time [s], x, y and z of each joint."""

    name = "csv"
    about = "Positions of joints as CSV [m], one file per avatar."
    kernels = "bvh"
    reads_joints = True
    reads_policies = True

    every: int = Field(default=1, ge=1, le=1_000_000, description="Write every n-th output frame.")
    joints: tuple[str, ...] | None = Field(default=None, min_length=1, description=_JOINTS)

    @property
    def step(self) -> int:
        """Every how manyth output frame is written."""
        return self.every

    def pose_bytes(self) -> float:
        """Return about how long a row is [bytes]; where all joints are written, as of many."""
        return _ROW_BYTES + _JOINT_BYTES * (_MANY if self.joints is None else len(self.joints))

    def findings_with(self, policies: Sequence[Policy]) -> Iterator[Finding]:
        """Yield a finding for each joint that a policy's skeleton does not have."""
        for policy in policies:
            known = _joints_of(policy)
            for i, joint in enumerate(self.joints or ()):
                if joint not in known:
                    what = f"is {joint!r}, but the bodies of policy {policy.name!r} have no such joint, expected "
                    yield Finding(("joints", i), f"{what}{some(known)}{nearest(joint, known)}")

    def begin(self, sampler: PoseSampler, avatar: int, path: Path, frames: int) -> _Table:
        """Begin the file of an avatar with the names of its columns."""
        policy = sampler.policies[int(sampler.take.cast.policies[avatar])]
        names = self.joints or policy.database.skeleton.names
        known = _joints_of(policy)
        head = io.StringIO()
        columns = ["frame", "seconds", *(harmless_cell(f"{name}_{axis}") for name in names for axis in "xyz")]
        csv.writer(head, lineterminator="\n").writerow(columns)
        return _Table(path, head.getvalue().encode(), [known[name] for name in names])

    def append(self, writer: Any, block: Block, policy: int, column: int, rows: Array) -> None:
        """Append rows of a block of poses: output frame, its time [s], and positions [m]."""
        from crowdsim.bvh.writer import format_motion

        if not len(rows):
            return
        positions = block.joints[policy][0][rows, column][:, writer.joints]
        frames = block.first + rows
        table = np.column_stack([frames / self.rate, positions.reshape(len(rows), -1)])
        lines = format_motion(table, 6).replace(b" ", b",").splitlines()
        writer.append(b"".join(b"%d,%b\n" % (frame, bytes(line)) for frame, line in zip(frames, lines, strict=True)))


class _Table(GrowingFile):
    """A file of some joints, by their numbers in its avatar's skeleton."""

    def __init__(self, path: Path, head: bytes, joints: list[int]) -> None:
        super().__init__(path, head)
        self.joints = joints


def _joints_of(policy: Policy) -> dict[str, int]:
    """Return the number of each joint of a policy's bodies, by its name and by its role."""
    names = policy.database.skeleton.names
    return {**policy.database.body.roles, **{name: number for number, name in enumerate(names)}}


OUTPUT = CsvOutput
