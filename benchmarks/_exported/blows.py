"""What blows do to those whom they land on, by their impulse, from BVH files and the strikes of takes.

An impulse is the speed of the strike in the take times the effective mass of the limb (``MASSES``, by the cube of the
attacker's size) [kg m/s]. All blows that land count, wherever they land and whoever stands in the way; none is left out
but those in the last second of a run.

- `head`: the greatest distance of the victim's head within ``PEAK`` seconds from where it was, seen from its pelvis,
  and likewise over the ground (`head_over_ground`): correlation with the impulse, and medians of the weakest and
  strongest third. `correlation_by_files` takes the greatest speed of the fist or foot in the files within ``SWING``
  seconds before the hit instead of the take's.
- `pelvis`: share of the strongest third after which the pelvis goes 10 cm along the blow within a second; beside it
  the same of unhit moments of the same victims, along the same way.
- `strikes_after`: strikes that victims throw within 0.8 s, over what they throw in 0.8 s on average; of all blows and
  of the strongest third.
- `trunk`: share of blows to the body after which the line from pelvis to neck tips at least 10 degrees against the
  blow, and the same in any direction.
- `guard`: how far the nearest glove of the victim goes along a blocked blow within ``GIVES`` seconds.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from _exported.plain_bvh import Array
from _exported.reactions import hits_body, strike_way, unhit_moment
from _exported.run import PELVIS, ExportedRun, Strike, typical_moments, worst_moments
from _exported.witness import JOINTS, Figure, unit

SWING = 0.2
"""Time before a hit over which the speed of its fist or foot counts [s]."""
MASSES = (2.9, 2.9, 6.0, 6.0)
"""Effective mass of the hands and feet of a body of size 1 [kg]."""
PEAK, GIVES = 0.5, 0.15
"""Time after a blow within which the head and the trunk, and a glove, are furthest from where they were [s]."""
WITHIN, AWAY = 1.0, 0.1
"""Time within which a pelvis goes [s], and how far [m]."""
STUNNED = 0.8
"""Time after a blow over which the victim's own strikes are counted [s]."""
BENT = np.radians(10.0)
"""How far a trunk bends that a blow to the body folds [rad]."""
NECK = JOINTS.index("neck")


def fastest(run: ExportedRun, strike: Strike) -> float:
    """Return the greatest speed of a fist or foot in the files within ``SWING`` seconds before a strike [m/s]."""
    attacker, frame = run.figures[strike.attacker], round(strike.seconds * run.fps)
    path = attacker.fists[:, strike.limb] if strike.limb < 2 else attacker.soles[:, strike.limb - 2, 1]
    moved = np.diff(path[max(frame - round(SWING * run.fps), 0) : frame + 1], axis=0)
    return float(np.linalg.norm(moved, axis=1).max()) * run.fps


def strikes_of(run: ExportedRun, rows: Array) -> list[Strike]:
    """Return strikes by their rows of events."""
    return [Strike(*(run.events[name][row].item() for name in Strike.__dataclass_fields__)) for row in rows]


def head_peaks(figure: Figure, frame: int, fps: float) -> tuple[float, float]:
    """Return the greatest distance of a head from where it was, seen from the pelvis and over the ground [m]."""
    stop = frame + round(PEAK * fps) + 1
    head = figure.head[frame:stop]
    over = head - figure.joints[frame:stop, PELVIS]
    return tuple(float(np.linalg.norm(path - path[0], axis=1).max()) for path in (over, head))  # type: ignore[return-value]


def pelvis_away(figure: Figure, frame: int, fps: float, way: Array) -> float:
    """Return how far a pelvis goes along a way within ``WITHIN`` seconds [m]."""
    path = figure.joints[frame : frame + round(WITHIN * fps) + 1, PELVIS]
    return float(((path - path[0]) @ way).max())


def trunk_bend(figure: Figure, frame: int, fps: float, way: Array) -> tuple[float, float]:
    """Return how far the line from pelvis to neck tips against a way, and in any direction, at the most [rad]."""
    stop = frame + round(PEAK * fps) + 1
    lines = unit(figure.joints[frame:stop, NECK] - figure.joints[frame:stop, PELVIS])
    against = np.arctan2(-(lines @ way), lines[:, 1])
    return float((against - against[0]).max()), float(np.arccos(np.clip(lines @ lines[0], -1.0, 1.0)).max())


def guard_gives(run: ExportedRun, strike: Strike, way: Array) -> float:
    """Return how far the glove that is nearest to a strike goes along it within ``GIVES`` seconds [m]."""
    frame, victim = round(strike.seconds * run.fps), run.figures[strike.victim]
    gloves = victim.fists[frame : frame + round(GIVES * run.fps) + 1]
    gloves = gloves - victim.joints[frame : frame + len(gloves), None, PELVIS]
    fist = run.figures[strike.attacker].fists[frame, strike.limb % 2] - victim.joints[frame, PELVIS]
    nearest = int(np.argmin(np.linalg.norm(gloves[0] - fist, axis=1)))
    return float(((gloves[:, nearest] - gloves[0, nearest]) @ way).max())


def strikes_after(run: ExportedRun, hits: list[Strike]) -> float | None:
    """Return strikes that victims throw within ``STUNNED`` seconds after hits, over their average in such a time."""
    seconds, attackers = run.events["seconds"], run.events["attacker"]
    thrown = expected = 0.0
    for hit in hits:
        own = seconds[attackers == hit.victim]
        thrown += float(np.count_nonzero((own > hit.seconds) & (own <= hit.seconds + STUNNED)))
        expected += len(own) * STUNNED * run.fps / run.count
    return thrown / expected if expected else None


def measure_blows(run: ExportedRun) -> dict[str, Any]:
    """Return what blows do, by their impulse."""
    events, last = run.events, run.count - round(WITHIN * run.fps) - 1
    frames = np.round(events["seconds"] * run.fps).astype(int)
    measured = (events["victim"] >= 0) & (frames >= 1) & (frames <= last)
    rows = np.flatnonzero(measured & events["landed"])
    landed = strikes_of(run, rows)
    if len(landed) < 3:
        return {"landed": len(landed)}
    ways = [strike_way(run, one)[0] for one in landed]
    masses = np.array([MASSES[one.limb] * float(run.scales[one.attacker]) ** 3 for one in landed])
    impulses = events["speed"][rows] * masses
    frames = frames[rows]
    peaks = np.array([head_peaks(run.figures[one.victim], at, run.fps) for one, at in zip(landed, frames, strict=True)])
    low, high = np.quantile(impulses, (1.0 / 3.0, 2.0 / 3.0))
    strong = impulses >= high
    away = np.array([
        pelvis_away(run.figures[one.victim], at, run.fps, way)
        for one, at, way in zip(landed, frames, ways, strict=True)
    ])  # fmt: skip
    unhit = []
    for one in np.array(landed, dtype=object)[strong]:
        times = np.array([other.seconds for other in landed if other.victim == one.victim])
        calm = unhit_moment(run, one, times)
        if calm is not None:
            unhit.append(pelvis_away(run.figures[one.victim], calm[0], run.fps, calm[1]))
    body = np.array([hits_body(run, one) for one in landed])
    bends = np.array([
        trunk_bend(run.figures[one.victim], at, run.fps, way)
        for one, at, way, low_one in zip(landed, frames, ways, body, strict=True) if low_one
    ]).reshape(-1, 2)  # fmt: skip
    blocked = strikes_of(run, np.flatnonzero(measured & events["blocked"] & (events["limb"] < 2)))
    gives = [guard_gives(run, one, strike_way(run, one)[0]) for one in blocked]
    shown = np.array([fastest(run, one) for one in landed]) * masses
    hidden = impulses - impulses.max() * peaks[:, 0] / max(float(peaks[:, 0].max()), 1e-9)
    victims = np.array([one.victim for one in landed]), frames, run.fps
    attackers = np.array([one.attacker for one in landed])
    return {
        "landed": len(landed),
        "impulse": {name: float(value) for name, value in zip(("weak", "strong", "greatest"),
                                                              (low, high, impulses.max()), strict=True)},
        "head": {
            **_by_impulse(peaks[:, 0], impulses, low, high),
            "correlation_by_files": _correlation(peaks[:, 0], shown),
        },
        "head_over_ground": _by_impulse(peaks[:, 1], impulses, low, high),
        "pelvis": {
            "away_after_strong": float(np.mean(away[strong] >= AWAY)),
            "unhit": float(np.mean(np.array(unhit) >= AWAY)) if unhit else None,
            "median": float(np.median(away[strong])),
        },
        "strikes_after": {
            "all": strikes_after(run, landed),
            "strong": strikes_after(run, [one for one, hard in zip(landed, strong, strict=True) if hard]),
        },
        "trunk": {
            "to_the_body": int(body.sum()),
            "against_the_blow": float(np.mean(bends[:, 0] >= BENT)) if len(bends) else None,
            "in_any_direction": float(np.mean(bends[:, 1] >= BENT)) if len(bends) else None,
        },
        "guard": {"blocked": len(gives), "median": float(np.median(gives)) if gives else None},
        "moments": worst_moments(hidden, *victims, other=attackers),
        "typical": typical_moments(hidden, *victims, other=attackers),
    }  # fmt: skip


def _by_impulse(peaks: Array, impulses: Array, low: float, high: float) -> dict[str, float | None]:
    """Return the correlation of peaks with impulses, and medians of the weakest and strongest third [m]."""
    return {
        "correlation": _correlation(peaks, impulses),
        "weak": float(np.median(peaks[impulses <= low])),
        "strong": float(np.median(peaks[impulses >= high])),
    }


def _correlation(one: Array, other: Array) -> float | None:
    """Return the correlation of two measures, None where one of them does not vary."""
    return float(np.corrcoef(one, other)[0, 1]) if min(one.std(), other.std()) > 1e-9 else None
