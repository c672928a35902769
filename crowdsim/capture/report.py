"""What ``crowdsim inspect FILE.bvh`` reports: the figures of a capture as plain data."""

from __future__ import annotations

from typing import Any

from crowdsim.capture.loading import Capture
from crowdsim.motion.analysis import ClipAnalysis
from crowdsim.motion.contacts import runs
from crowdsim.motion.strikers import HANDS_AND_FEET, LIMBS, SIDES
from crowdsim.motion.strikes import Rejection


def describe_capture(capture: Capture) -> dict[str, Any]:
    """Return a capture's figures; times are seconds in the file, positions metres in the ground frame."""
    bvh, skeleton, analysis = capture.bvh, capture.clip.skeleton, capture.analysis
    result: dict[str, Any] = {
        "joints": bvh.joint_count,
        "end_sites": len(bvh.end_parents),
        "channels": bvh.channel_count,
        "frames": bvh.frame_count,
        "fps": capture.clip.fps,
        "seconds": capture.clip.seconds,
        "unit_scale": capture.unit_scale,
        "up_axis": capture.up_axis,
        "height_m": None if capture.body is None else round(capture.body.height, 4),
        "roles": {role: skeleton.names[joint] for role, joint in capture.roles.items()},
        "lead_in_frames": capture.lead_in,
        "lost_frames": bvh.frame_count - capture.lead_in - sum(stop - start for start, stop in capture.spans),
        "floor_m": None,
        "contacts": None,
        "contact_share": None,
        "strikes": None,
        "strikes_by_limb": None,
        "highest_fist_speed": None,
        "strike_list": [],
        "rejected_list": [],
        "faults": [
            {
                "fault": outcome.diagnosis.fault,
                "what": outcome.diagnosis.what,
                "confidence": round(outcome.diagnosis.confidence, 3),
                "done": outcome.done,
                "remedy": outcome.diagnosis.remedy or None,
            }
            for outcome in capture.diagnoses
        ],
        "findings": list(capture.findings),
    }
    if analysis is None:
        return result
    strikes, fps = analysis.strikes, analysis.clip.fps
    result.update(
        floor_m=round(analysis.floor, 4),
        contacts=sum(len(runs(analysis.contacts[:, foot])) for foot in range(2)),
        contact_share=[round(float(share), 4) for share in analysis.contacts.mean(axis=0)],
        strikes=len(strikes.frames),
        strikes_by_limb={LIMBS[limb]: int((strikes.limbs == limb).sum()) for limb in HANDS_AND_FEET},
        highest_fist_speed=round(strikes.highest_speed, 3),
        strike_list=[
            {
                "seconds": round(capture.start + int(frame) / fps, 4),
                "frame": round((capture.start + int(frame) / fps) * capture.clip.fps),
                "hand": SIDES[int(limb) % 2],
                "limb": LIMBS[int(limb)],
                "speed": round(float(speed), 3),
                "place": [round(float(value), 4) for value in place],
            }
            for frame, limb, speed, place in zip(
                strikes.frames, strikes.limbs, strikes.speeds, strikes.positions, strict=True
            )
        ],
        rejected_list=_rejected(capture.start, analysis),
    )
    return result


def _rejected(start: float, analysis: ClipAnalysis) -> list[dict[str, Any]]:
    """Fast swings of a capture whose motion begins at ``start`` [s] that are no strikes, with the reason."""
    rejected = analysis.strikes.rejected
    return [
        {
            "seconds": round(start + int(peak) / analysis.clip.fps, 4),
            "hand": SIDES[int(limb) % 2],
            "limb": LIMBS[int(limb)],
            "speed": round(float(speed), 3),
            "reason": Rejection(int(reason)).name.lower(),
        }
        for peak, limb, speed, reason in zip(
            rejected.peaks, rejected.limbs, rejected.speeds, rejected.reasons, strict=True
        )
    ]
