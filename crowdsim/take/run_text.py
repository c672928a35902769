"""The figures of a run in words, rated against the capture where it has them, as ``inspect`` and reports have them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from crowdsim.crowd.ending import outcome_text
from crowdsim.take.figures_text import Row, count, length, number, percent, rating, section, speed, time
from crowdsim.take.measures import AFTER, OUT_OF_REACH, STUCK
from crowdsim.take.penetration import DEEP
from crowdsim.take.quality import TOUCH
from crowdsim.take.variety import AROUND, LATELY, YIELDING

Figures = Mapping[str, Any]


def run_lines(figures: Figures) -> list[str]:
    """Return the figures of ``measure_take``, with the seconds that the run took, as indented lines of text."""
    return [line for title, rows in run_sections(figures) for line in section(title, rows)]


def run_sections(figures: Figures) -> list[tuple[str, list[Row]]]:
    """Return the figures of ``measure_take``, with the seconds that the run took, as sections of rows."""
    return [
        ("Run", _run(figures)),
        ("Avatars", _people(figures)),
        ("Strikes", _strikes(figures)),
        (f"Opponents, from {AFTER:g} s on", _opponents(figures)),
        ("Motion, and the capture's in the same frames", _motion(figures)),
        ("Variety", _variety(figures)),
        (f"Avatars compared while they fight, from {AFTER:g} s on", _spreads(figures)),
    ]


def _run(figures: Figures) -> list[Row]:
    control, wall, outcome = (figures.get(key) for key in ("control_seconds", "wall_seconds", "outcome"))
    seconds, rate = number(figures["seconds"], 3), figures["control_frames"] / max(figures["seconds"], 1e-9)
    return [
        ("avatars", f"{figures['avatars']:,}"),
        ("length", f"{count(figures['control_frames'], 'control frame')}, {seconds} s"),
        ("ended by", None if outcome is None else outcome_text(outcome, rate)),
        ("control took", None if control is None else time(control)),
        ("the whole run took", None if wall is None else time(wall)),
    ]


def _people(figures: Figures) -> list[Row]:
    """Say how avatars differ; what is the same for all of them is passed over."""
    rows = [
        (name, _percentiles(figures[f"{key}_spread"], unit, 3))
        for name, key, unit in (
            ("size", "scale", "times the skeleton's"),
            ("girth", "girth", "times the skeleton's"),
            ("legs", "legs", "times the skeleton's for their size"),
            ("arms", "arms", "times the skeleton's for their size"),
            ("tempo", "tempo", "strikes per minute"),
            ("aggression", "aggression", "times the usual"),
            ("range", "range", "m further away"),
        )
        if figures[f"{key}_spread"] is not None and len(set(figures[f"{key}_spread"])) > 1
    ]
    share = figures["stance_share"]
    if share is not None:
        kept = f"the foot of their stance leads for {percent(share)} of the time in which one does"
        rows.append(("stance", f"{figures['orthodox']:,} orthodox, {figures['southpaws']:,} southpaws; {kept}"))
    return rows


def _strikes(figures: Figures) -> list[Row]:
    thrown, landed = figures["thrown_per_minute"], figures["landed_per_minute"]
    least, first = figures["least_landed_per_minute"], figures["first_landed_seconds"]
    captured, share = figures["thrown_per_minute_captured"], figures["landed_share"]
    rates = "" if thrown is None else f", {number(thrown)} per avatar per minute"
    if thrown is not None and captured is not None:
        rates += f": {rating(thrown, captured)}, {number(captured)}"
    hits = "" if share is None else f", {percent(share)} of those thrown"
    hits += "" if landed is None else f", {number(landed)} per avatar per minute"
    stopped, evaded = figures["blocked_share"], figures["evaded_share"]
    air, behind, step = (figures[key] for key in ("air_share", "hits_from_behind_share", "step_after_hit"))
    return [
        ("thrown", f"{figures['strikes_thrown']:,}{rates}"),
        ("landed", f"{figures['strikes_landed']:,}{hits}"),
        ("knocked down", count(figures["knock_downs"], "time") if figures.get("knock_downs") else None),
        ("", None if behind is None else f"{percent(behind)} of those that landed, from behind"),
        ("", None if step is None else f"victims of strong ones go back by {length(step)} within {time(YIELDING)}"),
        ("", None if least is None else f"{number(least)} per minute by the avatar that lands least"),
        (
            "blocked",
            f"{figures['strikes_blocked']:,}" + ("" if stopped is None else f", {percent(stopped)} of those thrown"),
        ),
        (
            "evaded",
            f"{figures['strikes_evaded']:,}" + ("" if evaded is None else f", {percent(evaded)} of those thrown"),
        ),
        ("missed", f"{figures['strikes_missed']:,}"),
        ("first landed", "never" if first is None else f"after {time(first)}"),
        (
            "thrown at the air",
            None if air is None else f"{percent(air)} of those at an opponent, which was beyond their reach",
        ),
    ]


def _opponents(figures: Figures) -> list[Row]:
    distance, out, away = (figures[key] for key in ("distance_median", "out_of_reach_share", "turned_away_share"))
    stuck, changes = figures["stuck_avatars"], figures["opponent_changes"]
    if distance is None:
        return [("not measured", "no avatar has an opponent then, or the run ends before")]
    return [
        ("distance", f"{distance:.2f} m (median)"),
        (
            "out of reach",
            f"{percent(out)} of the time in which avatars have an opponent, further away than {OUT_OF_REACH:g} m",
        ),
        ("stuck", None if stuck is None else f"{count(stuck, 'avatar')}, out of reach for longer than {STUCK:g} s"),
        ("behind the avatar", f"{percent(away)} of that time"),
        ("changed", f"{count(changes, 'time')}, in the whole run"),
    ]


def _motion(figures: Figures) -> list[Row]:
    jump, transitions = (figures[name] for name in ("transition_jump_ratio", "transitions_per_second"))
    return [
        ("planted feet slide", _slide(figures, "median", "median")),
        ("", _slide(figures, "95", "95th percentile")),
        ("joints accelerate", None if jump is None else f"{rating(jump, 1.0)}, around transitions"),
        (
            "transitions",
            None if transitions is None else f"{number(transitions, 3)} per avatar per second; the capture has none",
        ),
        ("fists that land", _fists(figures)),
        *_penetration(figures),
    ]


def _variety(figures: Figures) -> list[Row]:
    repeated, source, strikes = (
        figures[key] for key in ("repeated_second_per_minute", "same_source_share", "same_strike_share")
    )
    still, captured = figures["stillness_share"], figures["stillness_share_captured"]
    beside = "" if captured is None else f"; {percent(captured)} of the captured motion"
    return [
        ("own repetition", None if repeated is None else f"the same moment {number(repeated)} times per minute"),
        (
            "others' motion",
            None
            if source is None
            else f"{percent(source)} of the time of all avatars, shown within {AROUND:g} m and {LATELY:g} s",
        ),
        (
            "same strikes at once",
            None if strikes is None else f"{percent(strikes)} of the strikes at opponents that fight back",
        ),
        ("stillness", None if still is None else f"{percent(still)} of the time of all avatars{beside}"),
    ]


def _spreads(figures: Figures) -> list[Row]:
    return [
        ("strikes thrown", _percentiles(figures["thrown_per_minute_spread"], "per minute")),
        ("strikes landed", _percentiles(figures["landed_per_minute_spread"], "per minute")),
        ("distance", _percentiles(figures["distance_spread"], "m", 3)),
    ]


def _percentiles(values: list[float] | None, unit: str, digits: int = 2) -> str | None:
    """Return the 10th, 50th and 90th percentile in words."""
    if values is None:
        return None
    low, middle, high = (number(value, digits) for value in values)
    return f"{middle} {unit} (median), {low} to {high} for 8 of 10 avatars"


def _penetration(figures: Figures) -> list[Row]:
    share, arms, deepest = (figures[f"penetration_{name}"] for name in ("share", "share_with_arms", "deepest"))
    if share is None:
        return [("bodies penetrate", None)]
    return [
        (
            "bodies penetrate",
            f"{percent(share)} of the time of all avatars deeper than {length(DEEP)}, {length(deepest)} (deepest)",
        ),
        ("", f"{percent(arms)} of that time with arms"),
    ]


def _slide(figures: Figures, key: str, name: str) -> str | None:
    ours, captured = figures[f"foot_slide_{key}"], figures[f"foot_slide_{key}_captured"]
    if ours is None:
        return None
    beside = "" if captured is None else f": {rating(ours, captured)}, {speed(captured)}"
    return f"at {speed(ours)} ({name}){beside}"


def _fists(figures: Figures) -> str | None:
    share, middle, most = (figures[key] for key in ("fists_off_share", "fist_gap_median", "fist_gap_most"))
    if share is None:
        return None
    limit = f"{100.0 * TOUCH:g} cm"
    off = (
        f"all within {limit} of what they hit"
        if share == 0.0
        else f"{percent(share)} of them further than {limit} from what they hit"
    )
    return f"{off}; {length(middle)} (median), {length(most)} (furthest)"
