"""What ``crowdsim inspect FILE.bvh`` tells: the figures of a capture as plain data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from crowdsim.capture.loading import Capture
from crowdsim.core.types import Array
from crowdsim.motion.cleaning import on_floor
from crowdsim.motion.contacts import find_contacts, runs
from crowdsim.motion.kinematics import clip_kinematics
from crowdsim.motion.resampling import resample
from crowdsim.motion.skeleton import Clip
from crowdsim.motion.strikes import Rejection, Strikes, find_strikes
from crowdsim.motion.tracks import Tracks, build_tracks

PLAYBACK_RATE = 60.0
HANDS = ("left", "right")
"""Words for the numbers of hands."""


@dataclass(frozen=True)
class Study:
    """A capture without its lead-in, on the floor, at the playback rate, with what was found in it.

    Attributes:
        clip: The motion.
        positions: Joint positions in the world [m]. Shape (F, J, 3).
        tracks: Paths of the body's points.
        contacts: Whether each foot is planted. Shape (F, 2).
        strikes: The strikes of both hands.
        floor: Height of the floor in the file [m].
        start: Time of the first frame in the file [s].
    """

    clip: Clip
    positions: Array
    tracks: Tracks
    contacts: Array
    strikes: Strikes
    floor: float
    start: float


def study_capture(capture: Capture) -> Study | None:
    """Find contacts and strikes; None where there is no body that moves or a channel is not finite."""
    clip = capture.motion
    if capture.body is None or clip.frame_count < 2:
        return None
    if not (np.isfinite(clip.root_positions).all() and np.isfinite(clip.rotations).all()):
        return None
    clip = resample(clip, PLAYBACK_RATE)
    clip, floor = on_floor(clip, capture.body)
    positions, rotations = clip_kinematics(clip)
    tracks = build_tracks(capture.body, positions, rotations)
    height = capture.body.height
    contacts = find_contacts(tracks, height, clip.fps)
    strikes = find_strikes(tracks, height, clip.fps)
    return Study(clip, positions, tracks, contacts, strikes, floor, capture.lead_in / capture.clip.fps)


def describe_capture(capture: Capture, study: Study | None) -> dict[str, Any]:
    """Return a capture's figures; times are seconds in the file, places metres in the ground frame."""
    bvh, skeleton = capture.bvh, capture.clip.skeleton
    told: dict[str, Any] = {
        "joints": bvh.joint_count,
        "end_sites": len(bvh.end_parents),
        "channels": bvh.channel_count,
        "frames": bvh.frame_count,
        "fps": bvh.fps,
        "seconds": bvh.frame_count / bvh.fps,
        "unit_scale": capture.unit_scale,
        "up_axis": capture.up_axis,
        "height_m": None if capture.body is None else round(capture.body.height, 4),
        "roles": {role: skeleton.names[joint] for role, joint in capture.roles.items()},
        "lead_in_frames": capture.lead_in,
        "floor_m": None,
        "contacts": None,
        "contact_share": None,
        "strikes": None,
        "highest_fist_speed": None,
        "strike_list": [],
        "rejected_list": [],
        "findings": list(capture.findings),
    }
    if study is None:
        return told
    strikes = study.strikes
    told.update(
        floor_m=round(study.floor, 4),
        contacts=sum(len(runs(study.contacts[:, foot])) for foot in range(2)),
        contact_share=[round(float(share), 4) for share in study.contacts.mean(axis=0)],
        strikes=len(strikes.frames),
        highest_fist_speed=round(strikes.highest_speed, 3),
        strike_list=[
            {
                "seconds": round(study.start + int(frame) / study.clip.fps, 4),
                "frame": round((study.start + int(frame) / study.clip.fps) * bvh.fps),
                "hand": HANDS[int(hand)],
                "speed": round(float(speed), 3),
                "place": [round(float(value), 4) for value in place],
            }
            for frame, hand, speed, place in zip(
                strikes.frames, strikes.hands, strikes.speeds, strikes.places, strict=True
            )
        ],
        rejected_list=_rejected(study),
    )
    return told


def _rejected(study: Study) -> list[dict[str, Any]]:
    """Fast swings of a capture that are no strikes, with the reason."""
    rejected = study.strikes.rejected
    return [
        {
            "seconds": round(study.start + int(peak) / study.clip.fps, 4),
            "hand": HANDS[int(hand)],
            "speed": round(float(speed), 3),
            "reason": Rejection(int(reason)).name.lower(),
        }
        for peak, hand, speed, reason in zip(
            rejected.peaks, rejected.hands, rejected.speeds, rejected.reasons, strict=True
        )
    ]
