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

ROOT = Path(__file__).parents[1]
SCRIPTS = sorted(path for path in (ROOT / "benchmarks").glob("*.py") if not path.stem.startswith("_"))
BENCHMARKS = [path for path in SCRIPTS if path.stem != "run_all"]
SECONDS = 900

# Keys that checks rely on, at any depth.
KEYS = {
    "control": [
        *(f"brawl_30.{name}" for name in ("milliseconds", "ratio_to_ckdtree")),
        *(f"scale.{kind}.ns_per_avatar_frame_{size}" for kind in ("spread", "clustered", "armies")
          for size in ("10k", "100k", "1m")),
        "million_frame_milliseconds", "jupedsim.ratio_100k", "decision.ratio_to_motion_matching",
    ],
    "render": ["fps.30", "fps.1000", "fps.10000", "open3d.fps_30", "memory.growth_mib"],
    "training": [
        "value_iteration.ratio_to_quantecon_1t", "value_iteration.ratio_to_quantecon_2t",
        "value_iteration.seconds_both_tables", "q_learning.seconds_both_tables", "q_learning.return_ratio",
    ],
    "scenes": [
        f"{scene}.{key}" for scene in ("brawl_30", "brawl_30_cmu", "crowd_1m", "ring_8")
        for key in ("first_landed_seconds", "thrown_per_minute", "landed_per_minute", "overlap_share")
    ],
    "fights": [f"{scene}.{how}.strict" for scene in ("brawl_30", "brawl_30_cmu") for how in ("learned", "random")],
    "exported": [f"{scene}.inspect.strikes_landed" for scene in ("brawl_30", "brawl_30_cmu", "armies_200")],
    "motion_quality": [
        f"{policy}.{group}.{kind}.auc" for policy in ("boxer", "boxer_cmu") for group in ("made", "apart", "every")
        for kind in ("ours", "crossfade", "hard", "motions alone")
    ],
    "kinematics": ["times_faster_than_upc_pymotion", "inverse_limbs_per_s.crowdsim, 1 thread"],
    "poses": [f"{name}.poses_per_s" for name in ("threads_1", "threads_2", "crowd_of_10000_by_8_frames")],
}  # fmt: skip


def leaf(told: Any, dotted: str) -> Any:
    for key in dotted.split("."):
        assert key in told, dotted
        told = told[key]
    return told


def stem(path: Path) -> str:
    return path.stem


@pytest.mark.slow
@pytest.mark.parametrize("path", BENCHMARKS, ids=stem)
def test_a_quick_benchmark_runs_and_has_its_keys(path: Path, tmp_path: Path) -> None:
    environment = {key: value for key, value in os.environ.items() if key != "CROWDSIM_MOCAP"}
    command = [sys.executable, str(path), "--quick", "--json"]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=SECONDS, check=False, cwd=tmp_path, env=environment
    )
    missing = re.search(r"No module named '(?!crowdsim)([\w.]+)'", done.stderr)
    if done.returncode and missing and os.environ.get("CI") != "true":
        pytest.skip(f"{missing[1]} is not installed; the extra `bench` has it")
    assert done.returncode == 0, done.stderr[-3000:]
    told = json.loads(done.stdout)
    assert told
    for dotted in KEYS.get(path.stem, []):
        leaf(told, dotted)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("path", SCRIPTS, ids=stem)
def test_every_benchmark_has_a_quick_run_and_json(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert 'add_argument("--json"' in text
    assert re.search(r'add_argument\(\s*"--quick"', text)


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


def test_results_say_what_was_measured_when_and_on_what(
    run_all: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(run_all, "RESULTS", tmp_path / "results.json")
    monkeypatch.setattr(run_all, "run", lambda name, quick: {"seconds": 1.0, "results": {"a": {"b": 2.5}}})
    call(run_all, monkeypatch)
    told = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    assert (told["format"], told["version"], told["quick"]) == ("crowdsim-benchmarks", 1, False)
    assert told["commit"] is None or re.fullmatch(r"[0-9a-f]{40}(-dirty)?", told["commit"])
    assert datetime.fromisoformat(told["date"]).tzinfo is not None
    assert set(told["machine"]) == {"processor", "architecture", "cores", "memory_gib", "system"}
    assert told["machine"]["cores"] >= 1
    assert {"python", "numpy", "numba"} <= set(told["versions"])
    assert list(told["benchmarks"]) == [path.stem for path in BENCHMARKS]
    assert "| control | a.b | 2.5 |" in capsys.readouterr().out


def test_only_full_results_are_written_unasked(
    run_all: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(run_all, "RESULTS", tmp_path / "results.json")
    monkeypatch.setattr(run_all, "run", lambda name, quick: {"seconds": 1.0, "results": {"quick": quick}})
    call(run_all, monkeypatch, "--quick")
    call(run_all, monkeypatch, "bvh", "--json", "--quick")
    assert list(tmp_path.iterdir()) == []
    out = capsys.readouterr().out
    assert json.loads(out[out.index("{") :])["benchmarks"] == {"bvh": {"seconds": 1.0, "results": {"quick": True}}}
    call(run_all, monkeypatch, "bvh", "--quick", "--out", str(tmp_path / "asked.json"))
    assert [path.name for path in tmp_path.iterdir()] == ["asked.json"]


def test_a_benchmark_that_fails_is_reported_and_fails_the_run(
    run_all: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(run_all, "RESULTS", tmp_path / "results.json")
    monkeypatch.setattr(run_all, "run", lambda name, quick: {"failed": "ValueError: no"})
    with pytest.raises(SystemExit) as caught:
        call(run_all, monkeypatch)
    assert caught.value.code == 1
    assert "| bvh | failed | ValueError: no |" in capsys.readouterr().out
    assert (tmp_path / "results.json").exists()
