"""The plan of a clip, move by move: each move is drawn at random, so that no two are the same."""

from __future__ import annotations

import numpy as np

from crowdsim.performer.aim import ARMS, ELBOWS, Aim
from crowdsim.performer.defences import DEFENCES
from crowdsim.performer.moves import Part, Punch
from crowdsim.performer.punches import PUNCHES
from crowdsim.performer.score import (
    BENDS,
    Accent,
    Channel,
    Defence,
    Fall,
    Reach,
    Rest,
    Score,
    Stagger,
)
from crowdsim.performer.steps import Stepper

_BACKWARD = frozenset({Channel.BEND, Channel.SHIFT_X, Channel.TWIST})
_GATHER, _SETTLE = 0.17, 0.37
"""Least time in which legs and trunk go into a punch, and about the least in which they come out of it [s]."""


class Choreographer(Stepper):
    """Writes a score by moves at given times [s], which may overlap.

    Attributes:
        hands_free: When each hand is back in the guard [s].
    """

    def __init__(self, rng: np.random.Generator, facing: float | None = None) -> None:
        super().__init__(rng, facing)
        self.hands_free = [0.0, 0.0]
        self._reaches: list[Reach] = []
        self._defences: list[Defence] = []

    @property
    def last_hit(self) -> float:
        """When the last punch so far reaches its target [s]; 0 before the first."""
        return self._reaches[-1].hit if self._reaches else 0.0

    def punch(
        self,
        kind: str,
        onset: float,
        to_body: bool = False,
        bearing: float = 0.0,
        distance: float | None = None,
        speed: float | None = None,
        height: float | None = None,
    ) -> Reach:
        """Throw a punch whose fist sets off at ``onset`` [s], later where the hand is not back yet.

        Args:
            kind: A key of ``PUNCHES``.
            onset: When the fist sets off [s].
            to_body: To the body, not to the head.
            bearing: Where the opponent is, in the stance frame [rad]; the punch's own spread comes on top.
            distance: Of the target, over the ground [m]; drawn when None.
            speed: The fist's highest speed relative to the pelvis, roughly [m/s]; drawn when None.
            height: Of the target [m]; drawn when None.
        """
        rng, recipe = self.rng, PUNCHES[kind]
        onset = max(onset, self.hands_free[recipe.hand])
        if speed is None:
            speed = recipe.speed[0] + recipe.speed[1] * self.normal(1.6, 2.4)
        if distance is None:
            distance = float(rng.uniform(*recipe.distance))
        if height is None:
            height = float(rng.uniform(*(recipe.body if to_body else recipe.head)))
        bearing += recipe.bearing[0] + recipe.bearing[1] * self.normal(2.0)
        aim = Aim(recipe, bearing, distance, height)
        out = max(1.27 * (self._way_out(recipe.hand, bearing, distance, height) + recipe.extra) / speed, 0.14)
        hit = onset + out
        fall = hit + rng.uniform(0.0, 0.025)
        end = fall + out * rng.uniform(0.95, 1.2)
        reach = Reach(
            kind=kind,
            hand=recipe.hand,
            start=onset - recipe.early * out,
            hit=hit,
            fall=fall,
            end=end,
            bearing=bearing,
            distance=distance,
            height=height,
            skew=recipe.skew,
            path=self._move_body(recipe, aim, onset, hit, end),
        )
        self._reaches.append(reach)
        self.hands_free[recipe.hand] = end - 0.12 * (end - hit)
        return reach

    def _move_body(self, recipe: Punch, aim: Aim, onset: float, hit: float, end: float) -> tuple[Accent, ...]:
        """Add what the body does in a punch, and return the accents that bend the path of its fist."""
        vigour = self.about(1.0, 0.08)
        gather, settle = min(onset, hit - _GATHER), max(end, hit + self.about(_SETTLE, 0.15))
        wound = any(other.hand != recipe.hand and other.hit > onset - 0.35 for other in self._reaches[-2:])
        before = len(self._accents)
        for part in recipe.parts:
            size = self.about(part.size, 0.12) * vigour * aim.share(part, wound)
            arm = part.channel in ARMS and part.channel not in ELBOWS
            back = settle if part.channel not in ARMS else end
            self._play(part, size, onset if arm else gather, hit, hit, back, 0.03)
        self._aim(aim, gather, hit, settle)
        for channel, size in aim.draws():
            self.accent(channel, size, onset - 0.2, onset - 0.02, onset + 0.02, hit)
        path = tuple(accent for accent in self._accents[before:] if accent.channel in BENDS[recipe.hand])
        self._accents[before:] = [accent for accent in self._accents[before:] if accent not in path]
        return path

    def _way_out(self, hand: int, bearing: float, distance: float, height: float) -> float:
        """Return about how far a target is from the fist in the guard [m]."""
        x, y, z = (self.style.lead_fist, self.style.rear_fist)[hand]
        target = np.array([distance * np.sin(bearing), height, distance * np.cos(bearing)])
        return float(np.linalg.norm(target - [x, self.style.height + 0.31 + y, z + 0.09]))

    def _aim(self, aim: Aim, onset: float, hit: float, end: float) -> None:
        """Bring the body to where the target is."""
        out, back = hit - onset, end - hit
        for channel, size in aim.trunk():
            if abs(size) > 1e-3:
                early = self.rng.uniform(0.6, 1.1)
                self.accent(
                    channel,
                    self.about(size, 0.1),
                    onset - early * out,
                    hit - 0.08 * out,
                    hit + 0.1 * back,
                    end + 0.3 * back,
                )

    def defend(self, kind: str, start: float, depth: float | None = None, tempo: float = 1.0) -> float:
        """Defend from ``start`` [s]; return when the guard stands again [s]."""
        recipe = DEFENCES[kind]
        depth = self.about(1.0, 0.16) if depth is None else depth
        side = float(self.rng.choice([-1.0, 1.0])) if kind == "weave" else 1.0
        rise, hold, back = (self.about(seconds, 0.14) / tempo for seconds in recipe.seconds)
        height = start + rise
        fall = height + hold
        end = fall + back
        for part in recipe.parts:
            size = self.about(part.size, 0.1) * depth * (side if part.channel in _BACKWARD else 1.0)
            self._play(part, size, start, height, fall, end, 0.03)
        self._defences.append(Defence(kind, start, end))
        return end

    def _play(
        self, part: Part, size: float, start: float, height: float, fall: float, end: float, jitter: float
    ) -> None:
        """Turn a part's phases into times and add it."""

        def at(phase: float, later: bool) -> float:
            phase += jitter * self.normal(2.0)
            if phase < 1.0:
                return start + phase * (height - start)
            return (fall if later else height) + (phase - 1.0) * (end - fall)

        times = at(part.start, False), at(part.peak, False), at(part.fall, True), at(part.end, True)
        self.accent(part.channel, size, *times)

    def finish(
        self,
        seconds: float,
        falls: tuple[Fall, ...] = (),
        staggers: tuple[Stagger, ...] = (),
        rests: tuple[Rest, ...] = (),
    ) -> Score:
        """Return the score of a clip of this length [s]."""
        return Score(
            seconds=seconds,
            style=self.style,
            start=self.start,
            footsteps=tuple(self._footsteps),
            pivots=tuple(self._pivots),
            turns=tuple(self._turns),
            accents=tuple(self._accents),
            reaches=tuple(self._reaches),
            defences=tuple(self._defences),
            travels=tuple(self._travels),
            falls=falls,
            staggers=staggers,
            rests=rests,
        )
