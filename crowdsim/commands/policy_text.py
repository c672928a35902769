"""What ``crowdsim inspect BUNDLE`` prints: motion, graph, strikes and behaviours of a policy in words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from crowdsim.commands.common import size_text
from crowdsim.take.figures_text import Row, count, length, number, percent, section, time

Figures = Mapping[str, Any]

_LOOKUPS = {"v": "values of states, with one step of look-ahead", "q": "values of actions"}


def policy_lines(figures: Figures) -> list[str]:
    """Return the figures of ``inspect_bundle`` as indented lines of text."""
    lines = [
        *section("Policy", _policy(figures)),
        *section("Motion", _motion(figures["motion"])),
        *section("Motion graph", _graph(figures["graph"], figures["motion"])),
    ]
    if "strikes" in figures:
        lines += section("Region that strikes reach, 5th to 95th percentile", _strikes(figures["strikes"]))
    lines += section("Falls", falls_text(figures.get("falls")))
    for name, behaviour in figures["behaviours"].items():
        lines += section(f"Behaviour {name}", _behaviour(behaviour, _control_rate(figures["motion"])))
    if figures.get("duel"):
        lines += section("Five one-minute duels with itself, mean", duel_text(figures["duel"]))
    return lines + section("Training", _training(figures["timings"]))


def _policy(figures: Figures) -> list[Row]:
    speed = figures.get("sustained_speed")
    return [
        ("name", figures["name"]),
        ("fingerprint", figures["fingerprint"][:16]),
        ("defence", "learned in fights with itself" if figures.get("defends") else None),
        ("follows targets", None if speed is None else f"that flee at up to {number(speed)} m/s"),
        *((("warning", warning)) for warning in figures.get("warnings", [])),
    ]


def _motion(motion: Figures) -> list[Row]:
    mirrored = ", and their mirror images" if motion["mirrored"] else ""
    rate = 60.0 * motion["strikes"] / motion["seconds"] if motion["seconds"] else 0.0
    return [
        ("capture", f"{count(motion['clips'], 'clip')} of {time(motion['seconds'])} together{mirrored}"),
        ("strikes", f"{motion['strikes']:,}, {number(rate)} per minute"),
    ]


def _control_rate(motion: Figures) -> float:
    """Return control frames per second."""
    return float(motion["frames"] / motion["seconds"]) if motion["seconds"] else math.nan


def _graph(graph: Figures, motion: Figures) -> list[Row]:
    kept = motion["frames_kept_by_clip"]
    whole = motion["frames"] * (2 if motion["mirrored"] else 1)
    unused = [name for name, frames in kept.items() if frames == 0]
    rate = _control_rate(motion)
    mean = graph["action_frames"] / rate
    return [
        ("frames kept", f"{graph['frames']:,} of {whole:,} control frames, {percent(graph['frames'] / whole)}"),
        ("", f"{min(kept.values()):,} to {max(kept.values()):,} of a clip" if kept else None),
        ("clips not used", ", ".join(unused) or None),
        ("transitions", f"{graph['transitions']:,}, at a cost of {length(graph['cost_mean'])} (mean),"),
        ("", f"{length(graph['cost_95'])} (95th percentile), {length(graph['threshold'])} (highest allowed)"),
        ("states", f"{graph['states']:,}"),
        ("actions", f"{graph['actions']:,}; {number(graph['branching'])} (mean) of a state"),
        ("length of an action", f"{time(mean)} (mean), {time(graph['action_frames_most'] / rate)} (longest)"),
        ("drawn at random", f"{number(graph['transitions_per_second'])} transitions per second, where the capture"),
        ("", f"has none; captured motion runs on for {time(graph['seconds_between_transitions'])} (median)"),
    ]


NO_FALLS = "no falls found: an avatar that would stay down leaves the scene"


def falls_text(falls: Figures | None) -> list[Row]:
    """Return how many falls, staggers and celebrations a policy has, and which way they go."""
    if falls is None:
        return [("falls", NO_FALLS)]
    kinds = (("falls", "fall", falls["directions"]), ("staggers", "stagger", falls["stagger_directions"]))
    rows: list[Row] = [(row, f"{count(len(ways), kind)}{_sides(ways)}") for row, kind, ways in kinds]
    if "celebrations" in falls:
        rows.append(("celebrations", count(falls["celebrations"], "celebration")))
    return rows


def _sides(ways: Sequence[float]) -> str:
    """Return which way bearings go, in words."""
    names = ("forward", "to the left", "backward", "to the right")
    numbers = [round(way / (0.5 * math.pi)) % 4 for way in ways]
    parts = [f"{numbers.count(number)} {name}" for number, name in enumerate(names) if number in numbers]
    return f": {', '.join(parts)}" if parts else ""


def duel_text(duel: Figures) -> list[Row]:
    """Return what came of a policy's duels with itself, of both avatars together."""
    return [
        ("strikes", f"{number(duel['thrown'])} a minute, {number(duel['landed'])} of them land"),
        ("longest wait", f"{time(duel['longest_wait'])} without a strike, {length(duel['waiting_distance'])} apart"),
        ("turned away", f"{percent(duel['turned_away_share'])} of the time"),
        ("standing still", f"{percent(duel['still_share'])} of the time, no joint faster than 5 cm/s"),
        ("distance", f"{length(duel['distance'])} (median)"),
    ]


def _strikes(strikes: Figures) -> list[Row]:
    rows: list[Row] = []
    for name, (low, high) in strikes["reach"].items():
        unit = "rad" if name == "bearing" else "m"
        text = _range(unit, low, high)
        if name in strikes["paper"]:
            text += f"; the paper: {_range(unit, *strikes['paper'][name])}"
        rows.append((name.replace("_", " "), text))
    return rows


def _range(unit: str, low: float, high: float) -> str:
    if unit == "rad":
        return f"{math.degrees(low):.0f} to {math.degrees(high):.0f} degrees"
    return f"{low:.2f} to {high:.2f} {unit}"


def _behaviour(behaviour: Figures, control_rate: float) -> list[Row]:
    axes = [_axis(axis, control_rate) for axis in behaviour["axes"]]
    seconds, rate = behaviour["seconds"], behaviour["updates_per_second"]
    solver = behaviour["solver"].replace("_", " ")
    end = "converged" if behaviour["converged"] else "did not converge"
    return [
        ("environment", f"{behaviour['cells']:,} cells: {axes[0]}" + ("," if len(axes) > 1 else "")),
        *((("", axis + ("," if axis is not axes[-1] else ""))) for axis in axes[1:]),
        ("table", f"{size_text(behaviour['bytes'])}, {count(behaviour['entries'], 'entry', 'entries')}:"),
        ("", _LOOKUPS[behaviour["lookup"]]),
        ("solved by", f"{solver}, {count(behaviour['sweeps'], 'sweep')}, {end}, residual {behaviour['residual']:.1g}"),
        ("took", None if seconds is None else time(seconds)),
        ("", None if rate is None else f"{number(rate / 1e6)} million updates per second"),
    ]


def _axis(axis: Figures, control_rate: float) -> str:
    from crowdsim.policy.axes.registry import kind_named

    kind = kind_named(axis["name"])
    low, high = (axis[end] / kind.grid_units(control_rate) for end in ("minimum", "maximum"))
    if axis["wraps"]:
        return f"{axis['name']} all around in steps of {math.degrees(high - low) / axis['count']:.0f} degrees"
    finer = ", finer where it is small" if axis["stretch"] else ""
    return f"{axis['name']} {_range(kind.unit, low, high)} at {axis['count']} grid points{finer}"


def _training(timings: Figures) -> list[Row]:
    return [(name, time(seconds)) for name, seconds in timings.items() if isinstance(seconds, int | float)]
