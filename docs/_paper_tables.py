"""Tables of docs/paper.md: the paper's recipe beside the paper, and what each difference from it does."""

from __future__ import annotations

from collections.abc import Callable

from _results import Results, number, scaled, whole

PAPER = {
    "motion_seconds": "437",
    "strikes": "788",
    "states": "not legible",
    "actions": "27,072",
    "table_bytes": "50.4",
    "training_seconds": "22,500 (6 h 15 min)",
    "control_seconds": "9",
}
"""What the paper reports in its section 6; the table's size follows from its actions and cells."""
DIFFERENCES = {
    "unablated": "nothing",
    "other_motion": "nothing; another session of the performer",
    "no_tempo": "tempo: avatars never tire",
    "no_pruning": "pruning: every transition is an action",
    "no_transition_price": "the price of transitions",
    "no_effort": "effort and waste of strikes",
    "weighted_sum": "`fight`, for the weighted sum of `approach` and `punch`",
    "weighted_sum_without_fade": "the same, and `punch` counts beyond its grid",
    "weighted_sum_without_normalisation": "the same, and values are added as they are",
    "reward_maximum": "the sum of rewards, for their maximum",
    "moving_target": "the still target in training, for a moving one",
    "no_collision_avoidance": "collision avoidance",
    "no_hysteresis": "hysteresis: the nearest opponent, always",
    "q_learning": "value iteration, for Q-learning",
    "max_of_interpolated": "interpolated V, for the maximum of interpolated Q",
    "q_table": "the table of V, for one of Q",
    "equal_strikes": "the weight of strikes by their speed",
    "wanted_point": "the wanted band of distances, for a point",
    "strikes_at_15_hz": "strikes found at 60 Hz, for 15 Hz",
    "no_mirroring": "mirroring",
}


def recipe(results: Results) -> list[str]:
    """Return the paper's recipe beside what the paper reports."""
    rows = [
        [label, PAPER[key], results.cell(shown, "paper", "boxer_paper", key)]
        for key, label, shown in (
            ("motion_seconds", "motion [s]", whole),
            ("strikes", "effective strikes in it", whole),
            ("states", "states", whole),
            ("actions", "actions", whole),
            ("table_bytes", "tables [MB]", scaled(1e-6)),
            ("training_seconds", "training [s]", whole),
            ("control_seconds", "30 boxers, 1000 control frames [s]", number),
        )
    ]
    return results.table(["", "the paper", "`boxer_paper`"], rows, "paper")


def scenes(results: Results) -> list[str]:
    """Return strikes landed by the paper's recipe and ours."""
    names = ("duel", "moving_target", "brawl_30")
    rows = [
        [label, *(results.cell(number, "paper", "boxer_paper", "scenes", name, who, "landed_per_minute")
                  for name in names)]
        for who, label in (
            ("boxer_paper, as in the paper", "`boxer_paper`, without tempo, hysteresis and collision avoidance"),
            ("boxer_paper", "`boxer_paper`"),
            ("boxer", "`boxer`"),
        )
    ]  # fmt: skip
    header = ["strikes landed per avatar per minute", *(f"`{name}`" for name in names)]
    return results.table(header, rows, "paper")


def differences(results: Results) -> list[str]:
    """Return what becomes of ours when one difference is taken back."""
    rows = [
        [label, *(results.cell(shown, "paper", "differences", name, key) for key, shown in (
            ("landed_per_minute", number), ("return_ratio", number), ("actions", whole)))]
        for name, label in DIFFERENCES.items()
    ]  # fmt: skip
    header = ["taken back", "landed per avatar per minute", "return", "actions"]
    return results.table(header, rows, "paper")


PAPER_TABLES: dict[str, Callable[[Results], list[str]]] = {
    "recipe": recipe,
    "scenes": scenes,
    "differences": differences,
}
