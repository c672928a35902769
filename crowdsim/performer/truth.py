"""What truly happens in a performed clip: contacts, strikes and defences, for tests of the detectors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion import ground
from crowdsim.performer.player import Played
from crowdsim.performer.score import Fall, Rest, Score, Span, Travel


@dataclass(frozen=True)
class TrueStrike:
    """A punch that was thrown.

    Attributes:
        kind: jab, straight, lead_hook, rear_hook, lead_uppercut or rear_uppercut.
        hand: 0 for the left hand, 1 for the right.
        frame: Frame of the fist's furthest reach from the middle between the shoulders.
        peak: Frame of the fist's highest speed relative to the pelvis before that.
        speed: That speed [m/s].
        position: The fist at ``frame``, in the stance's ground frame there (x, y, z) [m].
        start: Time at which the fist sets off [s].
        hit: Planned time of the hit [s].
        end: Time at which it is back [s].
    """

    kind: str
    hand: int
    frame: int
    peak: int
    speed: float
    position: tuple[float, float, float]
    start: float
    hit: float
    end: float


@dataclass(frozen=True)
class Truth:
    """Ground truth of one clip.

    Attributes:
        contacts: Whether the ball of the left and right foot is planted. Shape (F, 2), bool.
        strikes: Punches by time.
        defences: Defences by time.
        travels: Travel over the floor by time.
        stance: Ground transform of the stance: pelvis over the floor, heading towards the opponent. Shape (F, 3).
        falls: Falls by time.
        staggers: Staggers by time.
        cheers: Celebrations by time.
        rests: Rests by time.
    """

    contacts: Array
    strikes: tuple[TrueStrike, ...]
    defences: tuple[Span[int], ...]
    travels: tuple[Travel[int], ...]
    stance: Array
    falls: tuple[Fall[int], ...]
    staggers: tuple[Span[int], ...]
    cheers: tuple[Span[int], ...]
    rests: tuple[Rest[int], ...]


def find_truth(score: Score, played: Played, times: Array) -> Truth:
    """Read the truth off a score and the motion that came of it."""
    fps = 1.0 / (times[1] - times[0])
    hips, fists = played.root_positions, played.fists
    stance = np.stack([hips[:, 0], hips[:, 2], played.footwork.heading], axis=-1)
    relative = fists - hips[:, None]
    speed = np.linalg.norm(np.gradient(relative, axis=0), axis=-1) * fps
    far = np.linalg.norm(fists - played.shoulders.mean(axis=1, keepdims=True), axis=-1)
    strikes = []
    for reach in sorted(played.reaches, key=lambda reach: reach.hit):
        hand = reach.hand
        first = max(int(np.ceil((reach.hit - 0.05) * fps)), 0)
        last = min(int((reach.hit + 0.07) * fps) + 1, len(times))
        frame = first + int(np.argmax(far[first:last, hand]))
        begin = max(int(reach.start * fps), 0)
        peak = begin + int(np.argmax(speed[begin : frame + 1, hand]))
        x, y, z = (float(value) for value in ground.to_local(stance[frame], fists[frame, hand]))
        times_of = (float(time) for time in (reach.start, reach.hit, reach.end))
        strikes.append(TrueStrike(reach.kind, hand, frame, peak, float(speed[peak, hand]), (x, y, z), *times_of))
    defences = tuple(
        Span(d.kind, int(np.ceil(d.start * fps)), int(d.end * fps) + 1)
        for d in sorted(score.defences, key=lambda d: d.start)
    )
    travels = tuple(
        Travel(t.gait, int(np.ceil(t.start * fps)), min(int(t.end * fps) + 1, len(times)))
        for t in sorted(score.travels, key=lambda t: t.start)
    )
    falls = tuple(Fall(f.kind, *(round(t * fps) for t in (f.start, f.down, f.rise, f.end))) for f in score.falls)
    staggers, cheers = (
        tuple(Span(s.kind, round(s.start * fps), round(s.end * fps)) for s in spans)
        for spans in (score.staggers, score.cheers)
    )
    rests = tuple(Rest(r.kind, *(round(t * fps) for t in (r.start, r.down, r.up, r.end))) for r in score.rests)
    return Truth(
        played.footwork.planted.copy(), tuple(strikes), defences, travels, stance, falls, staggers, cheers, rests
    )


def _other_side(kind: str) -> str:
    sides = {"left": "right", "right": "left"}
    return "_".join(sides.get(word, word) for word in kind.split("_"))


def mirror_truth(truth: Truth) -> Truth:
    """Return the truth of the mirrored clip."""
    return replace(
        truth,
        contacts=truth.contacts[:, ::-1].copy(),
        strikes=tuple(
            replace(strike, hand=1 - strike.hand, position=(-strike.position[0], *strike.position[1:]))
            for strike in truth.strikes
        ),
        defences=tuple(replace(one, kind=_other_side(one.kind)) for one in truth.defences),
        stance=truth.stance * np.array([-1.0, 1.0, -1.0]),
        falls=tuple(replace(one, kind=_other_side(one.kind)) for one in truth.falls),
        staggers=tuple(replace(one, kind=_other_side(one.kind)) for one in truth.staggers),
        rests=tuple(replace(one, kind=_other_side(one.kind)) for one in truth.rests),
    )
