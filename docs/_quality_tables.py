"""Tables of docs/quality.md: how well avatars fight, policies choose, and poses hold."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

from _fall_tables import FALL_TABLES
from _fight_tables import FIGHT_TABLES
from _results import MISSING, NOT_MEASURED, Format, Results, cell, fixed, number, percent, scaled, short, whole

sys.path.append(str(Path(__file__).resolve().parents[1] / "benchmarks"))
from _exported.goals import MEASURES, shown
from _fights.consequences import BREAK_GOALS
from _fights.consequences import GOALS as CONSEQUENCES
from _scene_goals import GOALS, Goal
from blows import GOALS as BLOWS
from blows import SCENES as BLOW_SCENES
from blows import is_met
from blows import key as blow_key

FIGHTS = (
    "duel", "bout", "moving_target", "moving_target_fast", "armies_200", "brawl_30", "brawl_30_cmu",
    "brawl_last_standing", "alley",
)  # fmt: skip
CROWDS = ("crowd_10k", "crowd_100k", "crowd_1m")
FIGURES: dict[str, tuple[str, Format]] = {
    "first_landed_seconds": ("first strike landed after [s]", number),
    "within_share": ("time within 1.3 m of the opponent", percent),
    "out_of_reach_share": ("time with the opponent out of reach", percent),
    "stuck_avatars": ("avatars out of reach for 10 s", number),
    "stuck_share": ("share of avatars out of reach for 10 s", percent),
    "thrown_per_minute": ("strikes thrown per avatar per minute", number),
    "landed_per_minute": ("strikes landed per avatar per minute", number),
    "least_landed_per_minute": ("the same of the avatar that lands least", number),
    "landed_share": ("share of strikes that land", percent),
    "air_share": ("share of strikes thrown at the air", percent),
    "turned_away_share": ("time with the opponent behind", percent),
    "distance_median": ("median distance to the opponent [m]", number),
    "overlap_share": ("time with overlapping bodies", percent),
    "pelvis_outside_share": ("time with the pelvis in an obstacle", percent),
    "feet_outside_share": ("time with a foot in an obstacle", percent),
}
RINGS = {f"ring_{radius}": f"{radius} m away" for radius in (2, 3, 4, 8, 12)}
RING_FIGURES: dict[str, tuple[str, Format]] = {
    "arrived_share": ("come within 1 m", percent),
    "arrived_in_time_share": ("come within 1.3 m in time", percent),
    "arrival_seconds": ("median time until within 1.3 m [s]", number),
    "landed_per_minute": ("strikes landed per avatar per minute", number),
}
ALL_FIGURES = {**FIGURES, **RING_FIGURES}


def goal_text(goal: Goal, shown: Format) -> str:
    """Return a goal in the unit of its figure, such as ``at most 2 %``."""
    low, high = goal.least != float("-inf"), goal.most != float("inf")
    between = f"{shown(goal.least)} to {shown(goal.most)}" if low and high else ""
    return between or (f"at least {shown(goal.least)}" if low else f"at most {shown(goal.most)}")


def judged(results: Results, scene: str, key: str, goal: Goal) -> float | None:
    """Return the figure that a goal is about: the mean of the seeds or the worst."""
    return results.get("scenes", scene, *(("mean", key) if goal.mean else (key,)))


def scene_cell(results: Results, scene: str, key: str) -> str:
    """Return the worst of the seeds and their mean; in bold, with the goal in brackets, where the goal is missed."""
    shown, goal = ALL_FIGURES[key][1], GOALS.get(scene, {}).get(key)
    if not results.has("scenes", scene, key):
        return "" if goal is None and results.has("scenes", scene) else results.cell(shown, "scenes", scene, key)
    worst, mean = results.get("scenes", scene, key), results.get("scenes", scene, "mean", key)
    text = cell(shown, worst) if worst == mean else f"{cell(shown, worst)} / {cell(shown, mean)}"
    if goal is None or goal.met(judged(results, scene, key, goal)):
        return text
    return f"**{text}** ({goal_text(goal, shown)}{' in the mean' if goal.mean else ''})"


def scene_table(results: Results, scenes: tuple[str, ...]) -> list[str]:
    """Return figures of scenes, a column each; figures that none of them has are left out."""
    rows = [[label, *(scene_cell(results, scene, key) for scene in scenes)] for key, (label, _) in FIGURES.items()]
    header = ["worst of the seeds / mean", *(f"`{scene}`" for scene in scenes)]
    return results.table(header, [row for row in rows if any(row[1:])], "scenes")


def goals_line(results: Results) -> str:
    """Return how many goals are missed, and which."""
    goals = [(scene, key, goal) for scene, some in GOALS.items() for key, goal in some.items()]
    known = [one for one in goals if results.has("scenes", *one[:2])]
    missed = [f"`{scene}`, {ALL_FIGURES[key][0]}" for scene, key, goal in known
              if not goal.met(judged(results, scene, key, goal))]  # fmt: skip
    unknown = f", {len(goals) - len(known)} {NOT_MEASURED}" if len(known) < len(goals) else ""
    return f"Goals missed: {len(missed)} of {len(goals)}{unknown}{': ' if missed else ''}{'; '.join(missed)}."


def scenes(results: Results) -> list[str]:
    """Return which goals are missed, and the figures of the small shipped scenes."""
    return [goals_line(results), "", *scene_table(results, FIGHTS)]


def crowds(results: Results) -> list[str]:
    """Return the figures of the large crowds."""
    return scene_table(results, CROWDS)


def ring(results: Results) -> list[str]:
    """Return how avatars approach a still target, the worst of the seeds and their mean."""
    rows = [[label, *(scene_cell(results, name, key) for name in RINGS)] for key, (label, _) in RING_FIGURES.items()]
    return results.table(["worst of the seeds / mean", *RINGS.values()], rows, "scenes")


def policies(results: Results) -> list[str]:
    """Return how good policies are beside a finer grid with a search at run time."""
    columns: list[tuple[str, Format, tuple[str, ...]]] = [
        ("return over the reference's", scaled(1.0), ("return_ratio_to_reference",)),
        ("the same above random actions", scaled(1.0), ("details", "decided_ratio")),
        ("random actions, return over the reference's", scaled(1.0), ("random_return_ratio",)),
        ("episodes that succeed", percent, ("success_share",)),
        ("median time to success [s]", number, ("median_seconds",)),
        ("time per decision over the search's", short, ("time_ratio_to_search",)),
        ("table [MB]", number, ("details", "megabytes")),
    ]
    rows = []
    for policy in ("boxer", "boxer_crowd", "boxer_cmu"):
        for behaviour, label in (("approach", "`approach`"), ("punch", "`punch`"), ("composition", "default")):
            cells = [results.cell(shown, "policy_quality", policy, behaviour, *keys) for _, shown, keys in columns]
            rows.append([f"`{policy}`", label, *cells])
    return results.table(["policy", "behaviour", *(name for name, _, _ in columns)], rows, "policy_quality")


def transitions(results: Results) -> list[str]:
    """Return how well a classifier distinguishes transitions from captured motion."""
    groups = {"made": "made in a brawl", "apart": "0.5 s from others", "every": "of the whole graph"}
    kinds = {
        "ours": "as exported",
        "crossfade": "cross-fade of 0.4 s",
        "hard": "no blend",
        "motions alone": "no blend, the moment itself left out",
    }
    columns = [("boxer", group) for group in (*groups, "falls", "rests")] + [("boxer_cmu", group) for group in groups]
    labels = {**groups, "falls": "into falls and staggers and out of them", "rests": "of rests"}
    header = ["AUC, 0.5 is guessing", *(f"`{policy}`: {labels[group]}" for policy, group in columns)]
    rows = [
        [label, *(results.cell(number, "motion_quality", policy, group, kind, "auc") for policy, group in columns)]
        for kind, label in kinds.items()
    ]
    return results.table(header, rows, "motion_quality")


SIDES = ("shown", "captured")
TWO = ("boxer", "boxer_cmu")


def _pair(results: Results, policy: str, *keys: str) -> str:
    """Return a figure of shown motion and, in brackets, that of the capture behind it."""
    own, theirs = (results.cell(fixed, "motion_quality", policy, *keys, side) for side in SIDES)
    return own if own == theirs == NOT_MEASURED else f"{own} ({theirs})"


def decisions(results: Results) -> list[str]:
    """Return how well classifiers distinguish transitions from other decisions, beside the capture behind them."""
    rows = []
    for group, words in (((), ""), (("unmatched",), ", any decisions")):
        for window, label in (("400_ms", "0.4 s"), ("800_ms", "0.8 s")):
            for model in ("logistic", "trees", "boosting"):
                cells = []
                for policy in TWO:
                    keys = ("motion_quality", policy, "decisions", window, *group)
                    own, theirs = (results.cell(fixed, *keys, side, model) for side in SIDES)
                    cells.append(own if own == theirs == NOT_MEASURED else f"{own} ({theirs})")
                rows.append([f"{model}, windows of {label}{words}", *cells])
    for part in ("legs", "trunk", "arms", "head"):
        for kind in ("velocity", "acceleration", "jerk"):
            figures = ("decisions", "400_ms", "parts", part, kind)
            rows.append([f"{part}, {kind} alone", *(_pair(results, policy, *figures) for policy in TWO)])
    return results.table(["AUC (of the capture behind)", *(f"`{policy}`" for policy in TWO)], rows, "motion_quality")


def smoothness(results: Results) -> list[str]:
    """Return how often shown motion exceeds the accelerations of its capture, beside the capture behind it."""
    rows = []
    for group in ("near_transitions", "near_strikes", "elsewhere"):
        for part in ("legs", "trunk", "arms", "head"):
            for kind, label in (("acceleration", "positions"), ("rotation", "rotations"), ("joint", "joints")):
                keys = ("smoothness", group, part, kind)
                cells = [_pair(results, policy, *keys) for policy in TWO]
                rows.append([f"{group.replace('_', ' ')}: {part}, {label}", *cells])
    for key, label in (
        ("jumps_per_minute", "one-frame jumps of joints per minute"),
        ("pelvis_drops_per_minute", "drops of the pelvis per minute"),
    ):
        rows.append([label, *(_pair(results, policy, "smoothness", key) for policy in TWO)])
    header = ["per mille of frames (of the capture behind)", *(f"`{policy}`" for policy in TWO)]
    return results.table(header, rows, "motion_quality")


def poses(results: Results) -> list[str]:
    """Return what an independent reader measures in exported BVH files."""
    scenes = ("brawl_30", "brawl_30_cmu", "armies_200")
    centimetres, millimetres = scaled(100.0, shown=fixed), scaled(1000.0, shown=fixed)
    rows: list[tuple[str, Format, tuple[str, ...]]] = [
        ("fist from what it hits, median [cm]", centimetres, ("fists", "gap", "median")),
        ("the same, 95th percentile [cm]", centimetres, ("fists", "gap", "p95")),
        ("the same, greatest [cm]", centimetres, ("fists", "gap", "greatest")),
        ("fists further than 2 cm from what they hit", percent, ("fists", "beyond_2_cm")),
        ("missed strikes whose fist is inside the body", percent, ("fists", "buried")),
        ("time with overlapping bodies, discs of 0.2 m", percent, ("overlap", "discs")),
        ("time with overlapping torsos", percent, ("overlap", "torsos")),
        ("time deeper than 6 cm in another body, by `inspect`", percent, ("inspect", "penetration_share")),
        ("the same, arms included", percent, ("inspect", "penetration_share_with_arms")),
        ("slide of planted feet, median [m/s]", number, ("feet", "slide", "median")),
        ("the same in the captured motion [m/s]", number, ("feet", "slide_of_all_the_capture", "median")),
        ("slide of planted feet, 95th percentile [m/s]", number, ("feet", "slide", "p95")),
        ("the same in the captured motion [m/s]", number, ("feet", "slide_of_all_the_capture", "p95")),
        ("lowest sole [mm]", millimetres, ("feet", "lowest_sole")),
        ("time with knees past straight", percent, ("hinges", "knees", "past_straight")),
        ("the same in the captured motion", percent, ("hinges", "knees", "past_straight_of_the_capture")),
        ("time with elbows past straight", percent, ("hinges", "elbows", "past_straight")),
        ("the same in the captured motion", percent, ("hinges", "elbows", "past_straight_of_the_capture")),
        ("joints below the head off the captured motion away from transitions, strikes and others [mm]", millimetres,
         ("undisturbed", "greatest_gap")),
        ("classifier of transitions against other decisions, AUC", number, ("transition_classifier", "auc")),
        ("the same on the captured motion behind them, AUC", number, ("transition_classifier", "auc_of_content")),
        ("transitions per second per avatar", number, ("transitions_per_second",)),
    ]  # fmt: skip
    cells = [[label, *(results.cell(shown, "exported", name, *keys) for name in scenes)] for label, shown, keys in rows]
    return results.table(["", *(f"`{name}`" for name in scenes)], cells, "exported")


def contact(results: Results) -> list[str]:
    """Return what an independent reader measures of contact, reactions and variety, and what is aimed at."""
    scenes, rows = ("brawl_30", "brawl_30_cmu"), []
    for measure in MEASURES:
        cells, text_of = [], partial(shown, unit=measure.unit)
        for scene in scenes:
            found = results.get("exported", scene, *measure.keys)
            captured = results.get("exported", scene, *measure.source) if measure.source else None
            text = cell(text_of, found)
            numbers = [None if value is MISSING else value for value in (found, captured)]
            cells.append(text if measure.met(scene, *numbers) else f"**{text}**")
            cells.append(cell(text_of, captured) if measure.source else "")
        own, other = (measure.goal(scene) for scene in scenes)
        rows.append([measure.label, *cells, own if own == other else f"{own}; `brawl_30_cmu`: {other}"])
    header = ["", *(name for scene in scenes for name in (f"`{scene}`", "its source")), "goal"]
    return results.table(header, rows, "exported")


def blows(results: Results) -> list[str]:
    """Return what blows do over seeds, the mean and the worst, beside what is aimed at."""
    rows = []
    for measure in BLOWS:
        cells, text_of = [], partial(shown, unit=measure.unit)
        for scene in BLOW_SCENES:
            mean, worst = (results.get("blows", scene, blow_key(measure), which) for which in ("mean", "worst"))
            text = f"{cell(text_of, mean)} / {cell(text_of, worst)}"
            cells.append(text if mean is MISSING or is_met(measure, scene, mean, worst) else f"**{text}**")
        rows.append([measure.label, *cells, measure.goal("")])
    header = ["mean of the seeds / worst", *(f"`{scene}`" for scene in BLOW_SCENES), "goal"]
    return results.table(header, rows, "blows")


def consequences(results: Results) -> list[str]:
    """Return what follows knock-downs, and what fills breaks, beside what is aimed at."""
    scenes = ("brawl_last_standing", "bout")

    def figure(scene: str, key: str, goal: Goal) -> str:
        value = results.get("consequences", scene, key)
        is_count = goal.most == 0.0 or goal.least > 1.0
        text = cell(whole if is_count else percent, value)
        return text if value is MISSING or value is None or goal.met(value) else f"**{text}**"

    rows = [
        [label, *(figure(scene, key, goal) for scene in scenes), "", str(goal)]
        for key, (label, goal) in CONSEQUENCES.items()
    ]
    rows += [
        [label, "", "", figure("bout, breaks", key, goal), str(goal)] for key, (label, goal) in BREAK_GOALS.items()
    ]
    header = ["", *(f"`{scene}`" for scene in scenes), "`bout`, breaks", "goal"]
    return results.table(header, rows, "consequences")


def performer(results: Results) -> list[str]:
    """Return the motion of the embedded performer beside a captured boxer; 2 and 4 are places in ``QUANTILES``."""
    rows = []
    for name in (
        "fist speed, strikes [m/s]", "pelvis speed [m/s]", "step length [m]", "pelvis height [height]",
        "trunk lean [rad]", "elbow fold [rad]", "elbow speed [rad/s]", "knee speed [rad/s]",
    ):  # fmt: skip
        cells = [results.cell(number, "performer", who, name, row) for who in ("performer", "capture") for row in "24"]
        rows.append([name, *cells])
    header = ["", "performer, median", "95th percentile", "captured boxer, median", "95th percentile"]
    return results.table(header, rows, "performer")


def detectors(results: Results) -> list[str]:
    """Return how well contacts, strikes and falls are found in performed motion, whose truth is known."""
    kinds = [
        (kind, *(results.cell(number, "performer", "falls", "performer", key) for key in (f"{kind}_found", kind)))
        for kind in ("falls", "staggers")
    ]
    rows = [
        ["foot contacts, F1", results.cell(number, "performer", "detectors", "contacts_f1")],
        ["strikes, precision", results.cell(number, "performer", "detectors", "strike_precision")],
        ["strikes, recall", results.cell(number, "performer", "detectors", "strike_recall")],
        ["cells of the paper's punch grid in which a strike lands",
         results.cell(percent, "performer", "coverage", "at_the_strike")],
        ["the same within half a second", results.cell(percent, "performer", "coverage", "half_a_second_before")],
        ["strikes per minute of motion", results.cell(number, "performer", "strikes_per_minute")],
        *([f"{kind} found, of those performed", f"{found} of {count}"] for kind, found, count in kinds),
        ["falls and staggers found that are none, an hour",
         results.cell(number, "performer", "falls", "performer", "false_an_hour")],
        ["falls and staggers found in capture of boxing and locomotion",
         results.cell(number, "performer", "falls", "capture", "found")],
    ]  # fmt: skip
    return results.table(["", "measured"], rows, "performer")


CAMERA_GOAL = 0.8
"""Share of strikes that the camera is to show."""


def cameras(results: Results) -> list[str]:
    """Return how much cameras show of strikes that land, and how calm the camera is; bold where the goal is missed."""
    rows = []
    for scene in ("duel", "bout"):
        for camera in ("auto", "side"):
            seen = results.cell(percent, "cameras", scene, camera, "seen_share")
            share = results.get("cameras", scene, camera, "seen_share")
            is_missed = camera == "auto" and isinstance(share, float) and share < CAMERA_GOAL
            rows.append([
                f"`{scene}`, `{camera}`",
                f"**{seen}**" if is_missed else seen,
                *(results.cell(percent, "cameras", scene, camera, key) for key in ("glove_share", "face_share")),
                *(results.cell(number, "cameras", scene, key) if camera == "auto" else ""
                  for key in ("cuts_per_minute", "turn_median", "turn_99")),
            ])  # fmt: skip
    header = [
        "",
        "both are seen",
        "glove",
        "face",
        "cuts per minute",
        "turns [degrees/s], median",
        "in one of 100 frames",
    ]
    return results.table(header, rows, "cameras")


QUALITY_TABLES: dict[str, Callable[[Results], list[str]]] = {
    "scenes": scenes,
    "crowds": crowds,
    "ring": ring,
    **FIGHT_TABLES,
    **FALL_TABLES,
    "policies": policies,
    "transitions": transitions,
    "decisions": decisions,
    "smoothness": smoothness,
    "cameras": cameras,
    "poses": poses,
    "blows": blows,
    "consequences": consequences,
    "contact": contact,
    "performer": performer,
    "detectors": detectors,
}
