"""The plan of a clip: a boxer who circles, punches in combinations and rests, drawn from a seeded generator."""

from __future__ import annotations

import numpy as np

from crowdsim.motion import ground
from crowdsim.motion.performer_punches import RECIPES
from crowdsim.motion.performer_score import (
    LEAD,
    REAR,
    Accent,
    Defence,
    Footstep,
    Pivot,
    Reach,
    Score,
    Style,
    Turn,
)


def draw_style(rng: np.random.Generator) -> Style:
    """Draw how the boxer of one clip stands."""
    wide = rng.uniform(0.92, 1.12)
    return Style(
        lead_ball=(0.10 * wide + rng.uniform(-0.015, 0.015), 0.25 * wide),
        rear_ball=(-0.12 * wide + rng.uniform(-0.015, 0.015), -0.21 * wide),
        foot_yaws=(-0.28 + rng.uniform(-0.08, 0.08), -0.82 + rng.uniform(-0.1, 0.1)),
        heels=(0.06 + rng.uniform(0.0, 0.06), 0.26 + rng.uniform(-0.06, 0.1)),
        height=0.875 + rng.uniform(-0.02, 0.015),
        lean=0.26 + rng.uniform(-0.05, 0.06),
        blade=-0.55 + rng.uniform(-0.08, 0.08),
        twist=-0.06 + rng.uniform(-0.06, 0.06),
        lead_fist=(0.10 + rng.uniform(-0.02, 0.03), 0.11 + rng.uniform(-0.04, 0.04), 0.40 + rng.uniform(-0.04, 0.05)),
        rear_fist=(-0.07 + rng.uniform(-0.02, 0.02), 0.12 + rng.uniform(-0.03, 0.04), 0.24 + rng.uniform(-0.02, 0.04)),
        elbows=(0.22 + rng.uniform(-0.1, 0.15), 0.25 + rng.uniform(-0.1, 0.15)),
        bounce=(rng.uniform(0.006, 0.013), rng.uniform(1.7, 2.3)),
        sway=rng.uniform(0.016, 0.026),
        breath=rng.uniform(0.38, 0.55),
    )


class Choreographer:
    """Writes a score, phrase by phrase; ``now`` is the time [s] up to which the body is taken."""

    def __init__(self, seconds: float, rng: np.random.Generator) -> None:
        self.seconds, self.rng = seconds, rng
        self.style = draw_style(rng)
        self.now = 0.0
        self.place = np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)])
        self.start = (0.0, 0.0, float(self.place[2]))
        self.yaws = [self.place[2] + yaw for yaw in self.style.foot_yaws]
        self.footsteps: list[Footstep] = []
        self.pivots: list[Pivot] = []
        self.turns: list[Turn] = []
        self.accents: list[Accent] = []
        self.reaches: list[Reach] = []
        self.defences: list[Defence] = []
        self.feet_free = 0.0
        self.hands_free = [0.0, 0.0]

    def about(self, middle: float, spread: float = 0.12) -> float:
        """Draw a number near ``middle``, off by ``spread`` of it at one standard deviation, two at most."""
        return middle * (1.0 + spread * float(np.clip(self.rng.normal(), -2.0, 2.0)))

    def footprint(self, foot: int) -> tuple[float, float, float]:
        """Return where a foot would stand in the stance that the plan is in: x, z, heading."""
        ball = (self.style.lead_ball, self.style.rear_ball)[foot]
        x, z = np.array(ball) + self.rng.uniform(-0.018, 0.018, 2)
        place = ground.to_world(self.place, np.array([x, 0.0, z]))
        yaw = self.place[2] + self.style.foot_yaws[foot] + self.rng.uniform(-0.07, 0.07)
        return float(place[0]), float(place[2]), float(yaw)

    def move(self, start: float, ahead: float, left: float, turn: float, tempo: float) -> float:
        """Step with both feet to a new stance; return when the second foot is down [s].

        The foot on whose side the way goes moves first, so that feet never cross.
        """
        start = max(start, self.feet_free)
        along = np.subtract(self.style.lead_ball, self.style.rear_ball)
        first = LEAD if left * along[0] + ahead * along[1] >= 0.0 else REAR
        self.place = ground.compose(self.place, [left, ahead, turn])
        length = float(np.hypot(ahead, left)) + 0.25 * abs(turn)
        begin = start
        for foot in (first, 1 - first):
            seconds = self.about(0.2 + 0.17 * length, 0.08) / tempo
            x, z, yaw = self.footprint(foot)
            lift = self.about(0.02 + 0.05 * length, 0.2)
            self.footsteps.append(Footstep(foot, begin, begin + seconds, x, z, yaw, lift))
            self.yaws[foot] = yaw
            end = begin + seconds
            begin = end - self.rng.uniform(0.0, 0.03) if foot == first else begin
        if turn:
            self.turns.append(Turn(start - 0.04, end + 0.06, turn))
        self.feet_free = end + 0.03
        return end

    def punch(self, kind: str, onset: float, speed: float, to_body: bool = False) -> Reach:
        """Throw a punch whose fist sets off at ``onset`` [s] and peaks at about ``speed`` [m/s]."""
        recipe = RECIPES[kind]
        hand = recipe.hand
        onset = max(onset, self.hands_free[hand])
        out = 1.95 * recipe.travel / speed
        hit = onset + out
        fall = hit + self.rng.uniform(0.01, 0.04)
        end = fall + out * self.rng.uniform(1.1, 1.35)
        vigour = self.about(1.0, 0.1)
        for part in recipe.parts:
            size = self.about(part.size, 0.13) * vigour

            def at(phase: float) -> float:
                phase += 0.03 * float(self.rng.normal())
                return onset + phase * out if phase <= 1.0 else hit + (phase - 1.0) * (end - hit)

            start, peak, fall_, stop = (at(p) for p in (part.start, part.peak, part.fall, part.end))
            peak = max(peak, start + 0.06)
            fall_ = max(fall_, peak)
            self.accents.append(Accent(part.channel, size, start, peak, fall_, max(stop, fall_ + 0.1), part.skew))
        low, high = recipe.body_height if to_body else recipe.height
        reach = Reach(
            kind,
            hand,
            onset,
            hit,
            fall,
            end,
            bearing=recipe.bearing[0] + recipe.bearing[1] * float(np.clip(self.rng.normal(), -2.2, 2.2)),
            distance=self.rng.uniform(*recipe.distance),
            height=self.rng.uniform(low, high),
            skew=recipe.skew,
        )
        self.reaches.append(reach)
        self.hands_free[hand] = end - 0.15 * (end - hit)
        return reach

    def phrase(self) -> None:
        """Write one phrase: a step, a combination, or both."""
        rng = self.rng
        choice = rng.uniform()
        now = self.now
        if choice < 0.35:
            angle = rng.uniform(-np.pi, np.pi)
            far = rng.uniform(0.1, 0.3)
            now = self.move(now, far * np.cos(angle), far * np.sin(angle), 0.0, self.about(1.1))
        elif choice < 0.45:
            turn = rng.uniform(0.3, 0.7) * rng.choice([-1.0, 1.0])
            now = self.move(now, 0.0, 0.0, float(turn), self.about(1.0))
        else:
            if choice < 0.65:
                self.move(now - 0.02, rng.uniform(0.12, 0.28), rng.uniform(-0.06, 0.06), 0.0, self.about(1.2))
            combination = (("jab",), ("jab", "straight"), ("jab", "jab", "straight"), ("straight",))[rng.integers(4)]
            for kind in combination:
                thrown = self.punch(kind, now, float(np.clip(rng.normal(7.5, 1.2), 5.2, 10.0)))
                now = thrown.hit + 0.25 * (thrown.end - thrown.hit)
            now = thrown.end
        self.now = max(now, self.feet_free - 0.1) + rng.uniform(0.02, 0.45)

    def write(self) -> Score:
        """Fill the clip with phrases, guard at both ends."""
        self.now = 0.45 + self.rng.uniform(0.0, 0.3)
        while self.now < self.seconds - 2.6:
            self.phrase()
        return Score(
            self.seconds,
            self.style,
            self.start,
            tuple(self.footsteps),
            tuple(self.pivots),
            tuple(self.turns),
            tuple(self.accents),
            tuple(self.reaches),
            tuple(self.defences),
        )


def write_score(seconds: float, rng: np.random.Generator) -> Score:
    """Plan a clip of a given length [s]."""
    return Choreographer(seconds, rng).write()
