"""Skeletons and clips: the shapes that motion has in memory."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from crowdsim.core.types import Array


@dataclass(frozen=True)
class Skeleton:
    """A tree of joints in its rest pose, in which every joint's rotation is the identity.

    Attributes:
        names: Joint names, parents before children. Length J.
        parents: Index of each joint's parent, -1 for the root. Shape (J,), int32.
        offsets: Position of each joint in its parent's frame [m]. Shape (J, 3).
        end_parents: Joint that each end site hangs on. Shape (E,), int32.
        end_offsets: Position of each end site in its joint's frame [m]. Shape (E, 3).
    """

    names: tuple[str, ...]
    parents: Array
    offsets: Array
    end_parents: Array = field(default_factory=lambda: np.zeros(0, np.int32))
    end_offsets: Array = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def joint_count(self) -> int:
        """Number of joints J, end sites excluded."""
        return len(self.names)

    def children(self, joint: int) -> list[int]:
        """Return the joints whose parent is ``joint``, in order."""
        return [int(child) for child in np.flatnonzero(self.parents == joint)]

    def rest_positions(self) -> Array:
        """Return each joint's position in the rest pose, the root at its offset [m]. Shape (J, 3)."""
        positions = np.array(self.offsets, dtype=float)
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                positions[joint] += positions[parent]
        return positions

    def scaled(self, factor: float) -> Skeleton:
        """Return the same tree with every offset multiplied by ``factor``."""
        return replace(self, offsets=self.offsets * factor, end_offsets=self.end_offsets * factor)

    def difference(self, other: Skeleton, tolerance: float = 0.005) -> str:
        """Return the first difference to another skeleton in words, or nothing; offsets to ``tolerance`` [m]."""
        if self.joint_count != other.joint_count:
            missing = [name for name in self.names if name not in other.names]
            more = [name for name in other.names if name not in self.names]
            which = f"; without {missing[0]!r}" if missing else f"; with {more[0]!r}" if more else ""
            return f"{other.joint_count} joints, expected {self.joint_count}{which}"
        for joint, (ours, theirs) in enumerate(zip(self.names, other.names, strict=True)):
            if ours != theirs:
                return f"joint {joint} is {theirs!r}, expected {ours!r}"
            if self.parents[joint] != other.parents[joint]:
                expected = self.names[self.parents[joint]] if self.parents[joint] >= 0 else "no parent"
                return f"joint {theirs!r} hangs on another joint than {expected!r}"
            gap = float(np.abs(self.offsets[joint] - other.offsets[joint]).max()) if self.parents[joint] >= 0 else 0.0
            if gap > tolerance:
                return f"offset of joint {theirs!r} differs by {gap:.3f} m"
        return ""


@dataclass(frozen=True)
class Clip:
    """One continuous recording of a skeleton, in metres, y up.

    Attributes:
        name: What the clip is called (a file's stem).
        skeleton: The skeleton that moves.
        fps: Frames a second.
        root_positions: Position of the root in the world [m]. Shape (F, 3).
        rotations: Local rotation of each joint; the root's is in the world. Shape (F, J, 4), wxyz.
        translations: Position of each joint in its parent's frame [m], for files whose joints move against their
            parents, shape (F, J, 3) with the root's row equal to ``root_positions``; None when every joint keeps its
            offset.
        source: Path of the file it came from, or an empty string.
    """

    name: str
    skeleton: Skeleton
    fps: float
    root_positions: Array
    rotations: Array
    translations: Array | None = None
    source: str = ""

    @property
    def frame_count(self) -> int:
        """Number of frames F."""
        return len(self.root_positions)

    @property
    def seconds(self) -> float:
        """Length [s]: frames over rate."""
        return self.frame_count / self.fps

    def sliced(self, start: int, stop: int) -> Clip:
        """Return frames ``start`` to ``stop``, half-open."""
        moved = None if self.translations is None else self.translations[start:stop]
        return replace(
            self,
            root_positions=self.root_positions[start:stop],
            rotations=self.rotations[start:stop],
            translations=moved,
        )
