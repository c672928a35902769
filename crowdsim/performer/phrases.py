"""What a boxer does in a clip: phrases of steps, combinations and defences, by the theme of the clip."""

from __future__ import annotations

from collections import namedtuple
from collections.abc import Sequence

import numpy as np

from crowdsim.motion import ground
from crowdsim.performer.choreographer import Choreographer
from crowdsim.performer.free_footwork import ROOM, bounce, in_and_out, run_up, shuffle_any_way
from crowdsim.performer.moves import DEFENCES
from crowdsim.performer.score import Score, Travel

Theme = namedtuple("Theme", "strike steps turn defend counter stand travel shuffle press bounce pause")
"""What a clip is about: weights of phrases, methods of ``_Boxer``, and the longest pause between two of them [s]."""
THEMES = (
    Theme(6.5, 0.3, 0.20, 0.9, 2.0, 0.10, 0.65, 0.6, 0.9, 0.35, pause=0.18),
    Theme(8.0, 0.2, 0.15, 0.5, 1.6, 0.08, 0.65, 0.6, 0.9, 0.40, pause=0.18),
    Theme(5.5, 0.4, 0.30, 0.7, 1.6, 0.10, 0.65, 1.2, 0.7, 0.50, pause=0.18),
    Theme(5.5, 0.2, 0.15, 1.1, 3.4, 0.10, 0.65, 0.6, 0.7, 0.35, pause=0.18),
    Theme(3.0, 0.2, 0.10, 0.4, 0.8, 0.05, 3.00, 1.0, 1.2, 0.30, pause=0.16),
)
_EXCHANGE = Theme(6.0, 1.2, 0.3, 1.0, 1.5, 0.0, 0.0, 1.6, 0.0, 0.0, pause=0.12)
"""What a boxer does in an exchange of blows."""
_CLOSE = frozenset({"lead_hook", "rear_hook", "lead_uppercut", "rear_uppercut"})


class _Boxer:
    """Fills a clip phrase by phrase; ``now`` is when the next phrase may begin [s]."""

    def __init__(self, plan: Choreographer, seconds: float, theme: Theme, now: float) -> None:
        self.plan, self.seconds, self.theme, self.now = plan, seconds, theme, now
        self.rng = plan.rng

    def direction(self) -> tuple[float, float]:
        """Draw a step (ahead, left) [m]: any direction, but back to the middle of the floor when far from it."""
        rng = self.rng
        x, z, heading = self.plan.ground_frame
        away = float(np.hypot(x, z))
        angle = rng.uniform(-np.pi, np.pi)
        if away > 0.8 * ROOM or (away > 0.6 * 0.8 * ROOM and rng.uniform() < 0.5):
            angle = np.arctan2(-x, -z) - heading + rng.normal(0.0, 0.35)
        far = float(rng.uniform(0.07, 0.25))
        return far * float(np.cos(angle)), far * float(np.sin(angle)) * 0.85

    def draw(self, combinations: Sequence[str]) -> list[str]:
        """Draw a combination; return its kinds of punches."""
        kinds = list(self.plan.punches)
        return [kinds[int(number) - 1] for number in combinations[int(self.rng.integers(len(combinations)))]]

    def combination(self, begin: float, kinds: list[str], bearing: float = 0.0) -> float:
        """Throw a combination, with or without steps; return when the last fist is back [s]."""
        rng, plan = self.rng, self.plan
        stepping = rng.uniform()
        close = sum(kind in _CLOSE for kind in kinds)
        if abs(bearing) > 0.3:
            plan.move(begin - 0.12, rng.uniform(0.0, 0.15), 0.08 * np.sign(bearing), bearing, plan.about(1.25))
            bearing = 0.0
        elif stepping < 0.40:
            early, ahead, left = rng.uniform(0.0, 0.1), rng.uniform(0.06, 0.28), rng.uniform(-0.08, 0.08)
            plan.move(begin - early, ahead, left, 0.0, plan.about(1.2))
        elif stepping < 0.46:
            plan.move(begin - 0.05, -rng.uniform(0.1, 0.24), rng.uniform(-0.08, 0.08), 0.0, plan.about(1.2))
        elif stepping < 0.55:
            ahead, left = rng.uniform(-0.05, 0.15), rng.choice([-1.0, 1.0]) * rng.uniform(0.08, 0.2)
            plan.move(begin - 0.05, ahead, left, 0.0, plan.about(1.2))
        inside = close == len(kinds) and rng.uniform() < 0.62
        tempo = rng.uniform(0.85, 1.12)
        onset = begin + rng.uniform(0.0, 0.06)
        previous = None
        for kind in kinds:
            recipe = self.plan.punches[kind]
            to_body = bool(rng.uniform() < 0.22)
            least, most = recipe.distance
            furthest = most if close < len(kinds) else 0.9 * most + 0.1 * least
            distance = float(rng.uniform(recipe.inside, least) if inside else rng.uniform(least, furthest))
            speed = tempo * plan.draw_speed(kind)
            if previous is not None:
                load = 0.10 if kind in _CLOSE else 0.02
                onset = previous.hit + load + abs(float(rng.normal(0.0, 0.05)))
            previous = plan.punch(kind, onset, to_body, bearing, distance, speed)
        assert previous is not None
        leaving = rng.uniform()
        spare = self.seconds - previous.end - 1.0
        if leaving < self.theme.travel * 0.08 and spare > 2.2:
            return run_up(plan, previous.hit + rng.uniform(0.08, 0.2), spare, sharp=0.6)
        leaving = rng.uniform()
        if leaving < 0.06:
            return in_and_out(plan, previous.hit + 0.08, ahead=False)
        if leaving < 0.22:
            plan.move(previous.hit + 0.08, -rng.uniform(0.08, 0.22), rng.uniform(-0.15, 0.15), 0.0, plan.about(1.15))
        elif leaving < 0.34:
            plan.pivot(previous.hit + 0.1, float(rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 0.9)), plan.about(1.1))
        return previous.end

    def strike(self) -> float:
        """Throw a combination, sometimes at an opponent who is not straight ahead; return when it is over [s]."""
        rng = self.rng
        kinds = self.draw(self.plan.combinations)
        bearing = float(rng.uniform(-1.1, 1.3)) if rng.uniform() < 0.16 else 0.0
        return self.combination(self.now, kinds, bearing)

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
            start, back = end + rng.uniform(0.0, 0.25), -far * rng.uniform(0.8, 1.1)
            return plan.move(start, back, rng.uniform(-0.1, 0.1), 0.0, 1.15 * tempo)
        ahead, left = self.direction()
        for _ in range(int(rng.integers(1, 4))):
            start, forth, aside = end + rng.uniform(0.0, 0.12), plan.about(ahead), plan.about(left)
            end = plan.move(start, forth, aside, float(rng.normal(0.0, 0.12)), tempo)
        return end

    def defend(self) -> float:
        """Defend once or twice; return when that is over [s]."""
        rng, plan = self.rng, self.plan
        kinds = list(DEFENCES)
        end = self.now
        for _ in range(1 + int(rng.uniform() < 0.3)):
            kind = kinds[int(rng.integers(len(kinds)))]
            if kind == "lean_back" and rng.uniform() < 0.5:
                plan.move(end - 0.05, -rng.uniform(0.08, 0.2), 0.0, 0.0, plan.about(1.2))
            begin = end - (0.1 if end > self.now else 0.0)
            end = plan.defend(kind, begin, tempo=rng.uniform(0.85, 1.2))
        return end

    def counter(self) -> float:
        """Defend once or twice, and hit back; return when that is over [s]."""
        end = self.defend()
        kinds = self.draw(self.plan.combinations)
        return self.combination(end - self.rng.uniform(0.04, 0.2), kinds)

    def stand(self) -> float:
        """Stand still in the guard; return when that is over [s]."""
        return self.now + float(self.rng.uniform(0.5, 1.6))

    def shuffle(self) -> float:
        """Take quick steps in the guard, any way; return when the last is done [s]."""
        return shuffle_any_way(self.plan, self.now)

    def bounce(self) -> float:
        """Take quick steps on the spot; return when the last is done [s]."""
        return bounce(self.plan, self.now, min(self.seconds - self.now - 0.9, 3.2))

    def travel(self) -> float:
        """Walk, jog or shuffle up to an opponent, and perhaps strike on arrival; return when that is over [s]."""
        rng, plan = self.rng, self.plan
        spare = self.seconds - self.now - 1.0
        if spare < 2.2:
            return self.steps()
        end = run_up(plan, self.now, spare) if rng.uniform() < 0.85 else in_and_out(plan, self.now, ahead=True)
        if rng.uniform() < 0.5 and end < self.seconds - 2.9:
            kinds = self.draw(self.plan.combinations)
            return self.combination(end - rng.uniform(0.0, 0.25), kinds)
        return end

    def press(self) -> float:
        """Shuffle forward and punch meanwhile, as at a retreating opponent; return when that is over [s]."""
        rng, plan = self.rng, self.plan
        far = float(rng.uniform(0.30, 0.42))
        begin = feet = fists = max(self.now, plan.feet_free)
        last = int(rng.integers(2, 7))
        punching = int(rng.integers(0, 2))
        for step in range(last + 1):
            x, z, heading = plan.ground_frame
            home = float(ground.wrap(np.arctan2(-x, -z) - heading)) if np.hypot(x, z) > 0.6 * ROOM else 0.0
            turn = float(np.clip(home, -0.4, 0.4))
            start, side = feet, float(rng.uniform(-0.03, 0.03))
            feet = plan.move(start, plan.about(far, 0.05), side, turn, plan.about(1.0, 0.04), quick=True)
            if step == punching and step < last:
                kinds = self.draw(self.plan.pressing)
                fists = self._punch_far(start + rng.uniform(-0.06, 0.04), kinds)
                punching += int(rng.integers(2, 4))
        plan.score.travels.append(Travel("shuffle", begin, feet))
        return max(feet, fists)

    def _punch_far(self, onset: float, kinds: list[str]) -> float:
        """Throw punches near the end of their reach from ``onset`` on [s]; return when the last fist is back [s]."""
        end = onset
        for kind in kinds:
            recipe = self.plan.punches[kind]
            least, most = recipe.distance
            to_body = bool(self.rng.uniform() < 0.15)
            distance = float(self.rng.uniform(0.6 * least + 0.4 * most, most))
            reach = self.plan.punch(kind, onset, to_body, 0.0, distance, self.plan.draw_speed(kind))
            onset, end = reach.hit + 0.02 + abs(float(self.rng.normal(0.0, 0.05))), reach.end
        return end

    def phrase(self) -> None:
        """Draw the next phrase and write it."""
        first = (self.strike, self.steps, self.turn, self.defend, self.counter)
        phrases = (*first, self.stand, self.travel, self.shuffle, self.press, self.bounce)
        weights = np.array(self.theme[:-1])
        end = phrases[int(np.searchsorted(np.cumsum(weights) / weights.sum(), self.rng.uniform()))]()
        self.now = max(end, self.plan.feet_free - 0.15) + float(self.rng.uniform(0.0, self.theme.pause))


def write_score(plan: Choreographer, seconds: float, theme: Theme) -> Score:
    """Plan a clip of a given length [s] on a theme: phrases until it is full, with the guard at both ends."""
    boxer = _Boxer(plan, seconds, theme, float(plan.rng.uniform(0.35, 0.7)))
    while boxer.now <= seconds - 2.9:
        boxer.phrase()
    return plan.finish(seconds)


def exchange_blows(plan: Choreographer, begin: float, least: float) -> float:
    """Write phrases of an exchange of blows; return when the last one is over [s].

    Args:
        plan: What has been planned so far.
        begin: When the first one begins [s], later where a foot is still off the floor.
        least: Shortest time from there until the last one is over [s].
    """
    boxer = _Boxer(plan, np.inf, _EXCHANGE, max(begin, plan.feet_free))
    while boxer.now < begin + least:
        boxer.phrase()
    return boxer.now
