"""Other outputs of a finished run are written from its take, without simulating again."""

from pathlib import Path

import pytest
from scenes import crowdsim, write_scene
from test_resuming import EVENTS, GROUPS, same_as_undisturbed
from test_runner import tree

from crowdsim.crowd.simulation import Simulation
from crowdsim.runs.manifest import read_manifest

PICTURES = "outputs.render={mp4: false, contact_sheet: 2, size: [64, 48], camera: top, marks: none}"


@pytest.mark.parametrize("keys", [{"duration": 30}, {"duration": 200, "until": {"landed": 1}, "linger": 0.5}])
def test_other_outputs_of_a_finished_run_are_written_without_simulating(
    workplace: Path, monkeypatch, capsys, keys: dict
) -> None:
    outputs = {"bvh": {}}
    write_scene(workplace / "four.yaml", outputs=outputs, groups=GROUPS, events=EVENTS, **keys)
    other = ("run", "four.yaml", "--set", "fps=24", "--set", PICTURES, "--set", "cameras={low: {kind: orbit}}")
    assert crowdsim(*other, "--out", "undisturbed") == 0
    assert crowdsim("run", "four.yaml", "--out", "run") == 0
    before = tree(workplace / "run" / "take.zarr")
    outcome = read_manifest(workplace / "run").get("outcome")
    with monkeypatch.context() as patch:
        patch.setattr(Simulation, "__init__", lambda *_: pytest.fail("simulated"))
        capsys.readouterr()
        assert crowdsim(*other, "--out", "run") == 0
        assert "only outputs differ; writing them from the take" in capsys.readouterr().err
        assert tree(workplace / "run" / "take.zarr") == before
        assert (workplace / "run" / "contact_sheet.png").exists()
        assert read_manifest(workplace / "run").get("outcome") == outcome
        assert crowdsim("verify", "run") == 0
        assert crowdsim(*other, "--out", "run") == 0
        assert "done already" in capsys.readouterr().out
    same_as_undisturbed(workplace / "run", workplace / "undisturbed")


def test_another_seed_is_another_run(workplace: Path, capsys) -> None:
    write_scene(workplace / "four.yaml", duration=10)
    assert crowdsim("run", "four.yaml", "--out", "run") == 0
    assert crowdsim("run", "four.yaml", "--out", "run", "--seed", "77", "--set", PICTURES) == 2
    assert "holds another run" in capsys.readouterr().err
    # The chunks that a take is in cannot be changed behind it.
    assert crowdsim("run", "four.yaml", "--out", "run", "--set", "outputs.take.chunk=8") == 2
