"""What is found in a clip of a human body, once for all who ask: reports, pictures and the motion database."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array
from crowdsim.errors import MotionError
from crowdsim.motion.body import Body
from crowdsim.motion.cleaning import lead_in, on_floor
from crowdsim.motion.contacts import find_contacts
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.measuring import finite_frames, measure_body
from crowdsim.motion.skeleton import Clip
from crowdsim.motion.strikes import Strikes, find_strikes
from crowdsim.motion.tracks import Tracks, build_tracks


@dataclass(frozen=True)
class MeasuredClip:
    """A clip with the body that moves in it.

    Attributes:
        clip: The motion as it was recorded, in metres, y up; every number is finite.
        body: The body on its skeleton, with the joint of each role.
        lead_in: Frames at the start that are a calibration pose and the jump out of it.
    """

    clip: Clip
    body: Body
    lead_in: int = 0


@dataclass(frozen=True)
class ClipAnalysis:
    """The motion of a body, and what was found in it.

    Attributes:
        clip: The motion on its floor. F frames.
        body: The body on its skeleton, with the joint of each role.
        floor: Height of the floor before [m].
        tracks: Paths of the body's points.
        contacts: Whether the left and right foot are planted. Shape (F, 2), bool.
        strikes: The strikes of both hands.
    """

    clip: Clip
    body: Body
    floor: float
    tracks: Tracks
    contacts: Array
    strikes: Strikes


def measure_clips(clips: Sequence[Clip]) -> list[MeasuredClip]:
    """Measure clips of one skeleton: the body of the first is that of all.

    Raises:
        MotionError: A clip is not finite, or its skeleton is no human body.
    """
    measured: list[MeasuredClip] = []
    for clip in clips:
        body = measured[0].body if measured else measure_body(clip)
        bad = np.flatnonzero(~finite_frames(clip))
        if len(bad):
            raise MotionError(f"clip {clip.name!r} is not finite in frame {bad[0]}, and in {len(bad)} frames in all")
        measured.append(MeasuredClip(clip, body, lead_in(clip, body)))
    return measured


def analyse_clip(clip: Clip, body: Body, calibrate_floor: bool = True) -> ClipAnalysis:
    """Find the floor, contacts and strikes of a clip.

    Args:
        clip: The clip in metres, y up, without its lead-in, at 60 frames a second or more for true speeds; at least
            one frame.
        body: The body on its skeleton.
        calibrate_floor: Move the clip so that its planted soles stand at y = 0.
    """
    clip, floor = on_floor(clip, body) if calibrate_floor else (clip, 0.0)
    tracks = build_tracks(body, *clip_kinematics(clip))
    return ClipAnalysis(
        clip=clip,
        body=body,
        floor=floor,
        tracks=tracks,
        contacts=find_contacts(tracks, body.height, clip.fps),
        strikes=find_strikes(tracks, body.height, clip.fps),
    )
