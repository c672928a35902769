"""Timings are honest: compilation is no part of control, stages add up, and profiles come to a verdict."""

import csv
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from time import sleep

import numba
import pytest
from scenes import crowdsim, write_scene

from crowdsim.compilation import ANNOUNCEMENT, watch_compilation
from crowdsim.crowd.chunk import STAGES
from crowdsim.runs.manifest import read_manifest
from crowdsim.runs.run import Clock

CROWD = [
    {"name": "all", "type": "boxer", "count": 450, "placement": {"kind": "disc", "radius": 20, "distance": 0.5}},
]
LATE = [{"kind": "add", "group": "blue", "when": {"kind": "frame", "frame": 3}}]


def fresh_kernel():
    """A kernel that has not been compiled yet."""

    @numba.njit
    def kernel(x):
        return x + 1

    return kernel


def test_compilation_is_a_stage_of_its_own_and_announced_once() -> None:
    report: list[str] = []
    seconds: dict[str, float] = {}
    with watch_compilation(report.append) as compilation:
        clock = Clock(seconds)
        clock.watch(compilation)
        for _ in range(2):
            kernel = fresh_kernel()
            assert kernel(1) == 2
            sleep(0.01)
            clock.lap("control")
        compiled = dict(seconds)
        kernel(2)
        clock.lap("control")
    fresh_kernel()(1)
    assert report == [ANNOUNCEMENT]
    assert compilation.count == 2
    assert compiled["compile"] == pytest.approx(compilation.seconds)
    assert 0.02 < compiled["control"] < compiled["compile"]
    assert seconds["compile"] == compiled["compile"]
    assert clock.total() >= sum(seconds.values()) - 1e-3


PROGRAM = """
import os
import sys
from itertools import product
from crowdsim.compilation import watch_compilation
from crowdsim.scenario.scenario import load_scenario
from crowdsim.crowd.simulation import Simulation
from crowdsim.crowd.jit_warmup import warm_up
from crowdsim.crowd.draw import draw_crowd
from crowdsim.preparation.prepare import load_policies

def times(path, profiled):
    scenario = load_scenario(path)
    crowd, search = draw_crowd(scenario, load_policies(scenario)), scenario.opponents.search
    with watch_compilation() as compilation:
        model = warm_up(crowd, search, profiled)
        ready = compilation.seconds
        simulation = Simulation(crowd, 2, search, profiled=profiled, model=model)
        for _ in range(4):
            simulation.run(2)
        simulation.close()
        print(path, profiled, ready, compilation.seconds, flush=True)

# Each in a process of its own, in which no kernel has been loaded yet.
for path, profiled in product(sys.argv[1:], (True, False)):
    child = os.fork()
    if child == 0:
        times(path, profiled)
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0, path
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs a system that forks")
def test_no_kernel_is_compiled_or_loaded_once_control_has_begun(workplace: Path) -> None:
    for scene in ("small", "late", "large", "scipy"):
        changes: dict = {"opponents": {"kind": "anyone", "search": "scipy" if scene == "scipy" else "auto"}}
        if scene in ("large", "scipy"):
            changes["groups"] = CROWD
        path = write_scene(workplace / f"{scene}.yaml", **changes)
        if scene == "late":
            text = path.read_text().replace("name: blue\n", "name: blue\n  waits: true\n")
            path.write_text(f"{text}events: {json.dumps(LATE)}\n")
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, "small.yaml", "late.yaml", "large.yaml", "scipy.yaml"],
        capture_output=True, text=True, timeout=1200, check=False,
        cwd=workplace, env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found = [line.split() for line in done.stdout.splitlines()]
    assert len({(scene, profiled) for scene, profiled, _, _ in found}) == 8
    for scene, profiled, ready, after in found:
        assert 0.0 < float(ready) == float(after), (scene, profiled)


def test_stages_of_a_run_add_up_to_its_time(workplace: Path) -> None:
    write_scene(workplace / "four.yaml", duration=2000, outputs={"bvh": {"fps": 30}})
    assert crowdsim("run", "four.yaml") == 0
    seconds = read_manifest(workplace / "output" / "four")["seconds"]
    total = seconds.pop("total")
    stages = {"policies", "prepare", "compile", "control", "take", "statistics", "export", "checksums"}
    # Checkpoints are written as often as they cost next to nothing, in a short run perhaps never.
    assert set(seconds) - {"checkpoints"} == stages
    assert 0.9 * total < sum(seconds.values()) <= total + 1e-3


@pytest.mark.slow
def test_a_first_run_announces_compilation_and_does_not_count_it_as_control(workplace: Path) -> None:
    write_scene(workplace / "four.yaml")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "NUMBA_CACHE_DIR": str(workplace / "kernels")}
    done = subprocess.run(
        [sys.executable, "-c", "from crowdsim.cli import main; main()", "run", "four.yaml"], cwd=workplace,
        env=environment, capture_output=True, text=True, timeout=1800, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    announced = [line for line in done.stderr.splitlines() if line.startswith("compiling")]
    assert len(announced) == 1
    assert re.fullmatch(r"compiling \d+ kernels, which takes about \d+ s on \d+ cores? and is done once", announced[0])
    assert re.search(r"^  compilation +\d+\.\d s, no part of control", done.stdout, re.M)
    seconds = read_manifest(workplace / "output" / "four")["seconds"]
    assert seconds["compile"] > 1.0
    assert 1000 * seconds["control"] / 40 < 1.0


def test_a_profile_ends_with_a_verdict(workplace: Path, capsys) -> None:
    write_scene(workplace / "four.yaml")
    assert crowdsim("profile", "four.yaml", "--frames", "60", "--threads", "1,2") == 0
    tables = capsys.readouterr().out.split("\n\n")
    assert [table.split("\n")[0] for table in tables] == [
        f"4 avatars, 60 control frames, device: cpu, threads: {threads}, search: direct" for threads in (1, 2)
    ]
    for table, threads in zip(tables, ("one thread", "2 threads"), strict=True):
        times = re.fullmatch(rf"([\d,]+) times real time on {threads}", table.strip().split("\n")[-1])
        assert times is not None
        assert int(times[1].replace(",", "")) > 100


def test_stages_of_a_profile_add_up_to_the_whole(workplace: Path, capsys) -> None:
    write_scene(workplace / "many.yaml", groups=[{**CROWD[0], "count": 300}], opponents={"kind": "anyone"})
    out = ("--out", "traced", "--trace")
    assert crowdsim("profile", "many.yaml", "--avatars", "300,600", "--frames", "10s", "--json", *out) == 0
    report = json.loads(capsys.readouterr().out)
    assert [profile["avatars"] for profile in report["profiles"]] == [300, 600]
    for profile in report["profiles"]:
        stages = profile["stages"]
        assert list(stages) == [*STAGES, "control"]
        parts = sum(stages[stage]["mean"] for stage in STAGES)
        assert parts == pytest.approx(stages["control"]["mean"] + stages["record"]["mean"])
        assert profile["frames"] == 150
        assert parts * 150 == pytest.approx(profile["scopes_share"] * profile["whole_milliseconds"])
        assert 0.3 < profile["scopes_share"] <= 1.0
        assert profile["times_real_time"] == pytest.approx(1000 / 15 / stages["control"]["mean"])
        assert profile["verdict"].endswith(" times real time on one thread")
    assert {path.name for path in (workplace / "traced").iterdir()} == {
        ".crowdsim-outputs.json", "profile.csv", "profile.png", "scaling.png", "trace.json",
    }  # fmt: skip
    rows = list(csv.DictReader((workplace / "traced" / "profile.csv").open()))
    assert len(rows) == 150
    for row in rows:
        parts = sum(float(row[f"{stage}_us"]) for stage in STAGES if stage != "record")
        assert float(row["control_us"]) == pytest.approx(parts, abs=0.01)


def test_a_profile_of_what_is_wrong_exits_2(workplace: Path, capsys) -> None:
    write_scene(workplace / "four.yaml")
    for arguments, message in (
        (("--avatars", "many"), "--avatars 'many': 'many' is no number, expected 1 or more, as in 30,1000,10k"),
        (("--trace",), "--trace needs a folder to write into, expected --out DIR"),
        (("--frames", "0"), "frames '0': expected a whole number of frames from 1, or seconds as in 20s"),
    ):
        assert crowdsim("profile", "four.yaml", *arguments) == 2
        assert capsys.readouterr().err == f"{message}\n"
