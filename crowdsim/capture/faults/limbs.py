"""Limbs that were not captured: joints that keep one rotation to the last digit while the others move."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crowdsim.capture.evidence import SIDES
from crowdsim.capture.faults.diagnosis import Diagnosis
from crowdsim.capture.reading import Reading
from crowdsim.core.types import Array
from crowdsim.motion import quaternion
from crowdsim.motion.contacts import runs
from crowdsim.motion.kinematics import clip_kinematics

_SECONDS, _AWHILE = 1.0, 0.5
"""Time for which a clip lasts, and for which a limb keeps still in a clip in which it moves otherwise [s]."""
_SAME = 1e-9
"""Rotation in a frame below which a joint keeps still [rad]."""
_MOVES = np.deg2rad(20.0)
"""How far a joint of another limb turns meanwhile, at the least [rad]."""
_MOST = 0.95
"""Share of frames from which on a limb never moves."""
_KEYED = 2
"""Most of them, with the pelvis, that captures lack: of motion made by hand more may keep still."""
_TRAVELS = 0.2
"""How far a root goes without which nothing moves at all, as a share of the body's height."""
_PELVIS = "the pelvis"
_SHOWN = 4


class Limbs:
    """Arms, legs or a pelvis without rotations of their own, throughout a clip or for a while."""

    name = "limbs"

    def examine(self, reading: Reading) -> Diagnosis | None:
        """Find out which limbs keep still to the last digit while others move, as no captured limb does."""
        clip = reading.clip
        if not reading.roles or not reading.finite or clip.seconds < _SECONDS:
            return None
        still, leans, moving = _stillness(reading)
        if not moving.any():
            size = (reading.scale or 1.0) / (reading.body.height if reading.body else 1.0)
            if np.ptp(reading.path, axis=0).max() * size < _TRAVELS:
                return None
            what = "no joint turns by so much as a digit while the root travels: nothing but its path was captured"
            return Diagnosis(self.name, what, 0.97, "refuse")
        shares = {limb: float(same[moving].mean()) for limb, same in still.items()}
        never = [limb for limb, share in shares.items() if share > _MOST and _others_turn(reading, limb)]
        if len(never) > _KEYED:
            return None
        if never:
            one, share = len(never) == 1, min(shares[limb] for limb in never)
            return Diagnosis(
                self.name,
                f"{_listed(never)} keep{'s' if one else ''} still to the last digit in {100.0 * share:.0f} % of the "
                f"frames in which others move: {'it was' if one else 'they were'} not captured",
                0.95,
                "refuse",
            )
        if not leans and _others_turn(reading, _PELVIS):
            what = "the pelvis keeps upright to the last digit while others move: only its heading was captured"
            return Diagnosis(self.name, what, 0.9, "refuse")
        fixed = still.pop(_PELVIS)
        spans = [
            (int(start), int(stop), limb)
            for limb, same in still.items()
            for start, stop in runs(same & moving & ~fixed)
            if stop - start >= _AWHILE * clip.fps and _others_turn(reading, limb, slice(start, stop + 1))
        ]
        if not spans:
            return None
        lost = np.zeros(clip.frame_count, bool) if reading.lost is None else reading.lost.copy()
        for start, stop, _ in spans:
            lost[start + 1 : stop + 1] = True
        spans.sort()
        shown = ", ".join(f"{limb} in frames {a + 1} to {b}" for a, b, limb in spans[:_SHOWN])
        return Diagnosis(
            self.name,
            f"limbs are frozen while the body moves: {shown}{' ...' if len(spans) > _SHOWN else ''}",
            0.93,
            "leave_out",
            "they are left out",
            lambda: replace(reading, lost=lost),
        )


def _joints(reading: Reading) -> dict[str, list[int]]:
    """Joints that carry each limb, from where it begins to the joint before its end."""
    parents, roles = reading.raw.skeleton.parents, reading.roles
    found = {}
    for limb, top, end in (("arm", "shoulder", "hand"), ("leg", "hip", "foot")):
        for side in SIDES:
            chain = [int(parents[roles[f"{side}_{end}"]])]
            while chain[-1] != roles[f"{side}_{top}"]:
                chain.append(int(parents[chain[-1]]))
            found[f"the {side} {limb}"] = chain
    return found


def _stillness(reading: Reading) -> tuple[dict[str, Array], bool, Array]:
    """Steps (F - 1,) in which each limb keeps still; whether the pelvis ever leans; steps in which any joint moves."""
    rotations = reading.clip.rotations
    turned = _turns(rotations)
    moving = np.asarray(turned.max(axis=1) > _SAME)
    still = {limb: np.asarray((turned[:, joints] < _SAME).all(axis=1)) for limb, joints in _joints(reading).items()}
    # What hangs above the pelvis turns it as well.
    pelvis = clip_kinematics(reading.clip)[1][:, reading.roles["pelvis"]]
    still[_PELVIS] = np.asarray(_turns(pelvis) < _SAME)
    upright = quaternion.rotate(pelvis, quaternion.rotate(quaternion.conjugate(pelvis[0]), np.array([0.0, 1.0, 0.0])))
    if reading.clip.translations is not None:
        for limb, joints in _joints(reading).items():
            moved = np.abs(np.diff(reading.clip.translations[:, joints], axis=0)).max(axis=(1, 2))
            still[limb] &= moved < _SAME
            moving |= moved >= _SAME
    return still, bool(np.ptp(upright, axis=0).max() > _SAME), moving


def _turns(rotations: Array) -> Array:
    """By how much rotations (F, ..., 4) turn from frame to frame [rad]. Shape (F - 1, ...)."""
    apart = quaternion.multiply(quaternion.conjugate(rotations[:-1]), rotations[1:])
    return 2.0 * np.linalg.norm(apart[..., 1:], axis=-1)


def _others_turn(reading: Reading, limb: str, frames: slice = slice(None)) -> bool:
    """Whether joints of another limb turn far in some frames."""
    joints = [joint for other, chain in _joints(reading).items() if other != limb for joint in chain]
    rotations = reading.clip.rotations[frames][:, joints]
    dots = np.minimum(np.abs(np.einsum("fjc,jc->fj", rotations, rotations[0])), 1.0)
    return bool(2.0 * np.arccos(dots).max() > _MOVES)


def _listed(limbs: list[str]) -> str:
    return limbs[0] if len(limbs) == 1 else f"{', '.join(limbs[:-1])} and {limbs[-1]}"
