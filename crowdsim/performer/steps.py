"""Steps of the embedded boxer in his guard, each drawn at random: both feet to a new stance, or one about the other."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.motion import ground
from crowdsim.performer.footwork import stance_prints
from crowdsim.performer.gait import GUARD_SWING, SHUFFLE_SWING
from crowdsim.performer.score import LEAD, REAR, Accent, Channel, Footstep, Pivot, Swing, Travel, Turn
from crowdsim.performer.style import draw_style


class Stepper:
    """Writes steps at given times [s], which may overlap other moves.

    Attributes:
        rng: Where every number is drawn from.
        style: How the boxer stands.
        ground_frame: Ground transform of the stance after the steps planned so far.
        prints: Position of the ball of each foot then, and its heading (x, z, yaw), lead and rear. Shape (2, 3).
        feet_free: When both feet stand again [s].
    """

    def __init__(self, rng: np.random.Generator, facing: float | None = None) -> None:
        self.rng = rng
        self.style = draw_style(rng)
        heading = rng.uniform(-np.pi, np.pi) if facing is None else facing
        self.ground_frame = np.array([0.0, 0.0, heading])
        self.start = (0.0, 0.0, float(heading))
        self.prints = stance_prints(self.style, self.ground_frame)
        self.feet_free = 0.0
        self._footsteps: list[Footstep] = []
        self._pivots: list[Pivot] = []
        self._turns: list[Turn] = []
        self._accents: list[Accent] = []
        self._travels: list[Travel] = []

    def about(self, middle: float, spread: float = 0.12) -> float:
        """Draw a number near ``middle``: off by ``spread`` of it at one standard deviation, and by two at most."""
        return middle * (1.0 + spread * self.normal(2.0))

    def normal(self, least: float, most: float | None = None) -> float:
        """Draw from the normal distribution, cut off at ``-least`` and at ``most`` (``least`` when None)."""
        return min(max(float(self.rng.standard_normal()), -least), least if most is None else most)

    def accent(self, channel: Channel, size: float, start: float, peak: float, fall: float, end: float) -> None:
        """Add one accent, no faster than a body is."""
        peak = max(peak, start + 0.07)
        fall = max(fall, peak)
        self._accents.append(Accent(channel, size, start, peak, fall, max(end, fall + 0.11)))

    def move(
        self, start: float, ahead: float, left: float, turn: float = 0.0, tempo: float = 1.0, quick: bool = False
    ) -> float:
        """Step with both feet to a new stance; return when the second foot is down [s].

        The foot on the side of the direction moves first, so that feet never cross. In a quick step, the other one is
        off the floor before it is down.
        """
        start = max(start, self.feet_free)
        along = np.subtract(self.style.lead_ball, self.style.rear_ball)
        towards = left * along[0] + ahead * along[1]
        first = LEAD if (towards if abs(towards) > 0.01 else turn) >= 0.0 else REAR
        self.ground_frame = ground.compose(self.ground_frame, [left, ahead, turn])
        length = float(np.hypot(ahead, left)) + 0.22 * abs(turn)
        begin = end = start
        for foot in (first, 1 - first):
            if foot != first:
                begin = end - (0.42 * (end - begin) if quick else self.rng.uniform(0.0, 0.04))
            end = begin + self._swing(foot, begin, length, tempo, quick)
        if turn:
            self.face(start, end, turn)
        dip = self.about((0.014 if quick else 0.010) + (0.05 if quick else 0.03) * length, 0.2)
        self.accent(
            Channel.HEIGHT, -dip, start - 0.15, start + 0.4 * (end - start), start + 0.5 * (end - start), end + 0.2
        )
        if quick and ahead < -0.1:
            # A foot that goes back lands on its toes.
            self.accent(Channel.REAR_HEEL, -0.8 * ahead, start - 0.05, end - 0.12, end - 0.05, end + 0.15)
        self.feet_free = end + 0.02
        return end

    def pivot(self, start: float, turn: float, tempo: float = 1.0) -> float:
        """Turn on the ball of the lead foot while the rear foot steps round; return when it is down [s]."""
        start = max(start, self.feet_free)
        point = ground.to_world(self.ground_frame, np.array([self.style.lead_ball[0], 0.0, self.style.lead_ball[1]]))
        back = ground.compose(
            [0.0, 0.0, self.ground_frame[2] + turn], [-self.style.lead_ball[0], -self.style.lead_ball[1], 0.0]
        )
        self.ground_frame = np.array([point[0] + back[0], point[2] + back[1], self.ground_frame[2] + turn])
        seconds = self._swing(REAR, start, 0.55 * abs(turn), 0.85 * tempo)
        end = start + seconds
        self.twist_foot(LEAD, start - 0.04, end + 0.04, turn)
        self._turns.append(Turn(start - 0.06, end + 0.06, turn))
        self._look(turn, start, end)
        self.accent(
            Channel.LEAD_HEEL,
            self.about(0.16, 0.2),
            start - 0.1,
            start + 0.4 * seconds,
            start + 0.5 * seconds,
            end + 0.1,
        )
        self.feet_free = end + 0.02
        return end

    def _look(self, turn: float, start: float, end: float) -> None:
        """Let the head turn first."""
        self.accent(Channel.HEAD_TURN, 0.35 * turn, start - 0.16, start + 0.1, start + 0.12, end + 0.1)

    def _swing(self, foot: int, begin: float, length: float, tempo: float, quick: bool = False) -> float:
        """Plan the path of one foot to its position in the present stance; return how long it takes [s]."""
        least, more = (0.12, 0.14) if quick else (0.14, 0.25)
        seconds = float(np.clip(self.about(least + more * length, 0.08) / tempo, 0.12, 0.45))
        ball = (self.style.lead_ball, self.style.rear_ball)[foot]
        x, z = np.array(ball) + self.rng.uniform(-0.010, 0.010, 2)
        yaw = self.style.foot_yaws[foot] + self.rng.uniform(-0.04, 0.04)
        lift = self.about(0.024 + 0.06 * length, 0.2)
        landing = ground.compose(self.ground_frame, [x, z, yaw])
        self.plant(foot, begin, begin + seconds, landing, lift, SHUFFLE_SWING if quick else GUARD_SWING)
        return seconds

    def plant(self, foot: int, start: float, end: float, landing: ArrayLike, lift: float, swing: Swing) -> None:
        """Swing a foot from ``start`` to ``end`` [s] to a footprint (x, z, yaw)."""
        x, z, yaw = (float(value) for value in np.asarray(landing))
        self.prints[foot] = x, z, yaw
        self._footsteps.append(Footstep(foot, start, end, x, z, yaw, lift, swing))

    def twist_foot(self, foot: int, start: float, end: float, angle: float) -> None:
        """Turn a planted foot about its ball between ``start`` and ``end`` [s]."""
        self.prints[foot, 2] += angle
        self._pivots.append(Pivot(foot, start, end, angle))

    def face(self, start: float, end: float, turn: float) -> None:
        """Turn the stance between ``start`` and ``end`` [s]; the head goes first."""
        self._turns.append(Turn(start - 0.05, end + 0.05, turn))
        self._look(turn, start, end)

    def travelled(self, gait: str, start: float, end: float) -> None:
        """Note travel in one gait between ``start`` and ``end`` [s]."""
        self._travels.append(Travel(gait, start, end))
