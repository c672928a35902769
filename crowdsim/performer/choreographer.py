"""The choreographer writes a score move by move; each is drawn at random, so that no two are the same."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.motion import ground
from crowdsim.performer.footwork import stance_prints
from crowdsim.performer.moves import COMBINATIONS, DEFENCES, PRESSING, PUNCHES, Punch
from crowdsim.performer.score import (
    BENDS,
    GUARD_SWING,
    LEAD,
    REAR,
    SHUFFLE_SWING,
    Accent,
    Channel,
    Footstep,
    Pivot,
    Reach,
    Score,
    Span,
    Swing,
    Turn,
    draw_style,
)
from crowdsim.performer.sticks import Grip

_ELBOWS = frozenset({Channel.LEAD_ELBOW, Channel.REAR_ELBOW})
_ARMS = frozenset(channel for channel in Channel if channel >= Channel.LEAD_FORTH)
"""Channels of shoulders, elbows and fists, which are quicker than all that carries them."""
_MIRRORED = frozenset({Channel.BEND, Channel.SHIFT_X, Channel.TWIST})
"""Channels that change sides where a weave begins to the right."""
_WOUND = {Channel.PELVIS_TURN: 0.2, Channel.TWIST: 0.2, Channel.LEAD_ARC: 0.8, Channel.REAR_ARC: 0.8}
"""What is left of winding up when the punch before has turned the body already."""
_LOADS = frozenset({Channel.LEAD_HAND_Y, Channel.REAR_HAND_Y, Channel.LEAD_SWING_Y, Channel.REAR_SWING_Y})
"""Channels by which an uppercut dips before it rises, the less the lower it is aimed."""
_DRAWS = (((Channel.LEAD_HAND_X, -0.06), (Channel.LEAD_HAND_Z, -0.20)), ((Channel.REAR_HAND_Z, -0.14),))
"""How each fist is drawn in before it strikes at close quarters [m]."""
_LOW = 1.34
"""Height of a target under which trunk and knees go down to it [m]."""
_ARMS_LENGTH = 0.90
"""Distance of a target from the pelvis from which on the trunk has to lean out to it [m]."""
_GATHER, _SETTLE = 0.17, 0.37
"""Least time in which legs and trunk go into a punch, and about the least in which they come out of it [s]."""
_JITTER = 0.03
"""How far the phases of punches and defences are off at one standard deviation."""

Times = tuple[float, float, float, float]


class Choreographer:
    """Writes a score by moves at given times [s], which may overlap.

    Attributes:
        rng: Where every number is drawn from.
        style: How the boxer stands.
        punches: What it strikes, by name; of one with a stick, blows of that.
        combinations: What it strikes one after another: digits are places in ``punches``, from 1 on.
        pressing: Likewise, on the way.
        score: What is written so far.
        ground_frame: Ground transform of the stance after the steps planned so far.
        prints: Position of the ball of each foot then, and its heading (x, z, yaw), lead and rear. Shape (2, 3).
        feet_free: When both feet stand again [s].
        hands_free: When each hand is back in the guard [s].
    """

    def __init__(self, rng: np.random.Generator, facing: float | None = None, grip: Grip | None = None) -> None:
        self.rng = rng
        self.style, held = draw_style(rng), list[Accent]()
        if grip is not None:
            self.style, held = grip.hold(self.style)
        self.punches = PUNCHES if grip is None else grip.blows
        self.combinations = COMBINATIONS if grip is None else grip.combinations
        self.pressing = PRESSING if grip is None else grip.pressing
        heading = rng.uniform(-np.pi, np.pi) if facing is None else facing
        self.ground_frame = np.array([0.0, 0.0, heading])
        self.score = Score(self.style, (0.0, 0.0, float(heading)), two_hands=grip is not None and grip.two_hands)
        self.score.accents += held
        self.prints = stance_prints(self.style, self.ground_frame)
        self.feet_free = 0.0
        self.hands_free = [0.0, 0.0]

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
        self.score.accents.append(Accent(channel, size, (start, peak, fall, max(end, fall + 0.11))))

    def play(
        self, parts: Iterable[Accent], times: Times, scale: float = 1.0, spread: float = 0.0, unit: float = 1.0
    ) -> None:
        """Play parts around four times [s], from which they are off in units of ``unit`` seconds.

        All sizes are multiplied by ``scale``, and drawn about that by ``spread``.
        """
        for part in parts:
            size = part.size * scale
            size = self.about(size, spread) if spread else size
            start, peak, fall, end = (time + unit * off for time, off in zip(times, part.at, strict=True))
            self.accent(part.channel, size, start, peak, fall, end)

    def _play_phases(self, part: Accent, size: float, start: float, height: float, fall: float, end: float) -> None:
        """Play a part of a punch or defence, its phases turned into times."""

        def at(phase: float, later: bool) -> float:
            phase += _JITTER * self.normal(2.0)
            if phase < 1.0:
                return start + phase * (height - start)
            return (fall if later else height) + (phase - 1.0) * (end - fall)

        self.accent(part.channel, size, *(at(phase, index > 1) for index, phase in enumerate(part.at)))

    def move(
        self, start: float, ahead: float, left: float, turn: float = 0.0, tempo: float = 1.0, quick: bool = False
    ) -> float:
        """Step with both feet to a new stance; return when the second foot is down [s].

        The foot on the side of the direction moves first, so that feet never cross. In a quick step, the other one is
        off the floor before it is down.
        """
        start = max(start, self.feet_free)
        along = np.subtract(*self.style.balls)
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
        middle, later = start + 0.4 * (end - start), start + 0.5 * (end - start)
        self.accent(Channel.HEIGHT, -dip, start - 0.15, middle, later, end + 0.2)
        if quick and ahead < -0.1:
            # A foot that goes back lands on its toes.
            self.accent(Channel.REAR_HEEL, -0.8 * ahead, start - 0.05, end - 0.12, end - 0.05, end + 0.15)
        self.feet_free = end + 0.02
        return end

    def pivot(self, start: float, turn: float, tempo: float = 1.0) -> float:
        """Turn on the ball of the lead foot while the rear foot steps round; return when it is down [s]."""
        start = max(start, self.feet_free)
        x, z = self.style.balls[LEAD]
        point = ground.to_world(self.ground_frame, np.array([x, 0.0, z]))
        back = ground.compose([0.0, 0.0, self.ground_frame[2] + turn], [-x, -z, 0.0])
        self.ground_frame = np.array([point[0] + back[0], point[2] + back[1], self.ground_frame[2] + turn])
        seconds = self._swing(REAR, start, 0.55 * abs(turn), 0.85 * tempo)
        end = start + seconds
        self.twist_foot(LEAD, start - 0.04, end + 0.04, turn)
        self.score.turns.append(Turn(start - 0.06, end + 0.06, turn))
        self._turn_head(turn, start, end)
        middle, later = start + 0.4 * seconds, start + 0.5 * seconds
        self.accent(Channel.LEAD_HEEL, self.about(0.16, 0.2), start - 0.1, middle, later, end + 0.1)
        self.feet_free = end + 0.02
        return end

    def _turn_head(self, turn: float, start: float, end: float) -> None:
        """Let the head turn first."""
        self.accent(Channel.HEAD_TURN, 0.35 * turn, start - 0.16, start + 0.1, start + 0.12, end + 0.1)

    def _swing(self, foot: int, begin: float, length: float, tempo: float, quick: bool = False) -> float:
        """Plan the path of one foot to its position in the present stance; return how long it takes [s]."""
        least, more = (0.12, 0.14) if quick else (0.14, 0.25)
        seconds = float(np.clip(self.about(least + more * length, 0.08) / tempo, 0.12, 0.45))
        x, z = np.array(self.style.balls[foot]) + self.rng.uniform(-0.010, 0.010, 2)
        yaw = self.style.foot_yaws[foot] + self.rng.uniform(-0.04, 0.04)
        lift = self.about(0.024 + 0.06 * length, 0.2)
        landing = ground.compose(self.ground_frame, [x, z, yaw])
        self.plant(foot, begin, begin + seconds, landing, lift, SHUFFLE_SWING if quick else GUARD_SWING)
        return seconds

    def plant(self, foot: int, start: float, end: float, landing: ArrayLike, lift: float, swing: Swing) -> None:
        """Swing a foot from ``start`` to ``end`` [s] to a footprint (x, z, yaw)."""
        x, z, yaw = (float(value) for value in np.asarray(landing))
        self.prints[foot] = x, z, yaw
        self.score.footsteps.append(Footstep(foot, start, end, x, z, yaw, lift, swing))

    def twist_foot(self, foot: int, start: float, end: float, angle: float) -> None:
        """Turn a planted foot about its ball between ``start`` and ``end`` [s]."""
        self.prints[foot, 2] += angle
        self.score.pivots.append(Pivot(foot, start, end, angle))

    def face(self, start: float, end: float, turn: float) -> None:
        """Turn the stance between ``start`` and ``end`` [s]; the head goes first."""
        self.score.turns.append(Turn(start - 0.05, end + 0.05, turn))
        self._turn_head(turn, start, end)

    def draw_speed(self, kind: str) -> float:
        """Draw the highest speed of a punching fist relative to the pelvis, roughly [m/s]."""
        middle, spread = self.punches[kind].speed
        return middle + spread * self.normal(1.6, 2.4)

    def punch(
        self,
        kind: str,
        onset: float,
        to_body: bool,
        bearing: float,
        distance: float,
        speed: float,
        height: float | None = None,
    ) -> Reach:
        """Throw a punch whose fist sets off at ``onset`` [s], later where the hand is not back yet.

        Args:
            kind: A key of ``punches``.
            onset: When the fist sets off [s].
            to_body: To the body, not to the head.
            bearing: Where the opponent is, in the stance frame [rad]; the punch's own spread comes on top.
            distance: Of the target, over the ground [m].
            speed: The fist's highest speed relative to the pelvis, roughly [m/s].
            height: Of the target [m]; drawn when None.
        """
        rng, recipe = self.rng, self.punches[kind]
        hand = recipe.hand
        onset = max(onset, self.hands_free[hand])
        if height is None:
            height = float(rng.uniform(*(recipe.body if to_body else recipe.head)))
        bearing += recipe.bearing[0] + recipe.bearing[1] * self.normal(2.0)
        x, y, z = self.style.fists[hand]
        target = np.array([distance * np.sin(bearing), height, distance * np.cos(bearing)])
        way = float(np.linalg.norm(target - [x, self.style.height + 0.31 + y, z + 0.09]))
        out = max(1.27 * (way + recipe.extra) / speed, 0.14)
        hit = onset + out
        fall = hit + rng.uniform(0.0, 0.025)
        end = fall + out * rng.uniform(0.95, 1.2)
        path = self._move_body(recipe, onset, hit, end, bearing, distance, height)
        start = onset - recipe.early * out
        reach = Reach(kind, hand, start, hit, fall, end, bearing, distance, height, recipe.skew, path)
        self.score.reaches.append(reach)
        self.hands_free[hand] = end - 0.12 * (end - hit)
        return reach

    def _move_body(
        self, recipe: Punch, onset: float, hit: float, end: float, bearing: float, distance: float, height: float
    ) -> tuple[Accent, ...]:
        """Add what the body does in a punch, and return the accents that bend the path of its fist."""
        vigour = self.about(1.0, 0.08)
        gather, settle = min(onset, hit - _GATHER), max(end, hit + self.about(_SETTLE, 0.15))
        wound = any(other.hand != recipe.hand and other.hit > onset - 0.35 for other in self.score.reaches[-2:])
        low = max(_LOW - height, 0.0)
        accents = self.score.accents
        before = len(accents)
        for part in recipe.parts:
            size = self.about(part.size, 0.12) * vigour * _share(part, wound, low)
            arm = part.channel in _ARMS and part.channel not in _ELBOWS
            back = settle if part.channel not in _ARMS else end
            self._play_phases(part, size, onset if arm else gather, hit, hit, back)
        out, back = hit - gather, settle - hit
        for channel, size in _bring_trunk(recipe, bearing, distance, low):
            if abs(size) > 1e-3:
                early = self.rng.uniform(0.6, 1.1)
                size, start = self.about(size, 0.1), gather - early * out
                self.accent(channel, size, start, hit - 0.08 * out, hit + 0.1 * back, settle + 0.3 * back)
        least, _ = recipe.distance
        if recipe.inside < least:
            # The fist is drawn in before it moves out to a near target.
            drawn = float(np.clip((least + 0.12 - distance) / 0.30, 0.0, 1.0))
            for channel, size in _DRAWS[recipe.hand]:
                self.accent(channel, size * drawn, onset - 0.2, onset - 0.02, onset + 0.02, hit)
        path = tuple(accent for accent in accents[before:] if accent.channel in BENDS[recipe.hand])
        accents[before:] = [accent for accent in accents[before:] if accent not in path]
        return path

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
            size = self.about(part.size, 0.1) * depth * (side if part.channel in _MIRRORED else 1.0)
            self._play_phases(part, size, start, height, fall, end)
        self.score.defences.append(Span(kind, start, end))
        return end

    def finish(self, seconds: float) -> Score:
        """Return the score of a clip of this length [s]."""
        self.score.seconds = seconds
        return self.score


def _share(part: Accent, wound: bool, low: float) -> float:
    """Return how much of a part of a punch is played.

    ``wound``: the punch before turned the body already. The target lies ``low`` [m] under where a guard looks.
    """
    size = 1.0
    if wound and part.at[0] < 0.0 and part.at[3] < 1.2:
        size *= _WOUND.get(part.channel, 1.0)
    if part.channel in _ELBOWS and part.size > 1.0:
        size *= 1.0 - low
    if part.channel in _LOADS and part.size < 0.0:
        size *= 1.0 - 1.8 * low
    return size


def _bring_trunk(recipe: Punch, bearing: float, distance: float, low: float) -> tuple[tuple[Channel, float], ...]:
    """Return what brings trunk and knees to a target: turned to it, down to a low one, out to a far one.

    At close quarters the hips come forward, and the trunk leans back to make room for the fist.
    """
    least, most = recipe.distance
    far = float(np.clip(2.0 * (distance - least) / (most - least) - 1.0, -1.0, 1.0))
    near = float(np.clip((least - distance) / 0.25, 0.0, 1.0))
    lunge = float(np.clip((distance - _ARMS_LENGTH) / 0.17, 0.0, 1.0))
    turn = 1.0 if recipe.hand == REAR else -1.0
    return (
        (Channel.PELVIS_TURN, 0.35 * bearing),
        (Channel.TWIST, 0.35 * bearing + 0.06 * turn * far),
        (Channel.HEAD_TURN, 0.5 * bearing),
        (Channel.PELVIS_TILT, 0.08 * lunge - 0.12 * near),
        (Channel.HEIGHT, -0.42 * low - 0.05 * lunge),
        (Channel.FLEX, (0.60 - 0.3 * near) * low + 0.05 * far + 0.32 * lunge - 0.26 * near),
        (Channel.BEND, -0.22 * low * turn),
        (Channel.SHIFT_Z, 0.02 * far + 0.03 * near),
        (Channel.HEAD_NOD, 0.25 * low),
        (Channel.REAR_HEEL, 0.5 * low),
    )
