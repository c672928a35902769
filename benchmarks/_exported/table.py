"""The printed table of exported motion."""

from __future__ import annotations

from typing import Any

from _exported.goals import MEASURES, find, shown


def print_table(name: str, outcome: dict[str, Any]) -> None:
    """Print the figures of a run."""
    print(f"{name}: {outcome['avatars']} avatars, {outcome['frames']} frames")
    print(f"  {'':72} {'files':>18} {'source':>10} {'inspect':>16}  worst")
    for figure, files, source, inspected, worst in pose_rows(outcome):
        print(f"  {figure:72} {files:>18} {source:>10} {inspected:>16}  {worst}")
    print(f"  {'':72} {'files':>18} {'source':>10}  goal")
    for figure, files, source, goal in measure_rows(name, outcome):
        print(f"  {figure:72} {files:>18} {source:>10}  {goal}")
    for parts, depth in outcome["bodies"]["by_parts"].items():
        print(f"  {'time deeper than 6 cm, ' + parts:72} {shown(depth['share'], 'percent'):>18}")
    for odd in outcome["hinges"]["clips_with_backward_hinges"]:
        print(f"  the source's {odd['joint'].replace('_', ' ')} folds backward in {odd['clip']}")


def measure_rows(name: str, outcome: dict[str, Any]) -> list[tuple[str, str, str, str]]:
    """Return rows of contact, reactions and variety: figure, files, source, goal."""
    rows = []
    for measure in MEASURES:
        files, source = find(outcome, measure.keys), find(outcome, measure.source) if measure.source else None
        goal = measure.goal(name) + ("" if measure.met(name, files, source) else ", missed")
        captured = shown(source, measure.unit) if measure.source else ""
        rows.append((measure.label, shown(files, measure.unit), captured, goal))
    return rows


def _place(worst: dict[str, Any]) -> str:
    return " ".join(
        f"{key} {value:.3g}" if isinstance(value, float) else f"{key} {value}" for key, value in worst.items()
    )


def pose_rows(outcome: dict[str, Any]) -> list[tuple[str, str, str, str, str]]:
    """Rows of feet, hinges, peaks, fists and transitions: figure, files, source, ``inspect``, where the worst is."""
    own, feet_, bends = outcome["inspect"], outcome["feet"], outcome["hinges"]
    rows = []
    calm = outcome["undisturbed"]
    for words, group in (("calm frames", calm), ("others where bodies touch", calm["where_bodies_touch"])):
        if group["frames"]:
            gap = f"{1000 * group['greatest_gap']:.2f}"
            rows.append((f"joints off the source in {group['frames']} {words} [mm]", gap, "", "", ""))
    for key, name in (("median", "median"), ("p95", "95")):
        there = own[f"foot_slide_{name}"], own[f"foot_slide_{name}_captured"]
        inspected = " of ".join("-" if value is None else f"{value:.3f}" for value in there)
        rows.append(
            (f"slide of planted feet, {key} [m/s]", f"{feet_['slide'][key]:.3f}",
             f"{feet_['slide_of_all_the_capture'][key]:.3f}", inspected, "")
        )  # fmt: skip
        rows.append(
            (f"  where the source has a contact too, {key}", f"{feet_['slide_where_the_capture_stands_too'][key]:.3f}",
             f"{feet_['slide_of_the_capture_there'][key]:.3f}", "", "")
        )  # fmt: skip
    rows.append(("lowest sole [mm]", f"{1000 * feet_['lowest_sole']:.1f}",
                 f"{1000 * feet_['lowest_sole_of_the_capture']:.1f}", "", _place(feet_["worst"])))  # fmt: skip
    for name in ("knees", "elbows"):
        bend = bends[name]
        rows.append((f"{name}, least and greatest flexion [deg]", f"{bend['least']:.0f} {bend['greatest']:.0f}",
                     f"{bend['least_of_the_capture']:.0f} {bend['greatest_of_the_capture']:.0f}", "",
                     _place(bend["worst"])))  # fmt: skip
        rows.append((f"{name} past straight, of frames", f"{bend['past_straight']:.2%}",
                     f"{bend['past_straight_of_the_capture']:.2%}", "", ""))  # fmt: skip
    for kind, parts in outcome["peaks"].items():
        for part, peak in parts.items():
            rows.append((f"greatest {kind} of {part} over the source's", f"{peak['ratio']:.2f}", "1.00", "",
                         _place(peak["worst"])))  # fmt: skip
            rows.append(("  99.99 %; frames beyond it by 10 %", f"{peak['p9999']:.3g}; {peak['frames_beyond']:.3%}",
                         f"{peak['p9999_of_the_capture']:.3g}", "", ""))  # fmt: skip
    hits, bodies, apart = outcome["fists"], outcome["overlap"], outcome["transition_classifier"]
    rows.append(("strikes landed", f"{hits['landed']}", "", f"{own['strikes_landed']}", ""))
    if hits["landed"]:
        off = hits["gap"]
        rows.append(("fist off what it hits, median, 95 %, most [cm]",
                     f"{100 * off['median']:.2f} {100 * off['p95']:.2f} {100 * off['greatest']:.1f}", "", "",
                     _place(hits["worst"])))  # fmt: skip
        rows.append(("  off by more than 2 cm", f"{hits['beyond_2_cm']:.2%}", "", "", ""))
        rows.append(("  misses whose fist is in the body", f"{hits['buried']:.2%}", "", "", ""))
    rows.append(("bodies overlap: discs", f"{bodies['discs']:.3%}", "", f"{own['overlap_share']:.3%}", ""))
    rows.append(("  torsos", f"{bodies['torsos']:.3%}", "", "", _place(bodies["worst"])))
    rows.append(("  heads", f"{bodies['heads']:.3%}", "", "", ""))
    rows.append(("transitions per avatar per second", f"{outcome['transitions_per_second']:.2f}", "",
                 f"{own['transitions_per_second']:.2f}", ""))  # fmt: skip
    for words, group in (("", apart), (" whose motion is alike", apart["matched"])):
        if group["auc"] is not None and group["auc_of_content"] is not None:
            against = f"{group['transitions']} transitions against {group['others']} others{words}"
            rows.append((f"AUC of {against}", f"{group['auc']:.3f}",
                         f"{group['auc_of_content']:.3f}", "", ""))  # fmt: skip
    return rows
