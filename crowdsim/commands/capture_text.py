"""What ``crowdsim inspect FILE.bvh`` prints: a file, its body, contacts and strikes in words."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from crowdsim.motion.strikes import REASONS, Rejection
from crowdsim.take.figures_text import Row, count, length, number, percent, section

Figures = Mapping[str, Any]
OUTCOMES = {"landed": "landed", "blocked": "blocked", "missed": "missed", "air": "thrown at the air"}


def capture_lines(figures: Figures) -> list[str]:
    """Return the figures of ``describe_capture`` as indented lines of text; findings are not among them."""
    lines = section("File", _file(figures)) + section("Roles of joints", list(figures["roles"].items()))
    if figures["contacts"] is None:
        return lines
    return [*lines, *section("Feet", _feet(figures)), *section("Strikes", _strikes(figures))]


def encounter_lines(encounters: Sequence[Figures]) -> list[str]:
    """Return what became of the strikes between the people of a file; nothing without any."""
    if not encounters:
        return []
    counts = Counter(one["outcome"] for one in encounters)
    rows: list[Row] = [("strikes", ", ".join(f"{amount} {OUTCOMES[outcome]}" for outcome, amount in counts.items()))]
    for one in encounters:
        who = f"{one['attacker']}, {_striker(one['limb']):10} at {one['victim']}"
        rows.append((f"at {one['seconds']:.2f} s", f"{who}: {OUTCOMES[one['outcome']]}"))
    return section("Between people", rows)


def _file(figures: Figures) -> list[Row]:
    scale, height, lead_in = figures["unit_scale"], figures["height_m"], figures["lead_in_frames"]
    shape = f"{count(figures['joints'], 'joint')}, {count(figures['end_sites'], 'end site')}"
    return [
        ("skeleton", f"{shape}, {count(figures['channels'], 'channel')}"),
        ("motion", f"{count(figures['frames'], 'frame')}, {figures['fps']:.6g} per second, {figures['seconds']:.2f} s"),
        ("lead-in pose", f"{count(lead_in, 'frame')}, cut off" if lead_in else None),
        ("left out", f"{count(figures['lost_frames'], 'frame')} besides" if figures["lost_frames"] else None),
        ("unit", f"{scale:.6g} m" if scale else "unknown"),
        ("up axis", figures["up_axis"] or "unknown"),
        ("body", f"{height:.2f} m tall" if height else None),
    ]


def _feet(figures: Figures) -> list[Row]:
    left, right = (percent(share) for share in figures["contact_share"])
    floor = figures["floor_m"]
    return [
        ("floor", f"at a height of {'-' if floor < 0.0 else ''}{length(abs(floor))} in the file"),
        ("planted", f"{count(figures['contacts'], 'time')}; left {left} of the time, right {right}"),
    ]


def _strikes(figures: Figures) -> list[Row]:
    rate = 60.0 * figures["strikes"] / figures["seconds"] if figures["seconds"] else 0.0
    rows: list[Row] = [
        ("strikes", f"{figures['strikes']:,}, {number(rate)} per minute"),
        ("by limb", _by_limb(figures["strikes_by_limb"])),
        ("fastest fist", f"{figures['highest_fist_speed']:.1f} m/s"),
    ]
    reasons = Counter(swing["reason"] for swing in figures["rejected_list"])
    label = "fast, but no strike"
    for reason in Rejection:
        if amount := reasons[reason.name.lower()]:
            rows.append((label, f"{count(amount, 'swing')}: {REASONS[reason]}"))
            label = ""
    for strike in figures["strike_list"]:
        across, height, ahead = strike["place"]
        place = f"{abs(across):.2f} m to the {'left' if across >= 0.0 else 'right'}, {height:.2f} m high"
        rows.append(
            (
                f"at {strike['seconds']:.2f} s",
                f"{_striker(strike['limb']):10} at {strike['speed']:4.1f} m/s, {place}, {ahead:.2f} m ahead",
            )
        )
    return rows


def _by_limb(counts: Mapping[str, int]) -> str | None:
    """Return how many strikes each limb has, in words; None without any."""
    return ", ".join(f"{amount} {_striker(limb)}" for limb, amount in counts.items() if amount) or None


def _striker(limb: str) -> str:
    return limb.replace("_hand", " fist").replace("_", " ")
