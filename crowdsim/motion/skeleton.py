"""Skeletons and clips: the shapes that motion has in memory."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion.joint_names import plain_names

_SHOWN = 6
"""Joints named in a difference of skeletons."""


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
        """Return in words how another skeleton differs, or nothing; a prefix that all names have is no difference.

        Args:
            other: The other skeleton.
            tolerance: Greatest difference of an offset that is none [m].
        """
        ours, theirs = plain_names(self.names), plain_names(other.names)
        if len(ours) != len(theirs):
            missing = [name for name in ours if name not in theirs]
            more = [name for name in theirs if name not in ours]
            which = f"; without {_listed(missing)}" if missing else f"; with {_listed(more)}" if more else ""
            return f"{len(theirs)} joints, expected {len(ours)}{which}"
        renamed = [
            f"joint {j} is {b!r}, expected {a!r}" for j, (a, b) in enumerate(zip(ours, theirs, strict=True)) if a != b
        ]
        if renamed:
            return _listed(renamed)
        for joint in np.flatnonzero(self.parents != other.parents).tolist():
            expected = repr(ours[self.parents[joint]]) if self.parents[joint] >= 0 else "no parent"
            return f"joint {theirs[joint]!r} hangs on another joint than {expected}"
        gaps = np.where(self.parents >= 0, np.abs(self.offsets - other.offsets).max(axis=1), 0.0)
        lengths = [np.linalg.norm(one.offsets, axis=1) for one in (other, self)]
        apart = [
            f"{theirs[joint]!r} by {100.0 * gaps[joint]:.1f} cm "
            f"({100.0 * lengths[0][joint]:.1f} cm long, expected {100.0 * lengths[1][joint]:.1f} cm)"
            for joint in np.flatnonzero(gaps > tolerance).tolist()
        ]
        return "offsets of joints differ: " + _listed(apart) if apart else ""


def _listed(words: list[str]) -> str:
    more = f" and {len(words) - _SHOWN} more" if len(words) > _SHOWN else ""
    return ", ".join(words[:_SHOWN]) + more


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
