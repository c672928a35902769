"""A recipe whose behaviours see more of their target than where it is: trained, packed, inspected, plotted and run."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scenes import crowdsim, write_scene

import crowdsim as package
from crowdsim.policy import bundle
from crowdsim.training.packing import pack_policy, unpack_policy
from crowdsim.training.train import train_recipe

TINY = (Path(__file__).parent / "tiny_policy.yaml").read_text(encoding="utf-8")
BEARING, STRIKE = "      bearing: {count: 8}\n", "    rewards:\n      - {kind: strike"
FURTHER = {
    "heading": (["      heading: {count: 5}\n"], ""),
    "velocity and impact": (
        ["      velocity: {count: 3}\n", "      impact: {maximum: 0.6, count: 4}\n"],
        "      - {kind: hit, weight: 2}\n",
    ),
}
SHOWN = {
    "heading": ["heading all around in steps of 72 degrees"],
    "velocity and impact": ["m/s at 3 grid points", "impact 0.00 to 0.60 s at 4 grid points"],
}


@pytest.fixture(scope="module", params=FURTHER.keys())
def trained(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """A working folder with the trained policy ``tiny``, whose grids have further axes, and which ones.

    Its values are floats as in other tests: control is compiled for each type of values anew.
    """
    folder = tmp_path_factory.mktemp("axes")
    axes, reward = FURTHER[request.param]
    recipe = TINY.replace(BEARING, BEARING + axes[0], 1)
    head, _, punch = recipe.rpartition(BEARING)
    recipe = head + BEARING + "".join(axes) + punch.replace(STRIKE, f"    lookup: q\n{STRIKE}")
    recipe = recipe.replace("      - {kind: strike", f"{reward}      - {{kind: strike")
    (folder / "policies").mkdir()
    (folder / "policies" / "tiny.yaml").write_text(recipe, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert crowdsim("train", "tiny", "--threads", "1") == 0
    return folder, request.param


@pytest.fixture
def names(trained: tuple[Path, str], monkeypatch: pytest.MonkeyPatch) -> str:
    """The axes that there are; the working folder is that of the policy."""
    monkeypatch.chdir(trained[0])
    return trained[1]


def in_bytes(folder: Path) -> Path:
    """Write the recipe for a policy in bytes into a folder."""
    recipe = Path("policies/tiny.yaml").read_text(encoding="utf-8")
    (folder / "policies").mkdir()
    (folder / "policies" / "tiny.yaml").write_text(f"{recipe}precision: int8\n", encoding="utf-8")
    return folder / "policies" / "tiny.yaml"


def test_the_bundle_names_the_axes_and_unpacks_as_it_was_packed(names: str, tmp_path: Path) -> None:
    trained = train_recipe(in_bytes(tmp_path), threads=1)[0]
    policy = bundle.load_policy(trained)
    further = names.split(" and ")
    found = [[axis.name for axis in behaviour.grid.axes] for behaviour in policy.behaviours]
    assert found == [["distance", "bearing", further[0]], ["distance", "bearing", "height", *further]]
    pack_policy(trained, tmp_path / "packed")
    unpack_policy(tmp_path / "packed" / "tiny.json", tmp_path / "unpacked")
    for path in trained.iterdir():
        assert (tmp_path / "unpacked" / path.name).read_bytes() == path.read_bytes()


def test_it_is_inspected_and_its_values_are_plotted(
    names: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Plots of the graph know nothing of axes, and are tested elsewhere.
    monkeypatch.setattr("crowdsim.graph.plots.plot_graph", lambda *_: [])
    further = names.split(" and ")
    assert crowdsim("inspect", "policies/tiny", "--json") == 0
    figures = json.loads(capsys.readouterr().out)
    assert [axis["name"] for axis in figures["behaviours"]["punch"]["axes"]][3:] == further
    assert figures["behaviours"]["approach"]["success"]["share"] > 0.9
    assert crowdsim("inspect", "policies/tiny", "--plots", tmp_path / "plots") == 0
    shown = capsys.readouterr().out
    assert all(text in shown for text in SHOWN[names])
    for name in ("values_punch", *(f"values_punch_by_{axis}" for axis in further)):
        assert (tmp_path / "plots" / f"{name}.png").stat().st_size > 10_000


def test_a_scenario_runs_with_it_and_strikes_land(names: str, tmp_path: Path) -> None:
    scene = write_scene(tmp_path / "four.yaml")
    assert crowdsim("run", scene, "--out", tmp_path / "run", "--frames", "150", "--quiet") == 0
    assert np.asarray(package.open_run(tmp_path / "run").take.events.landed).any()


@pytest.mark.slow
def test_a_policy_in_bytes_is_trained_inspected_and_run(
    names: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_bytes(tmp_path)
    monkeypatch.chdir(tmp_path)
    scene = write_scene(tmp_path / "four.yaml")
    for words in (("train", "tiny"), ("inspect", "policies/tiny"), ("run", scene, "--out", "run", "--frames", "150")):
        assert crowdsim(*words) == 0
    assert np.asarray(package.open_run("run").take.events.landed).any()
