"""Heads turn towards opponents and avatars that fall, within what necks allow, at each control frame of a take."""

from __future__ import annotations

import numpy as np

from crowdsim.core.easing import ease
from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.crowd.record import TakeData
from crowdsim.motion.ground import wrap
from crowdsim.poses.kept import Kept
from crowdsim.poses.kernels.records import Offsets, Posed
from crowdsim.poses.kernels.turning import turn_joints
from crowdsim.poses.layer import Layer, Part, Scheduler
from crowdsim.poses.limbs import turning_of
from crowdsim.poses.smoothing import smooth

_SHARES = {"neck": 0.4, "head": 0.6}
"""Shares of a turn."""
_NEAR, _FAR = 6.0, 10.0
"""Distance up to which avatars look at opponents, and from which they do not [m]."""
_SPREAD = 4
"""Control frames before and after over which a turn is averaged, so that a new opponent turns no head at once."""
_SMOOTH = np.hanning(2 * _SPREAD + 3)[1:-1] / (_SPREAD + 1)
"""Weights of that average."""
MOST, _SOFT = np.deg2rad(75.0), np.deg2rad(30.0)
"""Angle between chest and head about the vertical up to which heads are turned, and range over which they ease into it
[rad]."""
_SEES = 4.0
"""Distance up to which avatars look at one that falls [m]."""
_WAITS, _LOOKS, _TURNS = 0.25, 1.6, 0.3
"""How long after the blow they begin, how long they look, and in which time they turn to it and back [s]."""
_BUSY = 0.1
"""How long before and after that an avatar throws and takes no blow that looks [s]."""
_FREE = np.deg2rad(8.0)
"""Angle off the opponent that heads keep from the motion [rad]."""
_BEHIND = np.deg2rad(120.0)
"""Range, up to straight behind, over which heads stop following: there they would have to choose a side [rad]."""


class Falls:
    """Falls of a take that others look at, if they do not exchange blows themselves meanwhile.

    Args:
        take: The take.
    """

    def __init__(self, take: TakeData) -> None:
        events, rate = take.events, take.control_rate
        down = np.asarray(events.down, bool)
        times, victims = np.asarray(events.frame, float), np.asarray(events.victim)
        attackers = np.asarray(events.attacker)
        self._times, self._victims = times[down], victims[down]
        self._busy: list[Array] = []
        order = np.argsort(times, kind="stable")
        ordered = times[order]
        for time in self._times:
            first, last = np.searchsorted(ordered, (time - _BUSY * rate, time + (_LOOKS + _BUSY) * rate))
            some = order[first:last]
            self._busy.append(np.unique(np.concatenate([attackers[some], victims[some]])))

    def turn_to(self, take: TakeData, first: int, stop: int, avatars: Array, ways: Array) -> None:
        """Turn the ways that avatars (n,) look at control frames ``first`` to ``stop`` to those that fall, in place.

        Args:
            take: The take.
            first: First control frame.
            stop: One past the last.
            avatars: Numbers of avatars.
            ways: Directions, x and z. Shape (stop - first, n, 2).
        """
        rate = take.control_rate
        lasts = (_WAITS + _LOOKS) * rate
        for k in np.flatnonzero((self._times > first - lasts) & (self._times < stop)):
            begin = self._times[k] + _WAITS * rate
            rows = np.arange(max(first, int(np.ceil(begin))), min(stop, int(begin + _LOOKS * rate) + 1))
            free = np.flatnonzero(~np.isin(avatars, self._busy[k]))
            if not len(rows) or not len(free):
                continue
            low, high = int(rows[0]), int(rows[-1]) + 1
            x, z = (np.asarray(values[low:high], dtype=float) for values in (take.x, take.z))
            victim = int(self._victims[k])
            towards = np.stack([x[:, victim, None] - x[:, avatars[free]], z[:, victim, None] - z[:, avatars[free]]], -1)
            far = np.linalg.norm(towards, axis=-1)
            inside = np.minimum(rows - begin, begin + _LOOKS * rate - rows) / (_TURNS * rate)
            share = ease(inside)[:, None] * (np.isfinite(far) & (far < _SEES) & (far > 1e-6))
            mixed = ways[low - first : high - first, free]
            aim = np.where(share[..., None] > 0.0, towards / np.maximum(far, 1e-6)[..., None], 0.0)
            ways[low - first : high - first, free] = mixed + share[..., None] * (aim - mixed)


class HeadTurns(Layer):
    """Turns heads towards opponents."""

    name = "gaze"
    size = 0.04
    hops = 1

    def __init__(self, poser: Scheduler) -> None:
        super().__init__(poser)
        take = poser.take
        self._falls = Falls(take)
        up = np.array([0.0, 1.0, 0.0])
        self._gazes = [turning_of(motion.skeleton, motion.body, _SHARES, up) for motion in poser.motions]
        self.turns = Kept(take.frame_count, take.control_rate, take.avatar_count, (), self._find)

    def prepare(self, avatars: Array, first: float, last: float) -> None:
        """Find how far heads turn."""
        self.turns.rows(self.turns.around(first, last), avatars)

    def plan(self, part: Part) -> Offsets:
        """Return how far heads turn about the vertical [rad]."""
        return self.turns.track(*part.span, part.window.avatars)

    def apply(self, part: Part, poses: Posed) -> None:
        """Turn them."""
        gaze, turns = self._gazes[part.policy], part.plans[self.name]
        share(len(part.moments.columns), turn_joints, part.moments, turns, gaze, poses, threads=part.window.threads)

    def _find(self, frames: Array, avatars: Array) -> Array:
        """Find how far heads of avatars (n,) turn at control frames (T,) [rad]. Shape (T, n)."""
        take, first, stop = self.poser.take, int(frames[0]), int(frames[-1]) + 1
        low, high = max(first - _SPREAD, 0), min(stop + _SPREAD, take.frame_count)
        ways = _ways(take, low, high, avatars)
        self._falls.turn_to(take, low, high, avatars, ways)
        sizes = np.linalg.norm(ways, axis=-1)
        action, done, heading = (
            np.asarray(values[low:high])[:, avatars] for values in (take.action, take.action_frame, take.heading)
        )
        done, heading, turns = done.astype(float), heading.astype(float), np.zeros(action.shape)
        for index, motion in enumerate(self.poser.motions):
            here = (action >= 0) & (take.cast.policies[avatars] == index) & (sizes > 0.0)
            way, playback = ways[here], motion.frames_at(action[here], done[here])
            face, chest = motion.looks[playback].astype(float).T
            error = wrap(np.arctan2(way[:, 0], way[:, 1]) - heading[here] - face)
            follows = sizes[here] * ease((np.pi - np.abs(error)) / _BEHIND)
            turned = wrap(face - chest)
            error = follows * (error - _FREE * np.tanh(error / _FREE))
            # A head that the motion itself turns further stays as it is.
            turns[here] = np.where(motion.down[playback], 0.0, _kept(turned + error) - _kept(turned))
        # Where a take begins and ends, its first and its last frame stand for those beyond.
        return smooth(turns, _SMOOTH)[frames - low]


def _ways(take: TakeData, first: int, stop: int, avatars: Array) -> Array:
    """Directions to opponents at control frames, x and z; shorter where they are far away. Shape (T, n, 2)."""
    x, z = (np.asarray(values[first:stop], dtype=float) for values in (take.x, take.z))
    whom, there = np.asarray(take.opponent[first:stop])[:, avatars], np.asarray(take.action[first:stop]) >= 0
    rows = np.arange(len(x))[:, None]
    seen = np.stack([x[rows, np.maximum(whom, 0)], z[rows, np.maximum(whom, 0)]], axis=-1)
    known = (whom >= 0) & there[rows, np.maximum(whom, 0)]
    if len(take.target_names):
        targets = np.asarray(take.targets[first:stop], dtype=float)[..., [0, 2]]
        scripted = whom < -1
        seen = np.where(scripted[..., None], targets[rows, np.maximum(-2 - whom, 0)], seen)
        known |= scripted
    towards = seen - np.stack([x[:, avatars], z[:, avatars]], axis=-1)
    far = np.linalg.norm(towards, axis=-1)
    known &= there[:, avatars] & (far > 1e-6)
    weights = np.clip((_FAR - far) / (_FAR - _NEAR), 0.0, 1.0)
    # Where nothing is known, positions may be no numbers.
    return np.where(known[..., None], towards * (weights / np.maximum(far, 1e-6))[..., None], 0.0)


def _kept(angles: Array) -> Array:
    """The parts of angles that lie within ``MOST``, smoothly."""
    size, free = np.abs(angles), MOST - _SOFT
    return np.where(size <= free, angles, np.copysign(free + _SOFT * np.tanh((size - free) / _SOFT), angles))
