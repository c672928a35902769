"""Decisions as the player shows them: the best actions, and what each is worth, term by term."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from crowdsim.crowd.explaining import Decision
from crowdsim.crowd.kernels.evaluate import TERMS

if TYPE_CHECKING:
    from crowdsim.crowd.value_map import ValueMap
    from crowdsim.policy.policy import Policy

_MOST = 6
"""Most actions that are shown of a decision, beside the one that is taken."""


class Reasons(Protocol):
    """Knows why avatars of a run did what they did, see ``play.repeated.Repeated``."""

    def at(self, avatar: int, frame: int) -> dict[str, Any]:
        """Return an avatar's last decision up to a control frame, see ``describe_decision``."""

    def values(self, avatar: int, frame: int) -> dict[str, Any]:
        """Return an avatar's value map in a control frame, see ``describe_values``."""


def describe_decision(decision: Decision, policy: Policy) -> dict[str, Any]:
    """Return a decision as plain data.

    ``options`` are the best actions and the one that is taken, the best first: number, clip, frame of the clip, value,
    what each of ``terms`` adds to it, whether it is among the candidates that are drawn from, and whether it is taken.
    """
    totals, chosen = decision.totals, decision.chosen
    order = np.argsort(-totals, kind="stable").tolist()
    taken = np.flatnonzero(decision.actions == chosen).tolist()
    shown = [*order[:_MOST], *(k for k in taken if k not in order[:_MOST])]
    drawn = set(decision.candidates.tolist())
    told = [t for t in range(len(TERMS)) if np.abs(decision.values[t, shown]).max(initial=0.0) >= 0.0005]
    return {
        "avatar": decision.avatar,
        "frame": decision.frame,
        "opponent": decision.opponent,
        "count": len(decision.actions),
        "forced": not taken,
        "terms": [TERMS[t] for t in told],
        "options": [
            {
                "action": int(decision.actions[k]),
                **_clip(policy, int(decision.actions[k])),
                "value": round(float(totals[k]), 3),
                "parts": [round(float(decision.values[t, k]), 3) for t in told],
                "drawn": k in drawn,
                "taken": k in taken,
            }
            for k in shown
        ],
    }


def describe_values(found: ValueMap | None, avatar: int, frame: int) -> dict[str, Any]:
    """Return a value map in a control frame as plain data; ``values`` is missing where the avatar decides nothing."""
    if found is None:
        return {"avatar": avatar, "frame": frame}
    return {
        "avatar": avatar,
        "frame": frame,
        "at": [round(found.x, 3), round(found.z, 3), round(found.heading, 4)],
        "distances": np.round(found.distances, 4).tolist(),
        "bearings": np.round(found.bearings, 5).tolist(),
        "values": np.round(found.values, 3).ravel().tolist(),
    }


def _clip(policy: Policy, action: int) -> dict[str, Any]:
    """Return the clip that an action is captured in, its first frame there, and how long it is."""
    database, graph = policy.database, policy.graph
    first = int(graph.action_first[action]) - 1
    clip = int(np.searchsorted(database.clip_starts, first, side="right")) - 1
    return {
        "clip": str(database.clip_names[clip]),
        "place": (first - int(database.clip_starts[clip])) * database.stride,
        "frames": int(graph.action_lengths[action]) * database.stride,
    }
