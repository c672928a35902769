"""How a run ended before its duration, in words and as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from crowdsim.scenario.scenario import Scenario

if TYPE_CHECKING:
    from crowdsim.crowd.outcome import Outcome

_MOST = 20


def describe_outcome(scenario: Scenario, outcome: Outcome) -> dict[str, Any]:
    """Return how a run ended: what ended it, in which control frame, and who was still in the fight.

    ``standing`` holds at most 20 names, ``standing_count`` how many there are, ``teams`` the teams that they are of.
    """
    teams: dict[str, None] = {}
    first = 0
    for group in scenario.groups:
        if ((outcome.standing >= first) & (outcome.standing < first + group.count)).any():
            teams[group.team] = None
        first += group.count
    return {
        "kind": outcome.kind,
        "frame": outcome.frame,
        "standing": [scenario.avatar_name(int(number)) for number in outcome.standing[:_MOST]],
        "standing_count": len(outcome.standing),
        "teams": list(teams),
    }


def outcome_text(outcome: Mapping[str, Any], rate: float) -> str:
    """Return how a run ended in a line of text; ``outcome`` is of ``describe_outcome``, ``rate`` the control rate."""
    count, when = outcome["standing_count"], f"after {outcome['frame'] / rate:.1f} s"
    who = ", ".join(outcome["standing"]) if count <= _MOST else f"{count:,} avatars"
    if outcome["kind"] == "last_team":
        winner = f"team {outcome['teams'][0]!r} is left ({count} standing)" if outcome["teams"] else "nobody is left"
    elif outcome["kind"] == "last_standing":
        winner = f"{who} is left" if count else "nobody is left"
    else:
        winner = f"{count:,} avatars are left"
    return f"{outcome['kind'].replace('_', ' ')}: {winner}, {when}"
