"""What a boxer does in a clip: phrases of steps, combinations and defences, by the theme of the clip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crowdsim.motion.performer_defences import DEFENCES
from crowdsim.motion.performer_plan import Choreographer
from crowdsim.motion.performer_punches import PUNCHES
from crowdsim.motion.performer_score import Score

COMBINATIONS = (
    ("jab",),
    ("straight",),
    ("lead_hook",),
    ("rear_hook",),
    ("lead_uppercut",),
    ("rear_uppercut",),
    ("jab", "jab"),
    ("jab", "straight"),
    ("jab", "straight"),
    ("straight", "lead_hook"),
    ("lead_hook", "straight"),
    ("jab", "rear_uppercut"),
    ("jab", "rear_hook"),
    ("lead_uppercut", "rear_hook"),
    ("rear_uppercut", "lead_hook"),
    ("lead_hook", "rear_uppercut"),
    ("jab", "jab", "straight"),
    ("jab", "straight", "lead_hook"),
    ("jab", "straight", "lead_uppercut"),
    ("straight", "lead_hook", "straight"),
    ("lead_hook", "rear_hook", "lead_hook"),
    ("lead_uppercut", "rear_uppercut", "lead_hook"),
    ("rear_hook", "lead_hook"),
    ("rear_uppercut", "lead_uppercut", "rear_hook"),
    ("jab", "rear_hook", "lead_uppercut"),
    ("jab", "straight", "lead_hook", "straight"),
    ("jab", "straight", "lead_uppercut", "rear_hook"),
    ("lead_hook", "rear_uppercut", "lead_hook", "straight"),
    ("jab", "straight", "jab", "straight", "lead_hook"),
)
_CLOSE = frozenset({"lead_hook", "rear_hook", "lead_uppercut", "rear_uppercut"})
_ROOM = 1.8
"""Distance from the middle of the floor from which the boxer works his way back [m]."""


@dataclass(frozen=True)
class Theme:
    """What a clip is about: weights of its phrases, and the longest pauses between them [s]."""

    combination: float
    stepping: float
    turning: float
    defence: float
    counter: float
    rest: float
    pause: float


THEMES = (
    Theme(combination=6.0, stepping=1.1, turning=0.45, defence=0.6, counter=1.4, rest=0.12, pause=0.24),
    Theme(combination=7.0, stepping=0.6, turning=0.30, defence=0.3, counter=1.0, rest=0.10, pause=0.26),
    Theme(combination=5.0, stepping=1.6, turning=0.90, defence=0.4, counter=1.2, rest=0.15, pause=0.26),
    Theme(combination=5.0, stepping=0.6, turning=0.30, defence=0.9, counter=2.8, rest=0.12, pause=0.24),
)


class _Boxer:
    """Fills a clip phrase by phrase; ``now`` is when the next phrase may begin [s]."""

    def __init__(self, seconds: float, theme: Theme, rng: np.random.Generator) -> None:
        self.seconds, self.theme, self.rng = seconds, theme, rng
        self.plan = Choreographer(rng)
        self.now = rng.uniform(0.35, 0.7)

    def way(self) -> tuple[float, float]:
        """Draw a step (ahead, left) [m]: any direction, but back to the middle of the floor when far from it."""
        rng = self.rng
        x, z, heading = self.plan.place
        away = float(np.hypot(x, z))
        angle = rng.uniform(-np.pi, np.pi)
        if away > _ROOM or (away > 0.6 * _ROOM and rng.uniform() < 0.5):
            angle = np.arctan2(-x, -z) - heading + rng.normal(0.0, 0.35)
        far = float(rng.uniform(0.07, 0.25))
        return far * float(np.cos(angle)), far * float(np.sin(angle)) * 0.85

    def combination(self, begin: float, kinds: tuple[str, ...], bearing: float = 0.0) -> float:
        """Throw a combination, with or without steps; return when the last fist is back [s]."""
        rng, plan = self.rng, self.plan
        stepping = rng.uniform()
        close = sum(kind in _CLOSE for kind in kinds)
        if abs(bearing) > 0.3:
            plan.move(begin - 0.12, rng.uniform(0.0, 0.15), 0.08 * np.sign(bearing), bearing, plan.about(1.25))
            bearing = 0.0
        elif stepping < 0.40:
            plan.move(
                begin - rng.uniform(0.0, 0.1), rng.uniform(0.06, 0.28), rng.uniform(-0.08, 0.08), 0.0, plan.about(1.2)
            )
        elif stepping < 0.46:
            plan.move(begin - 0.05, -rng.uniform(0.1, 0.24), rng.uniform(-0.08, 0.08), 0.0, plan.about(1.2))
        elif stepping < 0.55:
            plan.move(
                begin - 0.05,
                rng.uniform(-0.05, 0.15),
                rng.choice([-1.0, 1.0]) * rng.uniform(0.08, 0.2),
                0.0,
                plan.about(1.2),
            )
        inside = close == len(kinds) and rng.uniform() < 0.5
        tempo = rng.uniform(0.85, 1.12)
        onset = begin + rng.uniform(0.0, 0.06)
        previous = None
        for kind in kinds:
            recipe = PUNCHES[kind]
            to_body = bool(rng.uniform() < 0.22)
            least, most = recipe.distance
            if inside:
                distance = float(rng.uniform(recipe.inside, least))
            else:
                distance = float(rng.uniform(least, most if close < len(kinds) else 0.9 * most + 0.1 * least))
            speed = tempo * (recipe.speed[0] + recipe.speed[1] * plan.normal(1.6, 2.4))
            if previous is not None:
                load = 0.10 if kind in _CLOSE else 0.02
                onset = previous.hit + load + abs(float(rng.normal(0.0, 0.05)))
            previous = plan.punch(kind, onset, to_body, bearing, distance, speed)
        assert previous is not None
        leaving = rng.uniform()
        if leaving < 0.22:
            plan.move(previous.hit + 0.08, -rng.uniform(0.08, 0.22), rng.uniform(-0.15, 0.15), 0.0, plan.about(1.15))
        elif leaving < 0.34:
            plan.pivot(previous.hit + 0.1, float(rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 0.9)), plan.about(1.1))
        return previous.end

    def turn(self) -> float:
        """Turn by up to half a circle, in as many steps and pivots as that takes; return when it is done [s]."""
        rng, plan = self.rng, self.plan
        left = float(rng.choice([-1.0, 1.0])) * float(rng.triangular(0.3, 0.5, np.pi))
        end = self.now
        while abs(left) > 0.05:
            part = float(np.sign(left)) * min(abs(left), float(rng.uniform(0.5, 0.95)))
            if abs(left - part) < 0.2:
                part = float(np.clip(left, -1.0, 1.0))
            if rng.uniform() < 0.6:
                end = plan.pivot(end, part, plan.about(1.15))
            else:
                ahead, side = rng.uniform(-0.1, 0.12), rng.uniform(-0.1, 0.1)
                end = plan.move(end, ahead, side, part, plan.about(1.15))
            left -= part
        return end

    def steps(self) -> float:
        """Take one to three steps, in the pace of the moment; return when the last is done [s]."""
        rng, plan = self.rng, self.plan
        tempo = float(rng.uniform(0.8, 1.3))
        end = self.now
        if rng.uniform() < 0.3:
            far = float(rng.uniform(0.1, 0.26))
            end = plan.move(end, far, rng.uniform(-0.06, 0.06), 0.0, 1.1 * tempo)
            return plan.move(
                end + rng.uniform(0.0, 0.25), -far * rng.uniform(0.8, 1.1), rng.uniform(-0.1, 0.1), 0.0, 1.15 * tempo
            )
        ahead, left = self.way()
        for _ in range(int(rng.integers(1, 4))):
            end = plan.move(
                end + rng.uniform(0.0, 0.12), plan.about(ahead), plan.about(left), float(rng.normal(0.0, 0.12)), tempo
            )
        return end

    def defence(self, counter: bool) -> float:
        """Defend once or twice, and perhaps hit back; return when that is over [s]."""
        rng, plan = self.rng, self.plan
        kinds = list(DEFENCES)
        end = self.now
        for _ in range(1 + int(rng.uniform() < 0.3)):
            kind = kinds[int(rng.integers(len(kinds)))]
            if kind == "lean_back" and rng.uniform() < 0.5:
                plan.move(end - 0.05, -rng.uniform(0.08, 0.2), 0.0, 0.0, plan.about(1.2))
            begin = end - (0.1 if end > self.now else 0.0)
            end = plan.defend(kind, begin, tempo=rng.uniform(0.85, 1.2))
        if counter:
            kinds_back = COMBINATIONS[int(rng.integers(len(COMBINATIONS)))]
            end = self.combination(end - rng.uniform(0.04, 0.2), kinds_back)
        return end

    def phrase(self) -> None:
        """Draw the next phrase and write it."""
        rng, theme = self.rng, self.theme
        weights = np.array([theme.combination, theme.stepping, theme.turning, theme.defence, theme.counter, theme.rest])
        choice = int(np.searchsorted(np.cumsum(weights) / weights.sum(), rng.uniform()))
        if choice == 0:
            kinds = COMBINATIONS[int(rng.integers(len(COMBINATIONS)))]
            bearing = float(rng.uniform(-1.1, 1.3)) if rng.uniform() < 0.16 else 0.0
            end = self.combination(self.now, kinds, bearing)
        elif choice == 1:
            end = self.steps()
        elif choice == 2:
            end = self.turn()
        elif choice in (3, 4):
            end = self.defence(counter=choice == 4)
        else:
            end = self.now + rng.uniform(0.5, 1.6)
        self.now = max(end, self.plan.feet_free - 0.15) + float(rng.uniform(0.0, theme.pause))

    def fill(self) -> Score:
        """Write phrases until the clip is full, with the guard at both ends."""
        while True:
            before = self.now
            if before > self.seconds - 2.9:
                return self.plan.finish(self.seconds)
            self.phrase()


def write_score(seconds: float, theme: Theme, rng: np.random.Generator) -> Score:
    """Plan a clip of a given length [s] on a theme."""
    return _Boxer(seconds, theme, rng).fill()


def write_solo(move: str, rng: np.random.Generator) -> Score:
    """Plan a short clip of one move alone, facing heading 0: a punch, a defence, or a word of ``FOOTWORK``."""
    plan = Choreographer(rng, facing=0.0)
    start = 0.5
    if move in PUNCHES:
        recipe = PUNCHES[move]
        end = plan.punch(move, start, distance=0.5 * sum(recipe.distance), speed=recipe.speed[0], height=1.45).end
    elif move in DEFENCES:
        end = plan.defend(move, start, depth=1.0)
    elif move == "turn":
        end = start
        for _ in range(4):
            end = plan.pivot(end, np.pi / 4)
    else:
        ahead, left = FOOTWORK[move]
        end = plan.move(start, ahead, left)
    return plan.finish(end + 0.5)


FOOTWORK = {
    "forward": (0.3, 0.0),
    "back": (-0.3, 0.0),
    "left": (0.0, 0.28),
    "right": (0.0, -0.28),
    "diagonal": (0.2, 0.2),
    "turn": (0.0, 0.0),
}
