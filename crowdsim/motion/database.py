"""The motion database: all clips in one, with a global frame index; clips are only ranges of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from crowdsim.motion.body import Body
from crowdsim.motion.skeleton import Skeleton

Array = NDArray[Any]


@dataclass(frozen=True)
class MotionDatabase:
    """Motion of one skeleton at the playback rate, on a common floor, with what was found in it.

    Every clip holds whole control frames, so playback frame ``p`` lies at control frame ``p / stride`` for all clips.
    F counts control frames, P = F * stride playback frames, J joints, S strikes, C clips.

    Attributes:
        skeleton: The skeleton of every clip [m].
        body: What the skeleton is as a body.
        control_rate: Control frames a second.
        playback_rate: Playback frames a second.
        clip_names: Names of the clips, a mirrored one with the suffix ``~mirror``. Length C.
        clip_starts: First control frame of each clip, and F. Shape (C + 1,), int32.
        root_positions: Place of the root in its clip's world, the floor at 0 [m]. Shape (P, 3), float32.
        rotations: Local joint rotations, continuous in sign within a clip. Shape (P, J, 4), float32.
        ground: Ground transform of the body (pelvis over the floor, and facing) in its clip's world. Shape (P, 3),
            float64; headings are continuous within a clip.
        contacts: Whether the left and right foot are planted. Shape (P, 2), bool.
        fists: Place of the left and right fist in the frame's own ground frame [m]. Shape (P, 2, 3), float32.
        heads: Centre of the head in the frame's own ground frame [m]. Shape (P, 3), float32.
        necks: Upper end of the torso's capsule, likewise. Shape (P, 3), float32.
        pelvises: Lower end of the torso's capsule, likewise. Shape (P, 3), float32.
        strike_frames: Playback frame at which each strike reaches furthest, ascending. Shape (S,), int32.
        strike_hands: 0 for the left hand, 1 for the right. Shape (S,), uint8.
        strike_peaks: Playback frame of the fist's highest speed before that. Shape (S,), int32.
        strike_speeds: That speed, relative to the pelvis [m/s]. Shape (S,), float32.
        strike_places: Place of the fist at ``strike_frames`` in that frame's ground frame [m]. Shape (S, 3), float32.
    """

    skeleton: Skeleton
    body: Body
    control_rate: float
    playback_rate: float
    clip_names: tuple[str, ...]
    clip_starts: Array
    root_positions: Array
    rotations: Array
    ground: Array
    contacts: Array
    fists: Array
    heads: Array
    necks: Array
    pelvises: Array
    strike_frames: Array
    strike_hands: Array
    strike_peaks: Array
    strike_speeds: Array
    strike_places: Array

    @property
    def stride(self) -> int:
        """Playback frames in a control frame."""
        return round(self.playback_rate / self.control_rate)

    @property
    def frame_count(self) -> int:
        """Number of control frames F."""
        return int(self.clip_starts[-1])

    @property
    def seconds(self) -> float:
        """Length of all clips [s]."""
        return self.frame_count / self.control_rate
