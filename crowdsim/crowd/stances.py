"""Stances: which foot leads in a policy's motion, how many actions lead back to a stance, and who fights in which."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from crowdsim.config.files import Finding
from crowdsim.core.types import Array
from crowdsim.crowd.random import Purpose, uniform
from crowdsim.motion import ground
from crowdsim.motion.body import HEIGHT
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.scenario.parts import STANCES, StanceShare

if TYPE_CHECKING:
    from crowdsim.motion.database import MotionDatabase
    from crowdsim.policy.policy import Policy
    from crowdsim.scenario.scenario import Scenario

MOST_ACTIONS = 16
"""From so many actions on it does not matter how many lead to a stance."""

_LEADS = 0.05
"""How far ahead of the other a foot leads, in a body of ``HEIGHT`` [m]."""
_STEPS = 1.0
"""Width of the smoothing over which steps do not change a stance [s]."""
_ENOUGH = 0.2
"""Share of a policy's states in which a foot must lead for avatars to keep that stance."""
_SIGNS = {"orthodox": 1, "southpaw": -1}


def draw_stances(scenario: Scenario, types: Array) -> Array:
    """Return the stance of each avatar.

    Args:
        scenario: The scenario.
        types: Index of the type of each avatar. Shape (N,).

    Returns:
        0 for one that may change its stance, 1 for orthodox, 2 for southpaw. Shape (N,), uint8.
    """
    drawn = np.zeros(len(types), np.uint8)
    for index, kind in enumerate(scenario.types.values()):
        if isinstance(kind.stance, StanceShare):
            own = np.flatnonzero(types == index)
            drawn[own] = 1 + (uniform(scenario.seed, Purpose.STANCE, own) < kind.stance.southpaw)
        elif kind.stance is not None:
            drawn[types == index] = 1 + STANCES.index(kind.stance)
    return drawn


def leading_feet(database: MotionDatabase) -> Array:
    """Return which foot leads in each control frame, in the mean over a few steps: 1 left, -1 right, 0 neither.

    Of mirror images it is the other one. Shape (F,), int8.
    """
    from scipy.ndimage import gaussian_filter1d

    frames = slice(None, None, database.stride)
    positions, _ = forward_kinematics(
        database.skeleton, database.root_positions[frames], database.rotations[frames], threads=1
    )
    feet = positions[:, [database.body.roles[f"{side}_foot"] for side in ("left", "right")]]
    ahead = ground.to_local(database.ground[frames][:, None], feet)[..., 2]
    gap, starts = np.asarray(ahead[:, 0] - ahead[:, 1], float), database.segment_starts
    for first, stop in itertools.pairwise(starts):
        gap[first:stop] = gaussian_filter1d(gap[first:stop], _STEPS * database.control_rate, mode="nearest")
    least = _LEADS * database.body.height / HEIGHT
    return np.asarray(np.where(gap > least, 1, np.where(gap < -least, -1, 0)), np.int8)


def stance_actions(policy: Policy) -> Array:
    """Return how many actions lead from each state to one in an orthodox and in a southpaw stance, where any does.

    It is 0 in a state in which the other foot does not lead, and at most ``MOST_ACTIONS``. Shape (S, 2), uint8.
    """
    actions = policy.actions
    leads = leading_feet(policy.database)[policy.graph.state_frames]
    owners = np.repeat(np.arange(actions.state_count), np.diff(actions.offsets))
    ends = np.asarray(actions.next, np.int64)[: len(owners)]
    found = np.where(leads[:, None] * list(_SIGNS.values()) >= 0, 0, MOST_ACTIONS)
    for _ in range(MOST_ACTIONS - 1):
        nearer = found.copy()
        np.minimum.at(nearer, owners, found[ends] + 1)
        found = nearer
    return found.astype(np.uint8)


def stance_rows(policies: Sequence[Policy], starts: Array) -> Array:
    """Return ``stance_actions`` of all policies; states of falls, behind those of each, count as either stance.

    Args:
        policies: The policies.
        starts: First state of each in the run, and the number of all. Shape (P + 1,).
    """
    rows = np.zeros((int(starts[-1]), len(STANCES)), np.uint8)
    for first, policy in zip(starts, policies, strict=False):
        found = stance_actions(policy)
        rows[first : first + len(found)] = found
    return rows


def stance_findings(scenario: Scenario, policies: Mapping[str, Policy]) -> list[Finding]:
    """Return a finding for each type that asks for a stance of which its policy has too little motion.

    Args:
        scenario: The scenario, resolved.
        policies: Policies by their names; types of others are passed over.
    """
    findings = []
    leads: dict[str, Array] = {}
    for name in sorted(scenario.used_types):
        kind = scenario.types[name]
        if kind.stance is None or kind.policy not in policies:
            continue
        policy = policies[kind.policy]
        if kind.policy not in leads:
            leads[kind.policy] = leading_feet(policy.database)[policy.graph.state_frames]
        for stance in _asked(kind.stance):
            share = float(np.mean(leads[kind.policy] == _SIGNS[stance]))
            if share < _ENOUGH:
                side = "left" if stance == "orthodox" else "right"
                what = (
                    f"policy {kind.policy!r} cannot keep the stance {stance!r}: the {side} foot leads in "
                    f"{100.0 * share:.0f} % of its states, expected {100.0 * _ENOUGH:.0f} % or more; 'mirror: true' in "
                    "its recipe gives it as much motion of one stance as of the other"
                )
                findings.append(Finding(("types", name, "stance"), what))
    return findings


def _asked(stance: str | StanceShare) -> list[str]:
    """Return the stances that avatars of a type can have."""
    if isinstance(stance, str):
        return [stance]
    shares = {"orthodox": 1.0 - stance.southpaw, "southpaw": stance.southpaw}
    return [one for one, share in shares.items() if share > 0.0]
