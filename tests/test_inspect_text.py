"""What `inspect` prints for people: sentences and units, rounded figures, ratings against the capture."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from falling import falling_policy
from scenes import crowdsim, write_scene

from crowdsim.commands.capture_text import capture_lines
from crowdsim.commands.policy_text import policy_lines
from crowdsim.motion.strikes import REASONS, Rejection
from crowdsim.policy.bundle import write_bundle
from crowdsim.take.figures_text import count, length, number, percent, rating, section, speed, time
from crowdsim.take.run_text import run_lines

KEYS_OF_A_RUN = (
    "avatars control_frames seconds strikes_thrown strikes_landed strikes_blocked strikes_evaded strikes_missed "
    "hits_per_minute_per_avatar overlap_share "
    "foot_slide_median foot_slide_95 transition_jump_ratio opponent_changes transitions_per_second control_seconds "
    "wall_seconds first_landed_seconds out_of_reach_share stuck_avatars thrown_per_minute landed_per_minute "
    "least_landed_per_minute landed_share blocked_share evaded_share air_share turned_away_share distance_median "
    "penetration_share penetration_share_with_arms penetration_deepest penetrations_per_minute "
    "repeated_second_per_minute same_source_share same_strike_share stillness_share stillness_share_captured "
    "hits_from_behind_share step_after_hit thrown_per_minute_spread landed_per_minute_spread distance_spread "
    "scale_spread girth_spread legs_spread arms_spread tempo_spread aggression_spread range_spread orthodox southpaws "
    "stance_share"
).split()


NO_OUTCOMES = {"strikes_blocked": 0, "strikes_evaded": 0, "strikes_missed": 0}


def no_data(text: str) -> bool:
    """Whether a text has no dict, list or other repr in it, and no number of more than four digits after a dot."""
    return not re.search(r"[{}\[\]]|None|nan|True|False|\.\d{5}|array|\w_\w", text)


def test_figures_are_rated_against_the_captures_own():
    assert rating(0.0153, 0.0158) == "as the capture"
    assert rating(1.4, 1.0) == "1.40 times the capture's"
    assert rating(0.5, 1.0) == "0.50 times the capture's"
    assert rating(30.0, 1.0) == "30 times the capture's"
    assert rating(1.0, 0.0) == "the capture has none"
    assert rating(0.0, 0.0) == "as the capture"


def test_numbers_are_rounded_to_what_they_mean():
    assert [number(value) for value in (0.0, 0.015293, 1.5432, 76.33, 1234.5)] == ["0", "0.015", "1.5", "76", "1,234"]
    assert [length(0.00475), length(1.0412)] == ["0.5 cm", "1.04 m"]
    assert [speed(0.015293), speed(2.5)] == ["0.015 m/s", "2.5 m/s"]
    assert [time(value) for value in (0.0048, 0.68, 3.4, 44.3, 90.74)] == [
        "4.8 ms", "0.68 s", "3.4 s", "44.3 s", "1 min 31 s",
    ]  # fmt: skip
    assert [percent(value) for value in (0.0, 0.0015, 0.0567, 1.0)] == ["none", "0.15 %", "5.7 %", "100.0 %"]
    assert [count(1, "frame"), count(2000, "frame"), count(2, "entry", "entries")] == [
        "1 frame", "2,000 frames", "2 entries",
    ]  # fmt: skip


def test_labels_of_a_section_are_aligned_and_figures_that_there_are_not_are_left_out():
    assert section("Run", [("a", "1 m"), ("long", "2 m"), ("none", None)]) == [
        "  Run",
        "    a     1 m",
        "    long  2 m",
    ]
    assert section("Run", [("none", None)]) == []


@pytest.fixture
def run(workplace: Path) -> Path:
    write_scene(workplace / "four.yaml", duration=200)
    assert crowdsim("run", "four.yaml", "--out", "run", "--quiet") == 0
    return workplace / "run"


def test_a_run_is_described_in_words_with_units_and_rated(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert crowdsim("inspect", "run", "--quiet") == 0
    printed = capsys.readouterr().out
    path, text = printed.split("\n", 1)
    assert path == "run"
    assert no_data(text)
    assert "    length              200 control frames, 13.3 s\n" in text
    rated = r"(as the capture|\d\.\d\d times the capture's)"
    assert re.search(rf"planted feet slide  at 0\.\d{{3}} m/s \(median\): {rated}, 0\.\d{{3}} m/s", text)
    assert re.search(rf"thrown +\d+, \d+(\.\d)? per avatar per minute: {rated}, \d+", text)
    assert re.search(rf"joints accelerate   {rated}, around transitions", text)
    assert crowdsim("inspect", "run", "--json") == 0
    figures = json.loads(capsys.readouterr().out)
    assert set(KEYS_OF_A_RUN) <= set(figures)
    assert figures["thrown_per_minute_captured"] > 0.0


def test_a_run_of_which_little_can_be_measured_is_reported_as_such() -> None:
    figures = dict.fromkeys([*KEYS_OF_A_RUN, "thrown_per_minute_captured", "fists_off_share", "fist_gap_median"])
    figures |= dict.fromkeys(["fist_gap_most", "foot_slide_median_captured", "foot_slide_95_captured"])
    figures |= {"avatars": 1, "control_frames": 1, "seconds": 0.0, "strikes_thrown": 0, "strikes_landed": 0}
    figures |= NO_OUTCOMES
    lines = run_lines(figures)
    assert no_data("\n".join(lines))
    assert "    first landed  never" in lines
    assert "    not measured  no avatar has an opponent then, or the run ends before" in lines


def test_avatars_are_described_by_what_differs_among_them():
    figures = dict.fromkeys([*KEYS_OF_A_RUN, "thrown_per_minute_captured", "fists_off_share", "fist_gap_median"])
    figures |= dict.fromkeys(["fist_gap_most", "foot_slide_median_captured", "foot_slide_95_captured"])
    figures |= {"avatars": 30, "control_frames": 10, "seconds": 1.0, "strikes_thrown": 0, "strikes_landed": 0}
    figures |= NO_OUTCOMES
    keys = ("scale", "girth", "legs", "arms", "tempo", "aggression", "range")
    alike = {f"{key}_spread": [1.0, 1.0, 1.0] for key in keys}
    assert not any("skeleton's" in line for line in run_lines({**figures, **alike}))
    different = {**alike, "scale_spread": [0.95, 1.0, 1.04], "girth_spread": [0.9, 1.02, 1.15]}
    different |= {"arms_spread": [0.97, 1.0, 1.03], "stance_share": 0.971}
    lines = run_lines({**figures, **different, "orthodox": 24, "southpaws": 6})
    said = [line.strip() for line in lines]
    assert any(line.endswith("1.00 times the skeleton's (median), 0.950 to 1.04 for 8 of 10 avatars") for line in said)
    assert any(line.startswith("arms") and "0.970 to 1.03" in line for line in said)
    assert not any(line.startswith("legs") for line in said)
    assert any(line.startswith("girth") and "0.900 to 1.15 for 8 of 10 avatars" in line for line in said)
    kept = "24 orthodox, 6 southpaws; the foot of their stance leads for 97.1 % of the time in which one does"
    assert any(line.endswith(kept) for line in said)
    assert no_data("\n".join(lines))


def test_avatars_are_compared_by_what_eight_of_ten_do() -> None:
    figures = dict.fromkeys([*KEYS_OF_A_RUN, "thrown_per_minute_captured", "fists_off_share", "fist_gap_median"])
    figures |= dict.fromkeys(["fist_gap_most", "foot_slide_median_captured", "foot_slide_95_captured"])
    figures |= {"avatars": 9, "control_frames": 1, "seconds": 0.0, "strikes_thrown": 0, "strikes_landed": 0}
    figures |= NO_OUTCOMES
    assert "  Avatars compared while they fight, from 10 s on" not in run_lines(figures)
    figures |= {"thrown_per_minute_spread": [20.0, 31.25, 44.0], "landed_per_minute_spread": [6.1, 9.0, 12.0]}
    lines = run_lines({**figures, "distance_spread": [0.931, 1.0, 1.108]})
    assert lines[lines.index("  Avatars compared while they fight, from 10 s on") + 1 :][:3] == [
        "    strikes thrown  31 per minute (median), 20 to 44 for 8 of 10 avatars",
        "    strikes landed  9.0 per minute (median), 6.1 to 12 for 8 of 10 avatars",
        "    distance        1.00 m (median), 0.931 to 1.11 for 8 of 10 avatars",
    ]


def test_penetration_is_stated_with_its_depth_and_with_arms() -> None:
    figures = dict.fromkeys([*KEYS_OF_A_RUN, "thrown_per_minute_captured", "foot_slide_median_captured"])
    figures |= dict.fromkeys(["foot_slide_95_captured", "fists_off_share", "fist_gap_median", "fist_gap_most"])
    figures |= {"avatars": 2, "control_frames": 9, "seconds": 1.0, "strikes_thrown": 0, "strikes_landed": 0}
    figures |= NO_OUTCOMES
    figures |= {"penetration_share": 0.004, "penetration_share_with_arms": 0.13, "penetration_deepest": 0.14}
    text = "\n".join(run_lines(figures))
    assert "0.40 % of the time of all avatars deeper than 6.0 cm, 14.0 cm (deepest)" in text
    assert "13.0 % of that time with arms" in text


def test_variety_and_how_hits_come_are_stated() -> None:
    figures = dict.fromkeys([*KEYS_OF_A_RUN, "thrown_per_minute_captured", "foot_slide_median_captured"])
    figures |= dict.fromkeys(["foot_slide_95_captured", "fists_off_share", "fist_gap_median", "fist_gap_most"])
    figures |= {"avatars": 2, "control_frames": 9, "seconds": 1.0, "strikes_thrown": 0, "strikes_landed": 0}
    figures |= NO_OUTCOMES
    figures |= {"repeated_second_per_minute": 2.6, "same_source_share": 0.097, "same_strike_share": 0.0}
    figures |= {"stillness_share": 0.214, "stillness_share_captured": 0.188}
    figures |= {"hits_from_behind_share": 0.032, "step_after_hit": 0.11}
    lines = [line.strip() for line in run_lines(figures)]
    assert "own repetition        the same moment 2.6 times per minute" in lines
    assert "others' motion        9.7 % of the time of all avatars, shown within 8 m and 2 s" in lines
    assert "same strikes at once  none of the strikes at opponents that fight back" in lines
    assert "stillness             21.4 % of the time of all avatars; 18.8 % of the captured motion" in lines
    assert "3.2 % of those that landed, from behind" in lines
    assert "victims of strong ones go back by 11.0 cm within 1.0 s" in lines


def test_fists_are_rated_by_the_distance_within_which_they_touch() -> None:
    figures = dict.fromkeys([*KEYS_OF_A_RUN, "thrown_per_minute_captured", "foot_slide_median_captured"])
    figures |= dict.fromkeys(["foot_slide_95_captured"])
    figures |= {"avatars": 2, "control_frames": 9, "seconds": 1.0, "strikes_thrown": 2, "strikes_landed": 2}
    figures |= NO_OUTCOMES
    figures |= {"fists_off_share": 0.0, "fist_gap_median": 0.001, "fist_gap_most": 0.018}
    touching = "    fists that land  all within 2 cm of what they hit; 0.1 cm (median), 1.8 cm (furthest)"
    assert touching in run_lines(figures)
    figures |= {"fists_off_share": 0.031, "fist_gap_most": 0.05}
    off = "    fists that land  3.1 % of them further than 2 cm from what they hit; 0.1 cm (median), 5.0 cm (furthest)"
    assert off in run_lines(figures)


def test_a_policy_is_described_in_words_with_units(workplace: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert crowdsim("inspect", "tiny") == 0
    printed = capsys.readouterr().out.split("\n", 1)[1]
    assert no_data(printed)
    for words in (
        "control frames, ",
        "transitions per second",
        "degrees",
        " m at ",
        "grid points",
        " kB, ",
        " s (mean)",
    ):
        assert words in printed
    assert crowdsim("inspect", "tiny", "--json") == 0
    figures = json.loads(capsys.readouterr().out)
    assert "\n".join(policy_lines(figures)) == printed.rstrip("\n")
    assert {"motion", "graph", "behaviours", "fingerprint", "fingerprints", "timings"} <= set(figures)


def test_swings_that_are_no_strikes_are_counted_by_reason() -> None:
    swing = {"seconds": 1.0, "hand": "left", "speed": 3.0, "reason": "short"}
    figures = {
        "joints": 22, "end_sites": 5, "channels": 69, "frames": 240, "fps": 60.0, "seconds": 4.0, "unit_scale": 0.01,
        "up_axis": "y", "height_m": 1.75, "roles": {}, "lead_in_frames": 0, "lost_frames": 0, "floor_m": -0.031,
        "contacts": 3, "contact_share": [0.5, 0.75],
        "strikes": 0, "strikes_by_limb": {}, "highest_fist_speed": 3.2, "strike_list": [],
        "rejected_list": [swing, swing, {**swing, "reason": "no_reach"}],
    }  # fmt: skip
    lines = capture_lines(figures)
    assert f"    fast, but no strike  1 swing: {REASONS[Rejection.NO_REACH]}" in lines
    assert f"                         2 swings: {REASONS[Rejection.SHORT]}" in lines
    assert "    floor    at a height of -3.1 cm in the file" in lines
    assert no_data("\n".join(lines))


def test_clips_that_are_used_beside_the_graph_are_no_warning() -> None:
    from crowdsim.commands.inspecting import _graph_warnings

    said = "clip {!r} drops out of the motion graph: none of its 149 frames can be reached and left again"
    kept = {"at_ease": 149, "fight": 300, "lost": 0, "at_ease~mirror": 149}
    warnings = [said.format(name) for name in ("at_ease", "lost", "at_ease~mirror")]
    figures = {"motion": {"frames_kept_by_clip": kept}, "warnings": [*warnings, "no rests: the recipe asks for them"]}
    assert _graph_warnings(figures) == [warnings[1], "no rests: the recipe asks for them"]


def test_inspect_counts_falls_staggers_and_celebrations(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    policy = falling_policy()
    monkeypatch.chdir(tmp_path)
    write_bundle(tmp_path / "falling", policy, {})
    assert crowdsim("inspect", "falling", "--json") == 0
    falls = json.loads(capsys.readouterr().out)["falls"]
    mirrored = 2 if policy.statistics["motion"]["mirrored"] else 1
    assert falls["celebrations"] * mirrored == len(policy.falls.cheer) > 0
    assert crowdsim("inspect", "falling") == 0
    assert f"{falls['celebrations']} celebrations" in capsys.readouterr().out
