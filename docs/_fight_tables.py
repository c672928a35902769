"""Tables of docs/quality.md on fights: random actions, bouts between fighters, and time to react."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations_with_replacement

from _results import Format, Results, fixed, number, percent

FIGHTERS = ("boxer", "boxer_crowd", "boxer_cmu", "paper", "random", "undefended", "defender")
BOTH: dict[str, tuple[str, Format]] = {
    "landed_per_minute": ("landed per minute", number),
    "landed_share": ("land", percent),
    "blocked_share": ("blocked", percent),
    "evaded_share": ("evaded", percent),
    "knock_downs": ("knock-downs", fixed),
}
"""Figures of both fighters of a pair."""


def random_choice(results: Results) -> list[str]:
    """Return strikes landed by the learned policies beside random actions."""
    rows = [
        [f"`{scene}`", *(results.cell(number, "fights", scene, how, key) for how in ("learned", "random")
                         for key in ("thrown", "strict"))]
        for scene in ("brawl_30", "brawl_30_cmu")
    ]  # fmt: skip
    header = ["per avatar per minute", "thrown", "landed", "thrown, random actions", "landed, random actions"]
    return results.table(header, rows, "fights")


def bouts(results: Results) -> list[str]:
    """Return how bouts between all pairs of fighters end, and what becomes of the strikes of either."""
    rows = []
    for one, other in combinations_with_replacement(FIGHTERS, 2):
        keys = ("fights", "bouts", one, other)
        rows.append([
            f"`{one}` / `{other}`",
            _with_interval(results, *keys, "won"),
            *(results.cell(percent, *keys, key) for key in ("lost", "drawn")),
            _with_interval(results, *keys, "red_of_decided"),
            results.cell(number, *keys, "seconds"),
            *(" / ".join(results.cell(shown, *keys, key, place) for place in "01") for key, (_, shown) in BOTH.items()),
        ])  # fmt: skip
    header = [
        "first / other",
        "won",
        "lost",
        "drawn",
        "won by red",
        "length [s]",
        *(label for label, _ in BOTH.values()),
    ]
    return results.table(header, rows, "fights")


def _with_interval(results: Results, *keys: str) -> str:
    """Return a share and its interval, such as ``74 % (64.6 % to 81.6 %)``; without one where there is none."""
    found = results.cell(percent, *keys, "share")
    if not results.has(*keys, "interval", "0"):
        return found
    low, high = (results.cell(percent, *keys, "interval", place) for place in "01")
    return f"{found} ({low} to {high})"


def defence(results: Results) -> list[str]:
    """Return what lands on the boxer that defends itself, beside the same one that does not."""
    keys = ("landed_on_undefended", "landed_on_defender")
    shares = [results.cell(percent, "fights", "defence", key) for key in keys]
    ratios = [results.cell(fixed, "fights", "defence", key) for key in ("share", "own")]
    header = [
        "land on the boxer without defence",
        "on the defender",
        "share of that",
        "its own hits, over those without",
    ]
    return results.table(header, [[*shares, *ratios]], "fights")


def exploitability(results: Results) -> list[str]:
    """Return what the best response gains against policies, by temperature."""
    rows = []
    for policy in ("boxer", "boxer_defender"):
        for heat in ("0.05", "0.2", "1"):
            keys = ("fights", "exploitability", policy, heat)
            rows.append(
                [f"`{policy}`", heat, *(results.cell(number, *keys, key) for key in ("gain", "landed", "taken"))]
            )
    header = ["policy", "temperature", "gain [hits per minute]", "landed per minute", "taken per minute"]
    return results.table(header, rows, "fights")


def reactions(results: Results) -> list[str]:
    """Return how long strikes are on their way, and how many of them a victim could react to."""
    rows = []
    for scene in ("brawl_30", "duel", "duel, boxer_defender"):
        keys = ("fights", "reaction", scene)
        leads = (results.cell(fixed, *keys, "lead_seconds", place) for place in "012")
        rows.append([f"`{scene}`", *leads, results.cell(percent, *keys, "reactable_share")])
    header = ["decision to impact [s]", "5th percentile", "median", "95th percentile", "victim decides in time"]
    return results.table(header, rows, "fights")


FIGHT_TABLES: dict[str, Callable[[Results], list[str]]] = {
    "random": random_choice,
    "bouts": bouts,
    "defence": defence,
    "exploitability": exploitability,
    "reactions": reactions,
}
