"""Joints that turn away and back at once: frames that are wrong, and angles that were interpolated across a turn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from crowdsim.bvh.io import Bvh
from crowdsim.capture.columns import rotation_columns
from crowdsim.capture.faults.diagnosis import Diagnosis
from crowdsim.capture.reading import Reading
from crowdsim.capture.turning import angles_between, directions_of_bones, pose_jumps
from crowdsim.motion import quaternion
from crowdsim.motion.contacts import runs
from crowdsim.motion.measuring import lead_in

_FASTEST, _SUDDEN = 60.0, 40.0
"""Speeds at which no body's joint turns against its parent, and none that is back after two frames [rad/s]."""
_AWAY = np.deg2rad(25.0)
"""How far a joint turns meanwhile, at the least [rad]."""
_BACK = 0.35
"""Share of that by which it may be elsewhere in the end: what does not come back is another pose."""
_LONGEST = 0.12
"""Longest time of such a turn [s]."""
_MOST = 0.05
"""Share of all frames above which nothing is certain about a joint."""
_SHOWN = 4


class Spins:
    """Joints that turn faster than any body's, and are back within a tenth of a second."""

    name = "spins"

    def examine(self, reading: Reading) -> Diagnosis | None:
        """Find turns of single joints that are undone at once, and draw their rotations through them."""
        clip, body = reading.clip, reading.body
        if body is None or not reading.finite or clip.frame_count < 8:
            return None
        begun = lead_in(clip, body)
        lost = np.zeros(clip.frame_count, bool) if reading.lost is None else reading.lost
        found = [spin for spin in _find_spins(reading) if spin[1] > begun and not lost[spin[1] - 1 : spin[2] + 1].any()]
        # Where many joints turn at once, the whole pose is another one.
        leaps = pose_jumps(reading)
        found = [spin for spin in found if not ((spin[1] <= leaps) & (leaps <= spin[2])).any()]
        if not found:
            return None
        frames = np.zeros(clip.frame_count, bool)
        for _, start, stop in found:
            frames[start:stop] = True
        names = list(dict.fromkeys(clip.skeleton.names[joint] for joint, _, _ in found))
        shown = ", ".join(map(repr, names[:_SHOWN])) + (" ..." if len(names) > _SHOWN else "")
        spans = ", ".join(f"{a} to {b - 1}" if b - a > 1 else str(a) for _, a, b in found[:_SHOWN])
        more = " ..." if len(found) > _SHOWN else ""
        what = f"joints turn away and back faster than a body's: {shown} in frames {spans}{more}"
        if frames.mean() > _MOST:
            return Diagnosis(self.name, what, 0.95, "refuse")
        return Diagnosis(
            self.name,
            what,
            0.95,
            "repair",
            "rotations between are taken from those around",
            lambda: replace(reading, bvh=_drawn(reading, found)),
        )


def _find_spins(reading: Reading) -> list[tuple[int, int, int]]:
    """(joint, first frame, frame behind the last) of all turns that are undone, by their first frames."""
    clip = reading.raw
    longest = max(2, round(_LONGEST * clip.fps))
    found: list[tuple[int, int, int]] = []
    for joint, turns in directions_of_bones(reading).items():
        speeds = angles_between(turns[:-1], turns[1:]) * clip.fps
        for start, stop in runs(speeds > _SUDDEN):
            # From the frame before the first fast step to the one in which the joint is back.
            end = min(stop + longest, clip.frame_count - 1)
            apart = angles_between(turns[start], turns[start + 1 : end + 1])
            back = np.flatnonzero(apart < _BACK * np.maximum.accumulate(apart))
            fast = speeds[start:stop].max() > (_FASTEST if len(back) and back[0] > 1 else _SUDDEN)
            if len(back) and fast and apart[: back[0] + 1].max() > _AWAY:
                last = start + 1 + int(back[0])
                if not found or found[-1][0] != joint or start >= found[-1][2]:
                    found.append((joint, int(start) + 1, last))
    return sorted(found, key=lambda spin: spin[1:])


def _drawn(reading: Reading, spins: list[tuple[int, int, int]]) -> Bvh:
    """The file with rotations of joints, in some frames, between those of the frames around."""
    from scipy.spatial.transform import Rotation

    bvh, rotations = reading.bvh, reading.raw.rotations
    motion, starts = bvh.motion.copy(), bvh.first_channels()
    columns = set(rotation_columns(bvh).tolist())
    for joint, start, stop in spins:
        own = [column for column in range(int(starts[joint]), int(starts[joint + 1])) if column in columns]
        shares = (np.arange(start, stop) - start + 1.0) / (stop - start + 1.0)
        if len(own) == 3:
            order = "".join(bvh.channels[joint][column - int(starts[joint])][0] for column in own)
            between = quaternion.slerp(rotations[start - 1, joint], rotations[stop, joint], shares)
            motion[start:stop, own] = Rotation.from_quat(between[:, [1, 2, 3, 0]]).as_euler(order, degrees=True)
        else:
            before, after = motion[start - 1, own], motion[stop, own]
            turn = (after - before + 180.0) % 360.0 - 180.0
            motion[start:stop, own] = before + shares[:, None] * turn
    return replace(bvh, motion=motion)
