"""Bouts between two fighters: who knocks out whom, and what becomes of their strikes.

Two avatars of the same size begin 2.4 m apart and fight until one is down for good, by ``DAMAGE`` in every bout, or for
a minute, which is a draw. In half of the bouts of a pair the first fighter has the red corner, at x < 0, in the others
the blue one. There is no arena, since random actions leave one, and nobody follows. A fighter whose policy has no falls
(`paper`, `boxer_cmu`) stays up when it is knocked down.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from scipy.stats import binomtest

from crowdsim.core.types import Array
from crowdsim.crowd.arrays import Model
from crowdsim.crowd.draw import draw_crowd
from crowdsim.crowd.events import OUTCOMES, Events
from crowdsim.crowd.model import build_model
from crowdsim.crowd.simulation import Simulation
from crowdsim.policy.policy import Policy
from crowdsim.preparation.prepare import load_policies, policy_names
from crowdsim.scenario.scenario import Scenario, resolve_scenario

RANDOM: dict[str, Any] = {"temperature": 100, "candidates": {"margin": 100, "maximum": 64}}
"""What makes a type choose at random."""
FIGHTERS: dict[str, dict[str, Any]] = {
    "boxer": {"policy": "boxer"},
    "boxer_crowd": {"policy": "boxer_crowd"},
    "boxer_cmu": {"policy": "boxer_cmu"},
    "paper": {"policy": "boxer_paper"},
    "random": {"policy": "boxer", **RANDOM},
    "undefended": {"policy": "boxer_defender", "behaviours": {"fight": 1}},
    "defender": {"policy": "boxer_defender"},
}
"""What the type of each fighter sets."""
DAMAGE: dict[str, float] = {
    "health": 30, "hit": 7, "body": 0.6, "blocked": 0.1, "stagger": 8, "knock_down": 16, "count": 4, "downs": 3,
}  # fmt: skip
"""What strikes take, the same from every fighter."""
SECONDS = 60.0
BOUTS = 200
FIRST_SEED = 20_000
"""Seed of the first bout of a pair; each bout has its own."""
APART = 2.4
"""How far apart fighters begin [m]."""
CONFIDENCE = 0.95
CORNERS = ("red", "blue")


@dataclass(frozen=True)
class Bout:
    """How a bout went. Index 0 is the red corner, 1 the blue one.

    Attributes:
        winner: The corner that won; -1 for a draw.
        seconds: How long it lasted [s].
        strikes: Strikes thrown by each corner, by what became of them (``OUTCOMES``). Shape (2, 4).
        downs: Knock-downs that each corner has made, the last one included. Shape (2,).
    """

    winner: int
    seconds: float
    strikes: Array
    downs: Array


def bout_scenario(red: str, blue: str, seconds: float = SECONDS) -> Scenario:
    """Return the scenario of a bout between two of ``FIGHTERS``."""
    groups = [
        {
            "name": corner,
            "team": corner,
            "type": fighter,
            "count": 1,
            "placement": {"kind": "points", "points": [[0.5 * side * APART, 0]]},
            "facing": "enemies",
            "opponents": {"kind": "fixed", "group": enemy},
        }
        for corner, enemy, fighter, side in zip(CORNERS, CORNERS[::-1], (red, blue), (-1, 1), strict=True)
    ]
    return resolve_scenario(
        Scenario.model_validate(
            {
                "version": 1,
                "name": "bout",
                "duration": {"seconds": seconds},
                "types": {name: {**FIGHTERS[name], "damage": DAMAGE} for name in (red, blue)},
                "groups": groups,
                "until": "last_standing",
            }
        )
    )


def fight(scenario: Scenario, policies: Sequence[Policy], model: Model, seed: int) -> Bout:
    """Return how the bout of a scenario goes with a seed; ``model`` is that of the policies."""
    crowd = draw_crowd(scenario.model_copy(update={"seed": seed}), policies)
    with Simulation(crowd, model=model) as simulation:
        chunk = simulation.run(crowd.frames)
    end = simulation.outcome
    standing = [] if end is None else end.standing.tolist()
    last = crowd.frames - 1 if end is None else end.frame
    strikes, downs = count_strikes(chunk.events, last)
    return Bout(standing[0] if len(standing) == 1 else -1, last / crowd.rate, strikes, downs)


def count_strikes(events: Events, last: int) -> tuple[Array, Array]:
    """Return the strikes of both corners up to a frame by outcome, and their knock-downs. Shapes (2, 4) and (2,)."""
    counts = (events.frame <= last) & (events.victim >= 0)
    strikes, downs = np.zeros((2, len(OUTCOMES)), np.int64), np.zeros(2, np.int64)
    np.add.at(strikes, (events.attacker[counts], events.outcome[counts]), 1)
    np.add.at(downs, events.attacker[counts & events.down], 1)
    return strikes, downs


def pair_bouts(
    one: str, other: str, policies: Mapping[str, Policy], count: int, seconds: float
) -> tuple[list[Bout], list[int]]:
    """Return bouts of a pair of fighters, and which corner the first of them had in each."""
    bouts, corners = [], []
    for corner in (0, 1):
        scenario = bout_scenario(*((one, other) if corner == 0 else (other, one)), seconds)
        used = [policies[name] for name in policy_names(scenario)]
        model = build_model(used)
        for k in range(corner, count, 2):
            bouts.append(fight(scenario, used, model, FIRST_SEED + k))
            corners.append(corner)
    return bouts, corners


def share(count: int, of: int) -> dict[str, Any]:
    """Return a share and its Wilson interval; None where there is nothing that it is a share of."""
    if of == 0:
        return {"share": None, "interval": None}
    low, high = binomtest(count, of).proportion_ci(CONFIDENCE, method="wilson")
    return {"share": count / of, "interval": [float(low), float(high)]}


def summarise(bouts: Sequence[Bout], corners: Sequence[int]) -> dict[str, Any]:
    """Return the figures of a pair; lists of two are those of the first fighter and of the other.

    Args:
        bouts: The bouts.
        corners: The corner that the first fighter had in each.
    """
    winners = np.array([bout.winner for bout in bouts])
    first = np.array(corners)
    count, won, lost = len(bouts), int((winners == first).sum()), int((winners == 1 - first).sum())
    # The first fighter comes first, whichever corner it had.
    turned = np.column_stack([first, 1 - first])
    strikes = np.sum([bout.strikes[corners] for bout, corners in zip(bouts, turned, strict=True)], axis=0)
    downs = np.sum([bout.downs[corners] for bout, corners in zip(bouts, turned, strict=True)], axis=0)
    seconds = sum(bout.seconds for bout in bouts)
    thrown = np.maximum(strikes.sum(axis=1), 1)
    by_outcome = {name: strikes[:, k] for k, name in enumerate(OUTCOMES)}
    return {
        "bouts": count,
        "won": share(won, count),
        "lost": lost / count,
        "drawn": (count - won - lost) / count,
        "won_of_decided": share(won, won + lost),
        "red_of_decided": share(int((winners == 0).sum()), won + lost),
        "seconds": seconds / count,
        "thrown_per_minute": (60.0 * strikes.sum(axis=1) / seconds).tolist(),
        "landed_per_minute": (60.0 * by_outcome["landed"] / seconds).tolist(),
        "landed_share": (by_outcome["landed"] / thrown).tolist(),
        "blocked_share": (by_outcome["blocked"] / thrown).tolist(),
        "evaded_share": (by_outcome["evaded"] / thrown).tolist(),
        "knock_downs": (downs / count).tolist(),
    }


def measure_bouts(fighters: Sequence[str], mocap: Any, count: int = BOUTS, seconds: float = SECONDS) -> dict[str, Any]:
    """Return the figures of every pair of fighters, each with itself included, by the names of both."""
    policies: dict[str, Policy] = {}
    for name in fighters:
        if FIGHTERS[name]["policy"] not in policies:
            policies |= {policy.name: policy for policy in load_policies(bout_scenario(name, name), mocap)}
    found: dict[str, Any] = {name: {} for name in fighters}
    for one, other in combinations_with_replacement(fighters, 2):
        found[one][other] = summarise(*pair_bouts(one, other, policies, count, seconds))
    return found


def lines(found: Mapping[str, Any]) -> Iterator[str]:
    """Yield the table of bouts, a line each."""
    yield f"{'':<26}{'won':>7}{'interval':>16}{'lost':>8}{'drawn':>8}{'landed per minute':>20}{'blocked':>15}" + (
        f"{'evaded':>15}{'knock-downs':>14}"
    )
    for one, pairs in found.items():
        for other, figures in pairs.items():
            low, high = figures["won"]["interval"]
            landed, downs = ("{:.1f} / {:.1f}".format(*figures[key]) for key in ("landed_per_minute", "knock_downs"))
            blocked, evaded = ("{:.1%} / {:.1%}".format(*figures[f"{key}_share"]) for key in ("blocked", "evaded"))
            yield (
                f"{one + ', ' + other:<26}{figures['won']['share']:7.1%}{f'{low:.1%} to {high:.1%}':>16}"
                f"{figures['lost']:8.1%}{figures['drawn']:8.1%}{landed:>20}{blocked:>15}{evaded:>15}{downs:>14}"
            )
