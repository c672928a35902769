"""An edited video: stretches of a source one after another."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Any

import numpy as np

from crowdsim.core.types import Array
from crowdsim.render.source import PoseSource, Shown
from crowdsim.render.view import View


@dataclass(frozen=True)
class _Scales:
    """Scales of an edited video at frames of its source; equal ones share poses."""

    scales: Callable[[int], Array]
    shift: int

    def __call__(self, frame: int) -> Array:
        """Return the scales at a frame of the source."""
        return self.scales(frame + self.shift)


class EditedSource:
    """Stretches of a source one after another; a ``PoseSource``.

    Args:
        source: The source.
        spans: First frame and the one after the last of each stretch, in their order.
    """

    def __init__(self, source: PoseSource, spans: tuple[tuple[int, int], ...]) -> None:
        self.source, self.spans = source, spans
        self._ends = list(accumulate(stop - start for start, stop in spans))
        self.frame_count = self._ends[-1]

    def __getattr__(self, name: str) -> Any:
        """Return what does not depend on the frame from the source itself."""
        return getattr(self.source, name)

    def find(self, frame: float) -> tuple[int, float]:
        """Return the stretch that a frame is in, and its frame in the source."""
        index = min(bisect_right(self._ends, frame), len(self.spans) - 1)
        return index, min(frame - self._ends[index] + self.spans[index][1], self.source.frame_count - 1)

    def view(self, views: Sequence[Callable[[float], View]]) -> Callable[[float], View]:
        """Return the view at each frame, of that of each stretch at frames of the source."""

        def view(frame: float) -> View:
            index, at = self.find(frame)
            return views[index](at)

        return view

    def ground(self, frames: Array) -> Array:
        """Return the ground transforms of all avatars at some frames; NaN while absent. Shape (n, N, 3)."""
        return np.concatenate([self.source.ground(np.array([int(self.find(frame)[1])])) for frame in frames])

    def poses(self, frame: int, shown: Shown | None = None) -> list[tuple[Array, Array]]:
        """Return the poses at a frame, see ``PoseSource.poses``."""
        index, at = self.find(frame)
        if shown is None:
            return self.source.poses(int(at))
        stop = min(int(at) + shown.stop - frame, self.spans[index][1])
        return self.source.poses(int(at), Shown(stop, _Scales(shown.scales, frame - int(at))))

    def seconds(self, frame: int) -> float:
        """Return the time of a frame in the take [s]."""
        return float(self.source.seconds(int(self.find(frame)[1])))  # type: ignore[attr-defined]

    def recent_strikes(self, frame: int) -> tuple[Array, Array, Array, Array]:
        """Return the strikes just before a frame, see ``PoseSource.recent_strikes``."""
        return self.source.recent_strikes(int(self.find(frame)[1]))

    def markers(self, frame: int) -> Array:
        """Return the positions of scripted targets [m]. Shape (G, 3)."""
        return self.source.markers(int(self.find(frame)[1]))
