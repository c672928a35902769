"""Some control frames of a simulation as plain arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array
from crowdsim.crowd.arrays import Strikes
from crowdsim.crowd.events import VARIABLES, Events
from crowdsim.crowd.kernels.layout import LANDED

STAGES = ("index", "observe", "choose", "advance", "strikes", "record")
"""What a control frame's time is spent on."""


@dataclass(frozen=True)
class Frame:
    """A control frame of a run; arrays (N,) by avatar number.

    Attributes:
        number: Its number, from 0.
        action: Action that each avatar does, a number of its policy's graph; -1 where it is absent. int32.
        action_frame: Frames of that action done. float32.
        x: Its position [m]; NaN where it is absent. float32.
        z: Likewise. float32.
        heading: Where it looks [rad], in -pi..pi. float32.
        opponent: Avatar that it fights, ``-2 - k`` for scripted target k, -1 for none. int32.
        targets: Positions of scripted targets [m]. Shape (G, 3), float32.
        events: Strikes thrown since the frame before.
    """

    number: int
    action: Array
    action_frame: Array
    x: Array
    z: Array
    heading: Array
    opponent: Array
    targets: Array
    events: Events


@dataclass(frozen=True)
class Chunk:
    """Some control frames of a run; arrays (frames, N) by avatar number.

    Attributes:
        first: The first of the frames.
        action: Action that each avatar does, a number of its policy's graph; -1 where it is absent. int32.
        action_frame: Frames of that action done. float32.
        x: Its position [m]. float32.
        z: Likewise. float32.
        heading: Where it looks [rad], in -pi..pi. float32.
        opponent: Avatar that it fights, ``-2 - k`` for scripted target k, -1 for none. int32.
        targets: Positions of scripted targets [m]. Shape (frames, G, 3), float32.
        events: Strikes thrown since the frame before the first.
        timings: Time of each of ``STAGES`` [ns], in a run that is profiled. Shape (frames, 6), int64.
    """

    first: int
    action: Array
    action_frame: Array
    x: Array
    z: Array
    heading: Array
    opponent: Array
    targets: Array
    events: Events
    timings: Array | None = None

    @property
    def frames(self) -> int:
        """Number of control frames."""
        return len(self.action)

    def frame(self, index: int) -> Frame:
        """Return one of the frames; it has all strikes of the chunk, so that it should be the only one."""
        values = {name: rows[index] for name, rows in self.variables().items()}
        return Frame(self.first + index, **values, targets=self.targets[index], events=self.events)

    def variables(self) -> dict[str, Array]:
        """Return what is recorded for each frame and avatar, by name."""
        return {name: getattr(self, name) for name in VARIABLES}


def events_of(parts: Sequence[Strikes]) -> Events:
    """Return the strikes of some frames as events, in the order of time, attacker and limb."""
    whole = np.concatenate([part.whole for part in parts])
    real = np.concatenate([part.real for part in parts])
    order = np.lexsort((whole[:, 2], whole[:, 0], real[:, 0]))
    whole, real = whole[order], real[order]
    return Events(
        frame=real[:, 0].copy(),
        attacker=whole[:, 0].copy(),
        victim=whole[:, 1].copy(),
        hand=(whole[:, 2] % 2).astype(np.uint8),
        point=real[:, 1:4].astype(np.float32),
        speed=real[:, 4].astype(np.float32),
        landed=whole[:, 3] == LANDED,
        limb=whole[:, 2].astype(np.uint8),
        outcome=whole[:, 3].astype(np.uint8),
        damage=real[:, 5].astype(np.float32),
        down=whole[:, 4] > 0,
    )
