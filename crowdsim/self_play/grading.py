"""The duels that training ends with: how a policy fights itself for a minute in the shipped scene, in figures.

Trials judge one behaviour with a still target. A duel shows what comes of all of them together, with an opponent that
does the same, in the crowd's control. Seeds are given, so that the same policy has the same figures.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from crowdsim import assets
from crowdsim.core.types import Array, Progress
from crowdsim.crowd.draw import draw_crowd
from crowdsim.crowd.simulate import simulate
from crowdsim.motion.kinematics import forward_kinematics
from crowdsim.policy.policy import Policy
from crowdsim.scenario.scenario import load_scenario
from crowdsim.take.measures import AFTER, FightCounter, opponent_offsets

SECONDS, SEEDS = 60, range(1, 6)
"""Length of a duel [s], and the seeds of those that are fought: one alone says little."""
GRADED = "graded"
"""What the scene calls the policy, whose own name may be none that scenarios can have."""
STILL = 0.05
"""An avatar stands still in frames in which none of its joints is faster than this [m/s]."""


@dataclass(frozen=True)
class Duel:
    """Figures of one duel, or their means over several.

    Attributes:
        seconds: How long it was [s].
        thrown: Strikes thrown by both together.
        landed: Those of them that landed.
        longest_wait: Longest time in which neither threw a strike; of several duels the longest of all [s].
        turned_away_share: Share of the time in which an avatar has its opponent more than 90 degrees off its heading.
        still_share: Share of the time in which none of its joints is faster than ``STILL``.
        distance: Median distance of the two over the ground [m].
        waiting_distance: Median distance in the longest wait [m].
        waiting_actions: Number of different actions in the longest wait of the one that has fewer.
    """

    seconds: float
    thrown: float
    landed: float
    longest_wait: float
    turned_away_share: float
    still_share: float
    distance: float
    waiting_distance: float
    waiting_actions: int


def grade_policy(policy: Policy, progress: Progress | None = None) -> dict[str, Any]:
    """Return the figures of duels of a policy with itself in the shipped scene (``Duel``), plain data."""
    speeds, duels = joint_speeds(policy), []
    for seed in SEEDS:
        duels.append(_fight(policy, seed, speeds))
        if progress is not None:
            progress("duel", len(duels), len(SEEDS))
    means = {field.name: float(np.mean([getattr(duel, field.name) for duel in duels])) for field in fields(Duel)}
    worst = max(duels, key=lambda duel: duel.longest_wait)
    waits = {name: getattr(worst, name) for name in ("longest_wait", "waiting_distance", "waiting_actions")}
    return means | waits


def _fight(policy: Policy, seed: int, speeds: Array) -> Duel:
    """Return what comes of one duel; ``speeds`` is what ``joint_speeds`` returns of the policy."""
    settings = [f"types.boxer.policy={GRADED}", f"duration={SECONDS}s"]
    scene = load_scenario(assets.shipped("scenarios", "duel.yaml"), settings, seed, policies=[GRADED])
    crowd = draw_crowd(scene, [replace(policy, name=GRADED)])
    counter, chunks = FightCounter(crowd.cast, crowd.policies, crowd.rate, crowd.frames), []
    for chunk in simulate(crowd, crowd.frames):
        counter.add(chunk)
        chunks.append(chunk)
    measures = counter.finish()
    struck = np.concatenate([chunk.events.frame for chunk in chunks])
    action, shown = (np.concatenate([getattr(chunk, name) for chunk in chunks]) for name in ("action", "action_frame"))
    distances = np.concatenate([np.hypot(*opponent_offsets(chunk)[:2])[:, 0] for chunk in chunks])
    begin, end = longest_wait(struck, len(action))
    waiting = slice(int(begin), int(end) + 1)
    frames = np.asarray(policy.graph.action_first, np.int64)[action] - 1 + shown.astype(np.int64)
    still = speeds[frames[round(AFTER * crowd.rate) :]] < STILL
    return Duel(
        seconds=len(action) / crowd.rate,
        thrown=len(struck),
        landed=int(sum(chunk.events.landed.sum() for chunk in chunks)),
        longest_wait=(end - begin) / crowd.rate,
        turned_away_share=measures.turned_away_share or 0.0,
        still_share=float(still.mean()),
        distance=measures.distance_median or 0.0,
        waiting_distance=float(np.median(distances[waiting])),
        waiting_actions=min(len(np.unique(column)) for column in action[waiting].T),
    )


def longest_wait(struck: Array, frames: int) -> tuple[float, float]:
    """Return begin and end of the longest time without a strike, of so many frames in all [control frames].

    Strikes were thrown at times (S,), in any order.
    """
    times = np.concatenate([[0.0], np.sort(np.asarray(struck, float)), [float(frames)]])
    longest = int(np.argmax(np.diff(times)))
    return float(times[longest]), float(times[longest + 1])


def joint_speeds(policy: Policy) -> Array:
    """Return the speed of the fastest joint in each control frame of a policy's motion [m/s]. Shape (F,)."""
    database = policy.database
    frames = np.arange(database.frame_count) * database.stride
    after = np.minimum(frames + 1, len(database.ground) - 1)
    skeleton, roots, rotations = database.skeleton, database.root_positions, database.rotations
    now, then = (forward_kinematics(skeleton, roots[at], rotations[at], threads=1)[0] for at in (frames, after))
    return np.asarray(np.linalg.norm(then - now, axis=-1).max(axis=-1) * database.playback_rate)
