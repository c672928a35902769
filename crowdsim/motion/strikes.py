"""Strikes found in unlabelled motion: a limb's speed peak, then its furthest reach (paper section 6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import ground
from crowdsim.motion.body import HEIGHT
from crowdsim.motion.kicks import foot_swing
from crowdsim.motion.striker_swings import other_swing
from crowdsim.motion.strikers import HANDS as HANDS
from crowdsim.motion.strikers import HANDS_AND_FEET as HANDS_AND_FEET
from crowdsim.motion.strikers import LIMBS as LIMBS
from crowdsim.motion.strikers import SIDES as SIDES
from crowdsim.motion.swings import Rejection, Swing, judge_swings
from crowdsim.motion.tracks import Tracks, speeds

MINIMUM_SPEED = 2.3
"""Lowest speed of a striking fist relative to the pelvis, for a body of ``HEIGHT`` [m/s]."""
MINIMUM_GAIN = 0.25
"""How much further out than before the swing a fist must reach, for a body of ``HEIGHT`` [m]."""
_NEAR = 0.48
"""How near to the middle between the shoulders a fist is before it strikes, for a body of ``HEIGHT`` [m]."""
_STEADY, _BEFORE, _TURN = 0.3, 0.25, np.deg2rad(45.0)
"""Where the opponent is: where the body faces, smoothed by a Gaussian of this deviation [s], since trunks turn with
hooks; or where it faced that long before [s], if it turns by less than this angle: some turn away as they strike."""
_AHEAD, _ASIDE, _AHEAD_SOON, _ASIDE_SOON, _ON = 0.06, np.deg2rad(86.0), 0.14, np.deg2rad(66.0), 0.15
"""Least distance ahead of the shoulders, for a body of ``HEIGHT`` [m], and greatest angle to the opponent, of a fist at
its furthest reach, and within some time after it [s]: fists of hooks go on ahead, arms that are spread stay aside."""
_BESIDE = np.deg2rad(75.0)
"""Greatest angle to where the trunk faces within that time: one spins with its arms spread, and strikes nothing."""
_RESOLVED = 30.0
"""Frames a second from which on it is known where a strike ends; at fewer, a fist moves half an arm between two."""
_OVER_HEAD = 0.25
"""How far above the centre of the own head a strike may end, for a body of ``HEIGHT`` [m]; the hips are the lowest."""

REASONS = {
    Rejection.NO_REACH: "its reach comes to no maximum",
    Rejection.NOT_ARRIVED: "it does not arrive within 0.3 s",
    Rejection.SHORT: f"it gets less than {MINIMUM_GAIN:g} m further out",
    Rejection.REPEATED: "a faster one is less than 0.2 s away",
    Rejection.BENT: "a raised leg stays bent",
    Rejection.FAR: f"it begins further than {_NEAR:g} m from the shoulders",
    Rejection.AWAY: "it ends aside, behind, below the hips or overhead, where no opponent stands",
}
"""What each rejection means; lengths are those of a fist of a body of ``HEIGHT``."""


@dataclass(frozen=True)
class Rejected:
    """Peaks of a limb's speed that are high enough for a strike and are none, ordered by frame.

    Attributes:
        peaks: Frame of each peak. Shape (R,), int32.
        limbs: Numbers of ``LIMBS``. Shape (R,), uint8.
        speeds: Speed there, relative to the pelvis [m/s]. Shape (R,), float32.
        reasons: Why each is none, values of ``Rejection``. Shape (R,), uint8.
    """

    peaks: Array
    limbs: Array
    speeds: Array
    reasons: Array


def describe_strikes_needed(height: float) -> str:
    """Return in words what makes a movement of a fist a strike, for a body of a standing height [m]."""
    size = height / HEIGHT
    return (
        f"a strike is a fist that moves at {MINIMUM_SPEED * size:.1f} m/s or more relative to the pelvis "
        f"and then reaches {MINIMUM_GAIN * size:.2f} m or more further out, ahead of the body"
    )


@dataclass(frozen=True)
class Strikes:
    """Strikes of one clip, ordered by frame.

    Attributes:
        frames: Frame at which each strike reaches furthest. Shape (S,), int32.
        limbs: Numbers of ``LIMBS``. Shape (S,), uint8.
        peaks: Frame of the limb's highest speed before. Shape (S,), int32.
        speeds: That speed, relative to the pelvis [m/s]. Shape (S,), float32.
        positions: Position of the fist or foot at ``frames`` in that frame's ground frame [m]. Shape (S, 3), float32.
        highest_speed: Highest fist speed of the clip, strike or not [m/s].
        rejected: Fast swings that are no strikes.
    """

    frames: Array
    limbs: Array
    peaks: Array
    speeds: Array
    positions: Array
    highest_speed: float
    rejected: Rejected


def fist_speed(tracks: Tracks, hand: int, fps: float) -> Array:
    """Return the speed of a fist relative to the pelvis, smoothed as ``find_strikes`` sees it [m/s]. Shape (F,)."""
    from scipy.ndimage import gaussian_filter1d

    return np.asarray(gaussian_filter1d(speeds(tracks.fists[:, hand] - tracks.pelvises, fps), 0.01 * fps))


def fist_swing(tracks: Tracks, hand: int, size: float, fps: float) -> Swing:
    """Return what a fist does.

    Its reach is its distance from the middle between the shoulders, which grows in straights, hooks and uppercuts
    alike.

    Args:
        tracks: Paths of the body's points.
        hand: 0 left, 1 right.
        size: Height of the body over ``HEIGHT``.
        fps: Frames a second.
    """
    from scipy.ndimage import gaussian_filter1d

    centre = tracks.shoulders.mean(axis=1)
    everywhere = np.ones(len(centre), bool)
    opposite, ahead = opposite_of(tracks, tracks.fists[:, hand], size, fps)
    return Swing(
        speed=fist_speed(tracks, hand, fps),
        reach=gaussian_filter1d(np.linalg.norm(tracks.fists[:, hand] - centre, axis=1), 0.01 * fps),
        least_speed=MINIMUM_SPEED * size,
        least_gain=MINIMUM_GAIN * size,
        raised=everywhere,
        stretched=everywhere,
        opposite=opposite,
        near=_NEAR * size,
        ahead=ahead,
    )


def opposite_of(tracks: Tracks, fist: Array, size: float, fps: float) -> tuple[Array, Array]:
    """Return where a fist at its furthest reach goes to where an opponent could stand, and how far ahead it is [m].

    Args:
        tracks: Paths of the body's points.
        fist: Path of the fist, or of something else that strikes [m]. Shape (F, 3).
        size: Height of the body over ``HEIGHT``.
        fps: Frames a second; where they are too few, it is everywhere.
    """
    from scipy.ndimage import gaussian_filter1d, maximum_filter1d

    if fps < _RESOLVED:
        return np.ones(len(fist), bool), np.zeros(len(fist))
    centre = tracks.shoulders.mean(axis=1)
    trunk = tracks.ground[:, 2]
    steady = gaussian_filter1d(trunk, _STEADY * fps, mode="nearest")
    before = steady[np.maximum(np.arange(len(steady)) - round(_BEFORE * fps), 0)]
    count = max(1, round(_ON * fps))

    def soon(where: Array) -> Array:
        found = maximum_filter1d(where, count + 1, origin=-((count + 1) // 2), mode="constant", cval=False)
        return np.asarray(found)

    def seen(heading: Array) -> tuple[Array, Array]:
        across, _, ahead = ground.to_local(np.stack([centre[:, 0], centre[:, 2], heading], axis=1), fist).T
        return ahead / size, np.arctan2(np.abs(across), ahead)

    met = np.zeros(len(fist), bool)
    for heading in (steady, np.where(np.abs(before - steady) < _TURN, before, steady)):
        ahead, aside = seen(heading)
        met |= (ahead > _AHEAD) & (aside < _ASIDE) & soon((ahead > _AHEAD_SOON) & (aside < _ASIDE_SOON))
    height = fist[:, 1]
    met &= (height > tracks.pelvises[:, 1]) & (height < tracks.heads[:, 1] + _OVER_HEAD * size)
    return np.asarray(met & soon(seen(trunk)[1] < _BESIDE)), np.asarray(seen(steady)[0] * size)


def find_strikes(tracks: Tracks, height: float, fps: float, limbs: Sequence[int] = HANDS) -> Strikes:
    """Find the strikes of some limbs.

    A strike is a peak of the limb's speed relative to the pelvis, after which its reach comes to a local maximum that
    lies well beyond where the swing began, ahead of the body (``fist_swing``, ``kicks.foot_swing``,
    ``striker_swings.other_swing``, ``judge_swings``).

    Args:
        tracks: Paths of the body's points.
        height: Standing height of the body [m]; speeds and lengths scale with it.
        fps: Frames a second, 60 or more for true speeds.
        limbs: Numbers of ``LIMBS``.
    """
    size = height / HEIGHT
    found: list[tuple[int, int, int, float]] = []
    rejected: list[tuple[int, int, float, Rejection]] = []
    highest = 0.0
    for hand in HANDS:
        highest = max(highest, float(fist_speed(tracks, hand, fps).max(initial=0.0)))
    for limb in sorted(set(limbs)):
        swing = _swing(tracks, limb, size, fps)
        kept, others = judge_swings(swing, fps)
        found.extend((frame, limb, peak, float(swing.speed[peak])) for frame, peak in kept)
        rejected.extend((peak, limb, float(swing.speed[peak]), reason) for peak, reason in others)
    found.sort()
    frames = np.array([strike[0] for strike in found], np.int32)
    numbers = np.array([strike[1] for strike in found], np.uint8)
    places = tracks.strikers[frames, numbers]
    return Strikes(
        frames=frames,
        limbs=numbers,
        peaks=np.array([strike[2] for strike in found], np.int32),
        speeds=np.array([strike[3] for strike in found], np.float32),
        positions=ground.to_local(tracks.ground[frames], places).astype(np.float32),
        highest_speed=highest,
        rejected=_rejected(sorted(rejected)),
    )


def _swing(tracks: Tracks, limb: int, size: float, fps: float) -> Swing:
    """Return what a limb does."""
    if limb in HANDS:
        return fist_swing(tracks, limb, size, fps)
    if limb in HANDS_AND_FEET:
        return foot_swing(tracks, limb - 2, size, fps)
    return other_swing(tracks, limb, opposite_of(tracks, tracks.strikers[:, limb], size, fps), size, fps)


def _rejected(swings: list[tuple[int, int, float, Rejection]]) -> Rejected:
    return Rejected(
        peaks=np.array([swing[0] for swing in swings], np.int32),
        limbs=np.array([swing[1] for swing in swings], np.uint8),
        speeds=np.array([swing[2] for swing in swings], np.float32),
        reasons=np.array([swing[3] for swing in swings], np.uint8),
    )
