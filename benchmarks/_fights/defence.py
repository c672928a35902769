"""What defence is worth: strikes that land on a defender, beside those on the same boxer that does not defend itself.

The attacker is the boxer without defence in both. ``exploitability``: what the best response found gains, in hits per
minute, over the policy in its own place (``self_play.response``), against policies of some temperatures.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from crowdsim.self_play.response import best_response
from crowdsim.self_play.train import ready_policy
from crowdsim.training.recipe import DefenceSpec

DEFENDER, UNDEFENDED = "defender", "undefended"
EXPLOITED = ("boxer", "boxer_defender")
TEMPERATURES = (0.05, 0.2, 1.0)
LONG = DefenceSpec(rounds=3, seconds=300.0)
SHORT = DefenceSpec(rounds=1, seconds=10.0, pairs=8)


def measure_defence(bouts: Mapping[str, Any]) -> dict[str, float]:
    """Return what the defender lets land and lands itself, over the same boxer without defence, from their bouts.

    Args:
        bouts: The figures of every pair of fighters (``bouts.measure_bouts``).
    """
    plain, pair = bouts[UNDEFENDED][UNDEFENDED], bouts[UNDEFENDED][DEFENDER]
    without = sum(plain["landed_share"]) / 2
    landed = sum(plain["landed_per_minute"]) / 2
    return {
        "landed_on_undefended": without,
        "landed_on_defender": pair["landed_share"][0],
        "share": pair["landed_share"][0] / without if without else float("nan"),
        "own": pair["landed_per_minute"][1] / landed if landed else float("nan"),
    }


def measure_exploitability(policies: tuple[str, ...] = EXPLOITED, spec: DefenceSpec = LONG) -> dict[str, Any]:
    """Return what the best response gains against policies, by temperature."""
    return {
        name: {f"{heat:g}": best_response(policy, heat, spec) for heat in TEMPERATURES}
        for name in policies
        for policy in [ready_policy(name)]
    }


def lines(defence: Mapping[str, float], exploitability: Mapping[str, Any]) -> Iterator[str]:
    """Yield the tables, a line each."""
    yield f"{'strikes that land on':<26}{'undefended':>12}{'defender':>10}{'share':>8}{'own hits':>10}"
    yield (
        f"{'of an undefended attacker':<26}{defence['landed_on_undefended']:12.1%}{defence['landed_on_defender']:10.1%}"
        f"{defence['share']:8.2f}{defence['own']:10.2f}"
    )
    yield ""
    yield f"{'best response to':<18}{'temperature':>12}{'gain':>8}{'landed':>8}{'taken':>8}   hits per minute"
    for name, found in exploitability.items():
        for heat, one in found.items():
            yield f"{name:<18}{heat:>12}{one['gain']:8.1f}{one['landed']:8.1f}{one['taken']:8.1f}"
