"""What a trained policy is bad at, in plain words, and what to do about it; found in the statistics of its bundle."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

LITTLE_MOTION = 60.0
"""Less motion than this [s] soon repeats itself."""
KEPT = 0.7
"""Share of the motion, and of its strikes, that the graph should keep."""
BRANCHING = 3.0
"""Actions of a state, in the mean, below which there is little to choose from."""
FEW_STRIKES = 10
"""Fewer strikes than this soon repeat themselves."""
ONE_KIND = 0.9
"""Share of strikes from which on they are as good as all of one kind."""
TO_THE_HEAD = 0.1
"""Share of strikes to the head below which heads are hardly ever struck."""
HEIGHTS = 0.35
"""Heights [m] that strikes should span, so that targets of other heights are struck."""
WALK = 1.2
"""Speed of a slow walk [m/s]."""
SUCCESS = 0.9
"""Share of trials in which a behaviour should succeed."""
BEHIND = 0.15
"""How much lower the share of success may be where the target is behind at first."""
LANDED = 8.0
"""Strikes that should land in a minute of a duel, of both together."""
WAIT = 12.0
"""Longest time in which a duel may go without a strike [s]."""
TURNED_AWAY = 0.05
"""Share of the time in which an avatar may have its opponent behind it."""
STANDING = 0.1
"""Share of the time in which an avatar may stand still."""
OUT_OF_REACH = 0.25
"""How much further than strikes reach a head an opponent is that they do not reach, a step included [m]."""
STEPS = 0.2
"""Speed of a body that hardly steps [m/s]."""
FEW_ACTIONS = 4
"""Different actions in a long wait up to which they repeat themselves."""
_NAMED = 3


TASKS = {"arrive": "comes to its target", "strike": "lands a strike", "evade": "keeps clear of a strike"}
"""What behaviours are tried at (``trials.measure_success``), in words."""


@dataclass(frozen=True)
class Weakness:
    """Something that a policy is bad at.

    Attributes:
        what: What it is, with the figure that shows it.
        advice: What to do about it.
    """

    what: str
    advice: str


def find_weaknesses(statistics: Mapping[str, Any]) -> list[Weakness]:
    """Return what a policy is bad at by the statistics of its bundle, motion first; an empty list when nothing is."""
    return [
        *_of_motion(statistics),
        *_of_strikes(statistics),
        *_of_travel(statistics),
        *_of_behaviours(statistics),
        *_of_duels(statistics),
    ]


def _of_motion(statistics: Mapping[str, Any]) -> Iterator[Weakness]:
    motion, graph = statistics["motion"], statistics["graph"]
    if motion["seconds"] < LITTLE_MOTION:
        yield Weakness(f"little motion: {motion['seconds']:.0f} s, which soon repeats itself", "add clips")
    left_out = [name for name, kept in motion["frames_kept_by_clip"].items() if not kept and "~" not in name]
    share = motion["frames_kept"] / max(motion["frames"], 1)
    advice = f"add clips between them and the others, or raise graph.threshold ({graph['threshold']:g} m)"
    if left_out:
        names = ", ".join(left_out[:_NAMED]) + (", ..." if len(left_out) > _NAMED else "")
        clips = "1 clip is" if len(left_out) == 1 else f"{len(left_out)} clips are"
        yield Weakness(f"{clips} not used, for want of transitions to and from the others: {names}", advice)
    elif share < KEPT:
        yield Weakness(f"{1.0 - share:.0%} of the motion is not used, for want of transitions", advice)
    if graph["branching"] < BRANCHING:
        yield Weakness(
            f"few transitions: {graph['branching']:.1f} actions a state",
            f"raise graph.threshold ({graph['threshold']:g} m), or add clips that begin and end in one stance",
        )


def _of_strikes(statistics: Mapping[str, Any]) -> Iterator[Weakness]:
    motion = statistics["motion"]
    if not motion["strikes"]:
        yield Weakness("no strikes: avatars come to their targets and do no more", "add clips with strikes")
        return
    strikes = statistics["strikes"]
    if motion["strikes"] < FEW_STRIKES:
        yield Weakness(f"few strikes: {motion['strikes']}, which soon repeat themselves", "add clips with strikes")
    if strikes["used_share"] < KEPT:
        yield Weakness(
            f"{1.0 - strikes['used_share']:.0%} of the strikes are not used, for want of transitions to them",
            f"raise graph.threshold ({statistics['graph']['threshold']:g} m), or add clips that lead to them",
        )
    punches = sum(strikes["by_hand"].values())
    for hand, count in strikes["by_hand"].items():
        if not count and punches and not motion["mirrored"]:
            yield Weakness(f"no strikes with the {hand} hand", "set motion.mirror to true, or add clips with some")
    for kind, count in strikes["by_kind"].items():
        if kind != "prop" and count > ONE_KIND * motion["strikes"] and motion["strikes"] >= FEW_STRIKES:
            yield Weakness(f"nearly all strikes are of one kind, {kind}", "add clips with others")
    to_the_head = strikes["by_height"]["head"] / motion["strikes"]
    if to_the_head < TO_THE_HEAD:
        yield Weakness(f"{to_the_head:.0%} of the strikes go to the head", "add clips with higher strikes")
    low, high = strikes["reach"]["height"]
    if high - low < HEIGHTS:
        yield Weakness(
            f"strikes reach only heights of {low:.1f} to {high:.1f} m", "add clips with high and low strikes"
        )


def _of_travel(statistics: Mapping[str, Any]) -> Iterator[Weakness]:
    speed = statistics["sustained_speed"]
    if speed < WALK:
        yield Weakness(
            f"slow: follows a target at {speed:.1f} m/s at most, one that walks at {WALK:g} m/s gets away",
            "add clips of walking or running that begin and end in the stance of the strikes",
        )


def _of_behaviours(statistics: Mapping[str, Any]) -> Iterator[Weakness]:
    for name, facts in statistics["behaviours"].items():
        success = facts["success"]
        goal = TASKS[success["task"]]
        if success["share"] < SUCCESS:
            yield Weakness(
                f"{name} {goal} within {success['seconds']:g} s in only {success['share']:.0%} of trials",
                "add clips with strikes to more sides"
                if success["task"] == "strike"
                else "add clips of steps and turns",
            )
        behind = success["share_behind"]
        if behind is not None and behind < success["share"] - BEHIND:
            yield Weakness(
                f"{name} {goal} in only {behind:.0%} of trials where the target is behind at first",
                "add clips of turning round",
            )
        if not facts["converged"]:
            yield Weakness(f"{name} was not learned to its tolerance", "raise its solver's max_sweeps")


def _of_duels(statistics: Mapping[str, Any]) -> Iterator[Weakness]:
    duel = statistics.get("duel")
    if duel is None:
        return
    cause, advice = _cause_of_waiting(statistics, duel)
    if duel["still_share"] > STANDING:
        yield Weakness(f"stands still in {duel['still_share']:.0%} of the time of a duel: {cause}", advice)
    elif statistics["motion"]["strikes"] and duel["longest_wait"] > WAIT:
        yield Weakness(f"a duel has no strike for {duel['longest_wait']:.0f} s: {cause}", advice)
    elif statistics["motion"]["strikes"] and duel["landed"] < LANDED:
        yield Weakness(
            f"few strikes land in a minute of a duel: {duel['landed']:.1f} of {duel['thrown']:.1f}",
            "add clips with strikes to more sides, and of steps that lead up to them",
        )
    if duel["turned_away_share"] > TURNED_AWAY:
        yield Weakness(
            f"turned away from its opponent in {duel['turned_away_share']:.0%} of the time of a duel",
            "add clips of turning round, or raise the weight of the reward for having the target ahead",
        )


def _cause_of_waiting(statistics: Mapping[str, Any], duel: Mapping[str, Any]) -> tuple[str, str]:
    """Return why avatars of a policy do not strike in a duel, and what would help."""
    strikes, apart, speed = statistics.get("strikes"), duel["waiting_distance"], statistics["sustained_speed"]
    if strikes is None:
        return (
            "its motion has no strikes, and standing is worth as much as moving",
            "add clips of steps, turns and strikes",
        )
    if apart > strikes["striking_range"][1] + OUT_OF_REACH:
        near, far = strikes["striking_range"]
        what = f"the two are {apart:.1f} m apart, and strikes reach {near:.1f} to {far:.1f} m"
        if speed < STEPS:
            return (
                f"{what}; the motion has hardly any steps",
                "add clips of steps and turns in the stance of the strikes",
            )
        return what, "add clips of steps that end in the stance of the strikes"
    if duel["waiting_actions"] <= FEW_ACTIONS:
        repeated = int(duel["waiting_actions"])
        what = f"it repeats {'one action' if repeated == 1 else f'{repeated} actions'}; every way out is worth less"
        return what, "add clips that begin and end in that stance, or raise graph.threshold"
    what = f"the two are {apart:.1f} m apart, where keeping the distance is worth more than striking"
    return what, "raise the weight of strikes in the behaviour, or add clips of steps that lead up to strikes"
