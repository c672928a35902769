"""Every benchmark runs: quickly, at tiny sizes, along the path and with the keys of a full run."""

import importlib.util
import json
import os
import re
import subprocess
import sys
from datetime import datetime
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from crowdsim.crowd.cuda.device import missing_for_cuda

ROOT = Path(__file__).parents[1]
SCRIPTS = sorted(path for path in (ROOT / "benchmarks").glob("*.py") if not path.stem.startswith("_"))
BENCHMARKS = [path for path in SCRIPTS if path.stem != "run_all"]
QUICK = [path for path in BENCHMARKS if path.stem != "compilation"]
"""Compilation is measured whole by the test of specialisations."""
SECONDS = 900

# Keys that checks rely on, at any depth.
KEYS = {
    "control": [
        *(f"brawl_30.{name}" for name in ("milliseconds", "ratio_to_ckdtree")),
        *(f"scale.{kind}.ns_per_avatar_frame_{size}" for kind in ("spread", "clustered", "armies")
          for size in ("10k", "100k", "1m")),
        "million_frame_milliseconds", "jupedsim.ratio_100k",
        *(f"crowd_1m.{name}" for name in ("milliseconds", "ratio_to_ckdtree", "worst_frame_to_median",
                                          "bytes_per_avatar", "around_to_control")),
        "decision.ratio_to_motion_matching", "reactions.ratio",
    ],
    "batch": [
        *(f"workers_{count}.{name}" for count in (1, 2) for name in ("seconds", "overhead_milliseconds")),
        "speedup", "loop_seconds_per_run",
    ],
    "render": [
        "fps.30", "fps.1000", "fps.10000", "open3d.fps_30", "memory.growth_mib",
        *(f"commands.{row}.{key}" for row in ("10000.warm", "10000.cold", "10000.many", "100000.warm", "100000.cold",
                                              "30.body", "30.capsules")
          for key in ("wall_seconds", "cpu_seconds", "peak_bytes")),
    ],
    "cuda": [
        "device",
        *(f"1000.{key}" for key in ("milliseconds", "stage_ms.choose", "cpu_2t_milliseconds", "cpu_all_milliseconds",
                                    "digest_equal")),
    ],
    "layers": [
        "avatars",
        *(f"layers.all up to {size} cm.{key}" for size in (4, 6, 12) for key in ("p99", "p99_9", "greatest")),
    ],
    "delivery": [
        "float32.seconds", "int16.seconds", "whole.bytes an avatar-frame", "whole.bytes an avatar-frame eye",
        "clips.seconds", "touches.strikes", "touches.within 2 cm",
    ],
    "training": [
        "value_iteration.ratio_to_quantecon_1t", "value_iteration.ratio_to_quantecon_2t",
        "value_iteration.seconds_both_tables", "q_learning.seconds_both_tables", "q_learning.return_ratio",
    ],
    "scenes": [
        f"{scene}.{key}" for scene in ("brawl_30", "brawl_30_cmu", "crowd_1m", "ring_8")
        for key in ("first_landed_seconds", "thrown_per_minute", "landed_per_minute", "overlap_share")
    ],
    "fights": [
        *(f"{scene}.{how}.strict" for scene in ("brawl_30", "brawl_30_cmu") for how in ("learned", "random")),
        *(f"bouts.{pair}.{key}" for pair in ("boxer.boxer", "boxer.boxer_cmu", "boxer.paper", "boxer.random")
          for key in ("won.share", "won.interval", "lost", "drawn", "landed_per_minute", "blocked_share",
                      "evaded_share", "knock_downs")),
        *(f"reaction.{scene}.{key}" for scene in ("brawl_30", "duel") for key in ("lead_seconds", "reactable_share")),
        *(f"breaks.{key}" for key in ("count", "never_share", "ease_share")),
        *(f"lying.{key}" for key in ("sunk_share", "floating_share", "trodden_share", "overlap_share")),
    ],
    "consequences": [
        "brawl_last_standing.knock_downs", "bout.knock_downs",
        *(f"bout, breaks.{key}" for key in ("breaks", "dropped", "apart", "faces", "struck_early")),
    ],
    "blows": [
        f"{scene}.{name}.{which}" for scene in ("brawl_30", "bout") for which in ("mean", "worst")
        for name in ("fists_beyond_2_cm", "strikes_landed_buried")
    ],
    "exported": [f"{scene}.inspect.strikes_landed" for scene in ("brawl_30", "brawl_30_cmu", "armies_200")],
    "motion_quality": [
        f"boxer.{group}.{kind}.auc" for group in ("made", "apart", "every")
        for kind in ("ours", "crossfade", "hard", "motions alone")
    ] + [
        f"boxer.smoothness.{group}.legs.rotation.{side}" for group in ("near_transitions", "near_strikes")
        for side in ("shown", "captured")
    ] + [f"boxer.decisions.{length}_ms.{side}.auc" for length in (400, 800) for side in ("shown", "captured")]
    + [f"boxer.falls.{key}" for key in ("ours.auc", "motion.falls.legs.joint.shown", "motion.others.jumps.shown")]
    + [f"boxer.rests.{key}" for key in ("ours.auc", "motion.rests.legs.joint.shown", "motion.others.slide_95.shown")],
    "kinematics": ["times_faster_than_upc_pymotion", "inverse_limbs_per_s.crowdsim, 1 thread"],
    "soak": [
        *(f"soak.{name}" for name in ("frames", "memory_growth", "not_finite", "lost_avatars", "stuck_avatars")),
        "checkpoints.brawl_30", "checkpoints.soak",
    ],
    "take": [
        *(f"long.{name}" for name in ("control_seconds", "writing_seconds", "writing_over_control", "files")),
        *(f"killed.{name}" for name in ("killed_after_frames", "lost_frames", "control_seconds", "identical")),
        "read.short_milliseconds", "large.writing_over_control", "large.writing_over_disk",
    ],
    "cameras": [f"{scene}.{camera}.seen_share" for scene in ("duel", "bout") for camera in ("auto", "side")],
    "view": [
        *(f"pages.{count}.{key}" for count in ("30", "1000", "10000")
          for key in ("megabytes", "posing_seconds", "seconds", "first_picture_seconds", "frame_milliseconds")),
        "pages.30.error_millimetres", "renderer",
        *(f"play.{key}" for key in ("control_milliseconds", "pose_milliseconds", "core_share", "frames_per_second")),
        "play.drag_to_picture_ms", "play.drag_to_picture_95_ms",
    ],
    "places": [f"square_{side}.{key}" for side in (12, 24) for key in ("ratio", "hidden_share", "building_seconds")],
    "poses": [f"{name}.poses_per_s" for name in ("threads_1", "threads_2", "crowd_of_10000_by_8_frames")]
    + ["reactions.ratio"],
}  # fmt: skip


MEASURED = {"commit": None, "date": "2026-01-02T03:04:05+00:00", "machine": "any"}

# What a machine without a display, or a fight of seconds, cannot give.
MAY_BE_NULL = {
    "open3d.fps_30",
    *(key for key in KEYS["scenes"] if key.endswith("first_landed_seconds")),
    *(
        key
        for key in KEYS["motion_quality"]
        if ".apart." in key or ".decisions." in key or ".falls." in key or ".rests." in key
    ),
    *(key for key in KEYS["fights"] if key.startswith("lying.")),
    *KEYS["cameras"],
    # Of Chromium, which need not be there.
    "renderer",
    *(
        key
        for key in KEYS["view"]
        if key.rpartition(".")[2]
        in (
            "first_picture_seconds",
            "frame_milliseconds",
            "error_millimetres",
            "core_share",
            "frames_per_second",
            "drag_to_picture_ms",
            "drag_to_picture_95_ms",
        )
    ),
}


def leaf(report: Any, dotted: str) -> Any:
    for key in dotted.split("."):
        assert key in report, dotted
        report = report[key]
    return report


def missing_in_tables(benchmark: str, report: dict[str, Any]) -> list[tuple[str, ...]]:
    """Figures that tables of the documentation ask for and a quick run without capture does not have."""
    sys.path.append(str(ROOT / "docs"))
    make_tables = importlib.import_module("make_tables")
    results = make_tables.Results({"benchmarks": {benchmark: {"results": report, "quick": False, **MEASURED}}})
    for tables in make_tables.PAGES.values():
        for table in tables.values():
            table(results)
    asked = [keys for keys in results.asked if keys[0] == benchmark and not results.has(*keys)]
    return [keys for keys in asked if not set(keys) & {"boxer_cmu", "capture"}]


def stem(path: Path) -> str:
    return path.stem


@pytest.mark.slow
@pytest.mark.parametrize("path", QUICK, ids=stem)
def test_a_quick_benchmark_runs_and_has_its_keys(path: Path, tmp_path: Path) -> None:
    if path.stem == "cuda" and (missing := missing_for_cuda()):
        pytest.skip(missing)
    environment = {key: value for key, value in os.environ.items() if key != "CROWDSIM_MOCAP"}
    command = [sys.executable, str(path), "--quick", "--json"]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=SECONDS, check=False, cwd=tmp_path, env=environment
    )
    missing = re.search(r"No module named '(?!crowdsim)([\w.]+)'", done.stderr)
    if done.returncode and missing and os.environ.get("CI") != "true":
        pytest.skip(f"{missing[1]} is not installed; the extra `bench` has it")
    assert done.returncode == 0, done.stderr[-3000:]
    report = json.loads(done.stdout)
    assert report
    for dotted in KEYS.get(path.stem, []):
        assert leaf(report, dotted) is not None or dotted in MAY_BE_NULL
    assert not missing_in_tables(path.stem, report)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("path", SCRIPTS, ids=stem)
def test_every_benchmark_has_a_quick_run_and_json(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    own = 'add_argument("--json"' in text and re.search(r'add_argument\(\s*"--quick"', text)
    assert own or "command_line(" in text


def test_keys_are_those_of_benchmarks() -> None:
    assert set(KEYS) <= {path.stem for path in BENCHMARKS}


@pytest.fixture
def run_all() -> ModuleType:
    specification = importlib.util.spec_from_file_location("run_all", ROOT / "benchmarks" / "run_all.py")
    assert specification is not None
    assert specification.loader is not None
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


def call(run_all: ModuleType, monkeypatch: pytest.MonkeyPatch, *arguments: str) -> None:
    monkeypatch.setattr(sys, "argv", ["run_all.py", *arguments])
    run_all.main()


def stand_in(run_all: ModuleType, monkeypatch: pytest.MonkeyPatch, outcome: dict[str, Any], path: Path) -> None:
    """Let all benchmarks end at once, and results be written elsewhere."""
    monkeypatch.setattr(run_all, "RESULTS", path)
    monkeypatch.setattr(run_all, "run", lambda name, quick: outcome)


def test_results_record_benchmark_time_and_machine(
    run_all: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stand_in(run_all, monkeypatch, {"seconds": 1.0, "results": {"a": {"b": 2.5}}}, tmp_path / "results.json")
    call(run_all, monkeypatch)
    report = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    assert (report["format"], report["version"]) == ("crowdsim-benchmarks", 2)
    assert list(report["benchmarks"]) == [path.stem for path in BENCHMARKS]
    entry = report["benchmarks"]["control"]
    assert (entry["quick"], entry["seconds"], entry["results"]) == (False, 1.0, {"a": {"b": 2.5}})
    assert entry["commit"] is None or re.fullmatch(r"[0-9a-f]{40}(-dirty)?", entry["commit"])
    assert datetime.fromisoformat(entry["date"]).tzinfo is not None
    assert re.match(r"\d+ cores?, .+", entry["machine"])
    assert {"python", "numpy", "numba"} <= set(entry["versions"])
    assert "| control | a.b | 2.5 |" in capsys.readouterr().out
    assert [path.name for path in tmp_path.iterdir()] == ["results.json"]


def test_one_benchmark_is_measured_again_and_the_others_stay(
    run_all: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "results.json"
    stand_in(run_all, monkeypatch, {"seconds": 1.0, "results": {"a": 1}}, path)
    call(run_all, monkeypatch, "scenes", "bvh")
    stand_in(run_all, monkeypatch, {"seconds": 1.0, "results": {"a": 2}}, path)
    call(run_all, monkeypatch, "scenes", "control")
    report = json.loads(path.read_text(encoding="utf-8"))["benchmarks"]
    assert {name: entry["results"]["a"] for name, entry in report.items()} == {"bvh": 1, "control": 2, "scenes": 2}


def test_only_full_results_are_written_by_default(
    run_all: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(run_all, "RESULTS", tmp_path / "results.json")
    monkeypatch.setattr(run_all, "run", lambda name, quick: {"seconds": 1.0, "results": {"quick": quick}})
    call(run_all, monkeypatch, "--quick")
    capsys.readouterr()
    call(run_all, monkeypatch, "bvh", "--json", "--quick")
    assert list(tmp_path.iterdir()) == []
    report = json.loads(capsys.readouterr().out)["benchmarks"]
    assert {name: entry["results"] for name, entry in report.items()} == {"bvh": {"quick": True}}
    call(run_all, monkeypatch, "bvh", "--quick", "--out", str(tmp_path / "asked.json"))
    assert [path.name for path in tmp_path.iterdir()] == ["asked.json"]


def test_a_quick_result_does_not_replace_a_full_one(
    run_all: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "results.json"
    stand_in(run_all, monkeypatch, {"seconds": 1.0, "results": {}}, path)
    call(run_all, monkeypatch, "bvh")
    call(run_all, monkeypatch, "bvh", "export", "--quick", "--out", str(path))
    report = json.loads(path.read_text(encoding="utf-8"))["benchmarks"]
    assert {name: entry["quick"] for name, entry in report.items()} == {"bvh": False, "export": True}


def test_a_benchmark_that_fails_is_reported_and_keeps_its_previous_entry(
    run_all: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "results.json"
    stand_in(run_all, monkeypatch, {"seconds": 1.0, "results": {"a": 1}}, path)
    call(run_all, monkeypatch, "bvh")
    before = path.read_text(encoding="utf-8")
    stand_in(run_all, monkeypatch, {"failed": "ValueError: no"}, path)
    with pytest.raises(SystemExit) as caught:
        call(run_all, monkeypatch)
    assert caught.value.code == 1
    report = capsys.readouterr()
    assert "| bvh | failed | ValueError: no |" in report.out
    assert "bvh failed: ValueError: no" in report.err
    assert path.read_text(encoding="utf-8") == before


def test_a_benchmark_that_the_machine_lacks_something_for_is_no_failure(
    run_all: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "results.json"
    stand_in(run_all, monkeypatch, {"seconds": 1.0, "results": {"a": 1}}, path)
    call(run_all, monkeypatch, "cuda")
    before = path.read_text(encoding="utf-8")
    stand_in(run_all, monkeypatch, {"not measured": "device cuda: no GPU"}, path)
    call(run_all, monkeypatch)
    report = capsys.readouterr()
    assert "| cuda | not measured | device cuda: no GPU |" in report.out
    assert "cuda not measured: device cuda: no GPU" in report.err
    assert path.read_text(encoding="utf-8") == before


def test_control_on_a_gpu_is_not_measured_where_there_is_none(run_all: ModuleType) -> None:
    missing = missing_for_cuda()
    if not missing:
        pytest.skip("this machine has a GPU")
    assert run_all.run("cuda", quick=True) == {"not measured": f"device cuda: {missing}"}


def test_results_hold_neither_paths_nor_what_is_no_number(run_all: ModuleType) -> None:
    report = {"a": [float("nan"), 1.5], "b": {"folder": "/home/me/output/brawl_30", "name": "a/b"}}
    assert run_all.portable(report) == {"a": [None, 1.5], "b": {"folder": "brawl_30", "name": "a/b"}}
