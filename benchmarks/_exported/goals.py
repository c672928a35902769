"""The figures of contact, reactions and variety that are measured from BVH files, and what is aimed at."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Measure:
    """A row of the table.

    Attributes:
        label: What is measured.
        keys: Keys of the figure in a run's results.
        unit: ``percent``, ``cm``, ``seconds`` or ``number``.
        source: Keys of the same of the source, none where there is nothing of the kind.
        most: What it is at most, None without a goal.
        least: What it is at least.
        most_of: What it is at most in certain scenes instead.
        of_source: Share of the source's own figure that it is at least, or at most where that is 1.
    """

    label: str
    keys: tuple[str, ...]
    unit: str = "percent"
    source: tuple[str, ...] = ()
    most: float | None = None
    least: float | None = None
    most_of: dict[str, float] = field(default_factory=dict)
    of_source: float | None = None

    def goal(self, scene: str) -> str:
        """Return the goal in words, empty without one."""
        most = self.most_of.get(scene, self.most)
        if self.of_source is not None:
            share = f"at least {100 * self.of_source:.0f} % of"
            return f"{'at most' if self.of_source == 1.0 else share} the source's"
        if most is not None:
            return f"at most {shown(most, self.unit)}"
        return f"at least {shown(self.least, self.unit)}" if self.least is not None else ""

    def met(self, scene: str, value: float | None, source: float | None) -> bool:
        """Return whether a figure meets the goal; one that could not be measured, or has no goal, does."""
        if value is None:
            return True
        if self.of_source is not None:
            if source is None:
                return True
            return value <= source if self.of_source == 1.0 else value >= self.of_source * source
        most = self.most_of.get(scene, self.most)
        return (most is None or value <= most) and (self.least is None or value >= self.least)


def shown(value: float | None, unit: str) -> str:
    """Return a figure as text."""
    if value is None:
        return "none"
    if unit == "percent":
        return f"{100 * value:.2f}".rstrip("0").rstrip(".") + " %"
    if unit == "cm":
        return f"{100 * value:.3g} cm"
    return f"{value:.2f} s" if unit == "seconds" else f"{value:.3g}"


def find(results: dict[str, Any], keys: tuple[str, ...]) -> Any:
    """Return a figure of a run's results; None where a group above it is None or absent."""
    found: Any = results
    for key in keys:
        found = found.get(key) if isinstance(found, dict) else None
    return found


EVENTS = {
    "near_transitions": "near transitions",
    "near_landed_strikes": "near landed strikes",
    "everywhere": "anywhere",
}


def _accelerations() -> list[Measure]:
    rows = []
    beyond = "above the source's 99.9 %, per mille"
    limbs = (("foot", "feet", "near_transitions"), ("hand", "hands", "near_landed_strikes"))
    for kind, words in (("linear", "acceleration"), ("angular", "angular acceleration")):
        for part, name, event in limbs:
            keys = ("accelerations", kind, part, event)
            label = f"{words} of {name} {EVENTS[event]} {beyond}"
            rows.append(Measure(label, (*keys, "files"), "number", (*keys, "source_there"), most=3.0))
        for event, where in EVENTS.items():
            label = f"{words} of the part of the body that exceeds it most, {where}, per mille"
            keys = ("accelerations", kind, "worst", event)
            rows.append(Measure(label, (*keys, "files"), "number", (*keys, "source_there"), most=3.0))
        label = f"the same above the 99.9 % of the source near strikes, {words}, per mille"
        parts = ("worst_beyond_source_there", "near_landed_strikes", "beyond_source_there")
        rows.append(Measure(label, ("accelerations", kind, *parts), "number", most=3.0))
    return rows


MEASURES = (
    Measure("time deeper than 6 cm in another body, without arms", ("bodies", "without_arms", "share"), most=0.002),
    Measure("the same with arms", ("bodies", "with_arms", "share"), most=0.02),
    Measure("greatest depth without arms", ("bodies", "without_arms", "deepest"), "cm", most=0.1),
    Measure("greatest depth with arms", ("bodies", "with_arms", "deepest"), "cm", most=0.1),
    Measure("episodes deeper than 8 cm per avatar per minute, without arms",
            ("bodies", "without_arms", "episodes_per_minute"), "number", most=0.5),
    Measure("the same with arms", ("bodies", "with_arms", "episodes_per_minute"), "number"),
    Measure("time with a forearm or fist deeper than 6 cm in a torso or head",
            ("bodies", "arm_in_trunk_or_head", "share")),
    Measure("missed strikes that bury the arm deeper than 8 cm", ("strikes", "missed_buried")),
    Measure("landed strikes that bury the arm deeper than 8 cm", ("strikes", "landed_buried"), most=0.02),
    Measure("time that a landed fist stays deeper than 6 cm, median", ("strikes", "landed_stay", "median"), "seconds"),
    Measure("the same, 95th percentile", ("strikes", "landed_stay", "p95"), "seconds"),
    Measure("the same, longest", ("strikes", "landed_stay", "longest"), "seconds"),
    Measure("landed fists further than 2 cm from what they hit", ("fists", "beyond_2_cm"), most=0.005),
    Measure("the furthest", ("fists", "gap", "greatest"), "cm", most=0.06),
    *_accelerations(),
    Measure("transitions against other decisions whose captured motion is alike, AUC",
            ("transition_classifier", "matched", "auc"), "number",
            ("transition_classifier", "matched", "auc_of_content"), most=0.65),
    Measure("one-frame rotation jumps per avatar per minute", ("jumps", "rotation_jumps_per_minute"), "number",
            ("jumps", "rotation_jumps_per_minute_of_the_source"), of_source=1.0),
    Measure("the same of the source as the avatars play it",
            ("jumps", "rotation_jumps_per_minute_of_the_source_as_played"), "number"),
    Measure("steps 20 degrees beyond the source's greatest per avatar per minute",
            ("jumps", "steps_beyond_source_per_minute"), "number", most=0.0),
    Measure("sudden drops of the pelvis per avatar per minute", ("jumps", "pelvis_drops_per_minute"), "number",
            ("jumps", "pelvis_drops_per_minute_of_the_source"), of_source=1.0),
    Measure("head within 45 degrees of an opponent nearer than 1.5 m", ("gaze", "facing_share"), least=0.9),
    Measure("head more than 90 degrees off it", ("gaze", "away_share")),
    Measure("hits from behind", ("gaze", "hits_from_behind_share"), most=0.04),
    Measure("heads that turn to an attacker behind them within 1 s", ("gaze", "turned_to_attacker_share")),
    Measure("correlation of a blow's impulse and how far the victim's head goes within 0.5 s, seen from its pelvis",
            ("blows", "head", "correlation"), "number", least=0.5),
    Measure("the same over the ground", ("blows", "head_over_ground", "correlation"), "number"),
    Measure("pelvises at least 10 cm along the blow within 1 s, of the third with the strongest blows",
            ("blows", "pelvis", "away_after_strong"), source=("blows", "pelvis", "unhit"), least=0.5),
    Measure("strikes of victims within 0.8 s, over what they throw in 0.8 s on average",
            ("blows", "strikes_after", "all"), "number", most=0.5),
    Measure("the same of the third with the strongest blows", ("blows", "strikes_after", "strong"), "number", most=0.5),
    Measure("blows to the body after which the trunk bends at least 10 degrees against them",
            ("blows", "trunk", "against_the_blow"), least=0.8),
    Measure("how far a blocked blow moves the glove that is nearest to it, median", ("blows", "guard", "median"), "cm"),
    Measure("heads at least 3 cm along the strike 0.2 s after a hit", ("reactions", "raw", "share_of_3_cm"),
            source=("reactions", "unhit", "raw", "share_of_3_cm"), least=0.9),
    Measure("the same over what the motion does by itself", ("reactions", "over_unhit", "share_of_3_cm"),
            source=("reactions", "unhit", "over_unhit", "share_of_3_cm"), least=0.9),
    Measure("lean that is left 0.5 s after a hit, of the greatest", ("reactions", "lean_left_after_half_a_second")),
    Measure("strong hits after which a foot goes 10 cm along the strike within 1 s",
            ("reactions", "step_share_after_strong_hits"), source=("reactions", "step_share_unhit")),
    Measure("most repeated piece of source motion, times per boxer per minute",
            ("variety", "most_repeated_per_minute"), "number", most=4.0, most_of={"brawl_30_cmu": 6.0}),
    Measure("time with a neighbour at the same source within 2 s", ("variety", "same_source_share"),
            most=0.1, most_of={"brawl_30_cmu": 0.4}),
    Measure("same strikes of two opponents at once", ("variety", "same_strikes_at_once"), "number", most=0.0),
    Measure("time that bodies are still", ("variety", "still_share"), source=("variety", "still_share_of_the_source"),
            of_source=0.5),
)  # fmt: skip
"""Rows in the order of the table. In reactions, ``source`` is an unhit moment of the same victim."""
