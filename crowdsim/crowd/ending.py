"""How a run ended before its duration, in words and as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from crowdsim.crowd.placement import teams_of_avatars
from crowdsim.scenario.scenario import Scenario

if TYPE_CHECKING:
    from crowdsim.crowd.outcome import Outcome

_MOST = 20


def describe_outcome(scenario: Scenario, outcome: Outcome) -> dict[str, Any]:
    """Return how a run ended: what ended it, in which control frame, and who was still in the fight.

    ``standing`` holds at most 20 names, ``standing_count`` how many there are, ``teams`` how many of each team.
    """
    left = np.bincount(teams_of_avatars(scenario)[outcome.standing], minlength=len(scenario.teams))
    return {
        "kind": outcome.kind,
        "frame": outcome.frame,
        "standing": [scenario.avatar_name(int(number)) for number in outcome.standing[:_MOST]],
        "standing_count": len(outcome.standing),
        "teams": dict(zip(scenario.teams, left.tolist(), strict=True)),
    }


def outcome_text(outcome: Mapping[str, Any], rate: float) -> str:
    """Return how a run ended in a line of text; ``outcome`` is of ``describe_outcome``, ``rate`` the control rate."""
    count, when = outcome["standing_count"], f"after {outcome['frame'] / rate:.1f} s"
    teams = {team: left for team, left in outcome["teams"].items() if left}
    if not count:
        left = "nobody is left"
    elif len(teams) > 1:
        left = f"{count:,} avatars are left, {', '.join(f'{number:,} of {team}' for team, number in teams.items())}"
    elif len(outcome["teams"]) > 1 and count > 1:
        left = f"team {next(iter(teams))!r} is left with {count:,} avatars"
    else:
        left = f"{outcome['standing'][0]} is left" if count == 1 else f"{count:,} avatars are left"
    return f"{outcome['kind'].replace('_', ' ')}: {left}, {when}"
