"""What is found in a clip of a human body, once for all who ask: reports, pictures and the motion database."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion.body import Body
from crowdsim.motion.contacts import find_contacts, find_floor
from crowdsim.motion.falls import FallSpans, find_falls
from crowdsim.motion.skeleton import Clip
from crowdsim.motion.strikes import HANDS, Strikes, find_strikes
from crowdsim.motion.tracks import Tracks, clip_tracks


@dataclass(frozen=True)
class ClipAnalysis:
    """The motion of a body, and what was found in it.

    Attributes:
        clip: The motion on its floor. F frames.
        body: The body on its skeleton, with the joint of each role.
        floor: Height of the floor before [m].
        tracks: Paths of the body's points.
        contacts: Whether the left and right foot are planted. Shape (F, 2), bool.
        strikes: The strikes of the limbs that were asked for.
        falls: Falls and staggers.
    """

    clip: Clip
    body: Body
    floor: float
    tracks: Tracks
    contacts: Array
    strikes: Strikes
    falls: FallSpans


def analyse_clip(clip: Clip, body: Body, calibrate_floor: bool = True, limbs: Sequence[int] = HANDS) -> ClipAnalysis:
    """Find the floor, contacts, strikes and falls of a clip.

    Args:
        clip: The clip in metres, y up, without its lead-in, at 60 frames a second or more for true speeds; at least
            one frame.
        body: The body on its skeleton.
        calibrate_floor: Move the clip so that its planted soles are at y = 0.
        limbs: Limbs whose strikes are found, numbers of ``strikers.LIMBS``.
    """
    clip, floor = on_floor(clip, body) if calibrate_floor else (clip, 0.0)
    tracks = clip_tracks(clip, body)
    return ClipAnalysis(
        clip=clip,
        body=body,
        floor=floor,
        tracks=tracks,
        contacts=find_contacts(tracks, body.height, clip.fps),
        strikes=find_strikes(tracks, body.height, clip.fps, limbs),
        falls=find_falls(tracks, body.height, clip.fps),
    )


def on_floor(clip: Clip, body: Body) -> tuple[Clip, float]:
    """Return the clip moved so that its planted soles are at y = 0, and the height of the floor before [m]."""
    floor = find_floor(clip_tracks(clip, body), clip.fps)
    lift = np.array([0.0, -floor, 0.0])
    moved = clip.translations
    if moved is not None:
        moved = moved.copy()
        moved[:, 0] += lift
    return replace(clip, root_positions=clip.root_positions + lift, translations=moved), floor
