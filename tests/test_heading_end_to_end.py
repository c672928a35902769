"""A recipe whose behaviours see which way their target faces: trained, packed, inspected, plotted and run."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scenes import crowdsim, write_scene

import crowdsim as package
from crowdsim.policy import bundle
from crowdsim.training.packing import pack_policy, unpack_policy

TINY = (Path(__file__).parent / "tiny_policy.yaml").read_text(encoding="utf-8")
RECIPE = TINY.replace("bearing: {count: 8}", "bearing: {count: 8}\n      heading: {count: 5}").replace(
    "    rewards:\n      - {kind: strike", "    lookup: q\n    rewards:\n      - {kind: strike"
)


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A working folder with the trained policy ``tiny``, whose grids have a heading, in bytes."""
    folder = tmp_path_factory.mktemp("heading")
    (folder / "policies").mkdir()
    (folder / "policies" / "tiny.yaml").write_text(f"{RECIPE}precision: int8\n", encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert crowdsim("train", "tiny", "--threads", "1") == 0
    return folder


@pytest.fixture
def inside(project: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(project)
    return project


def test_the_bundle_names_the_axis_and_unpacks_as_it_was_packed(inside: Path, tmp_path: Path) -> None:
    policy = bundle.load_policy("policies/tiny")
    names = [[axis.name for axis in behaviour.grid.axes] for behaviour in policy.behaviours]
    assert names == [["distance", "bearing", "heading"], ["distance", "bearing", "height", "heading"]]
    assert all(behaviour.grid.axes[-1].wraps for behaviour in policy.behaviours)
    pack_policy(Path("policies/tiny"), tmp_path / "packed")
    unpack_policy(tmp_path / "packed" / "tiny.json", tmp_path / "unpacked")
    for path in Path("policies/tiny").iterdir():
        assert (tmp_path / "unpacked" / path.name).read_bytes() == path.read_bytes()


def test_it_is_inspected_and_plotted(inside: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert crowdsim("inspect", "policies/tiny", "--json") == 0
    figures = json.loads(capsys.readouterr().out)
    assert [axis["name"] for axis in figures["behaviours"]["punch"]["axes"]][-1] == "heading"
    assert figures["behaviours"]["approach"]["success"]["share"] > 0.9
    assert crowdsim("inspect", "policies/tiny", "--plots", "plots") == 0
    assert "heading all around in steps of 72 degrees" in capsys.readouterr().out
    assert Path("plots/values_punch.png").stat().st_size > 10_000


def test_a_scenario_runs_with_it_and_strikes_land(inside: Path) -> None:
    assert crowdsim("run", write_scene(inside / "four.yaml"), "--out", "run", "--frames", "150", "--quiet") == 0
    assert np.asarray(package.open_run("run").take.events.landed).any()
