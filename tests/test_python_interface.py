"""Python as an interface: the documentation's examples run, and takes answer questions about joints and strikes."""

import ast
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import crowdsim as command_line
from scenes import write_scene

import crowdsim
from crowdsim import PoseSampler, load_scenario, open_run, open_take, run
from crowdsim.errors import TakeError
from crowdsim.take.take import Take

ROOT = Path(__file__).parents[1]
GUIDE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
README = (ROOT / "README.md").read_text(encoding="utf-8")
NOTEBOOK = json.loads((ROOT / "docs" / "python.ipynb").read_text(encoding="utf-8"))


@pytest.fixture
def stand_in(workplace: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder in which ``brawl_30`` is a fight of four for 14 s, by a policy that is quickly trained."""
    monkeypatch.setenv("MPLBACKEND", "Agg")
    (workplace / "scenarios").mkdir()
    write_scene(workplace / "scenarios" / "brawl_30.yaml", name="brawl_30", duration=211)
    return workplace


@pytest.fixture
def take(workplace: Path) -> Take:
    return run(load_scenario(write_scene(workplace / "four.yaml", duration=120)))


def execute(blocks: list[str], name: str) -> dict[str, Any]:
    """Execute blocks of code one after another in one namespace, and return it."""
    namespace: dict[str, Any] = {"__name__": "__main__"}
    for number, block in enumerate(blocks):
        exec(compile(block, f"{name}, block {number}", "exec"), namespace)
    return namespace


def test_examples_of_the_guide_run(stand_in: Path) -> None:
    report = execute(re.findall(r"```python\n(.*?)```", GUIDE, re.DOTALL), "docs/python.md")
    assert report["positions"].shape == (60, 4, len(report["names"]), 3)
    assert report["rotations"].shape == (*report["positions"].shape[:3], 4)
    assert 1.2 < report["head"][1] < 2.0
    assert report["speed"].shape == (61,)
    assert report["counts"].sum() == len(report["landed"]) > 0
    assert report["short"].avatar_count == 6
    assert list(report["per_minute"]) == [1, 2, 3]
    assert len(set(report["per_minute"].values())) > 1
    assert report["first_second"].shape == (15, 4)
    assert (stand_in / "trajectories.png").stat().st_size > 1000
    assert [path.suffix for path in (stand_in / "bvh").iterdir()] == [".bvh"]


def test_examples_of_the_readme_run(stand_in: Path) -> None:
    report = execute(re.findall(r"```python\n(.*?)```", README, re.DOTALL), "README.md")
    assert report["run"].x.shape == (211, 4)


def test_the_notebook_runs(stand_in: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cells = [cell for cell in NOTEBOOK["cells"] if cell["cell_type"] == "code"]
    report = execute(["".join(cell["source"]) for cell in cells], "docs/python.ipynb")
    assert report["positions"].shape[0] == len(report["seconds"])
    assert f"{len(report['landed'])} of {len(report['strikes'])} strikes landed" in capsys.readouterr().out


def test_the_notebook_is_valid_and_holds_no_outputs() -> None:
    assert NOTEBOOK["nbformat"] == 4
    assert NOTEBOOK["nbformat_minor"] >= 5
    assert set(NOTEBOOK) == {"cells", "metadata", "nbformat", "nbformat_minor"}
    ids = [cell["id"] for cell in NOTEBOOK["cells"]]
    assert len(set(ids)) == len(ids)
    for cell in NOTEBOOK["cells"]:
        assert cell["cell_type"] in ("markdown", "code")
        assert all(isinstance(line, str) for line in cell["source"])
        if cell["cell_type"] == "code":
            assert (cell["outputs"], cell["execution_count"]) == ([], None)
            ast.parse("".join(cell["source"]))


def test_scenarios_named_in_the_documentation_ship() -> None:
    code = GUIDE + README + "".join(line for cell in NOTEBOOK["cells"] for line in cell["source"])
    names = set(re.findall(r'load_scenario\("(\w+)"', code))
    assert names
    assert names <= {path.stem for path in (ROOT / "scenarios").glob("*.yaml")}


def test_the_guide_names_every_public_name() -> None:
    named = set(re.findall(r"`(?:crowdsim\.)?(\w+)`", GUIDE))
    assert set(crowdsim.__all__) - {"__version__"} <= named


def test_joints_are_those_of_the_pose_sampler(take: Take) -> None:
    poses = PoseSampler(take, take.policies).sample(100, 140, 60, np.array([2]))[0]
    expected = poses.joints()[0][:, 0]
    report = take.joints(avatar=2, seconds=np.arange(100, 140) / 60)
    assert report.dtype == np.float32
    np.testing.assert_allclose(report, expected, atol=1e-5)
    np.testing.assert_array_equal(take.joints(2, 120 / 60), take.joints(2, [120 / 60])[0])
    assert take.joint_names(2) == take.policies[0].database.skeleton.names


def test_joints_move_on_between_frames(take: Take) -> None:
    fine = take.joints(0, np.linspace(3.0, 4.0, 1001))
    steps = np.linalg.norm(np.diff(fine, axis=0), axis=-1)
    assert 0.0 < steps.max() < 0.02


def test_an_avatar_that_is_absent_has_no_joints(workplace: Path) -> None:
    leave = {"kind": "remove", "group": "blue", "when": {"kind": "frame", "frame": 45}}
    path = write_scene(workplace / "four.yaml", events=[leave])
    late = run(load_scenario(path, frames=75))
    absent = int(np.flatnonzero(np.asarray(late.action[-1]) < 0)[0])
    report = late.joints(absent, [1.0, 4.5])
    assert np.isfinite(report[0]).all()
    assert np.isnan(report[1]).all()


def test_avatars_and_times_that_are_not_in_the_take_are_refused(take: Take) -> None:
    with pytest.raises(TakeError, match=r"there is no avatar 4, expected 0 to 3"):
        take.joints(4, 0.0)
    with pytest.raises(TakeError, match=r"there is no avatar -1, expected 0 to 3"):
        take.joint_names(-1)
    for seconds in (-0.1, 8.1, float("nan")):
        with pytest.raises(TakeError, match=r"s is not in the take, expected 0 to 7.9\d+ s"):
            take.joints(0, [1.0, seconds])


def test_strikes_are_a_table_in_the_order_of_time(take: Take) -> None:
    table, events = take.strikes(), take.events
    assert len(table) == len(events.frame) > 0
    assert (np.diff(table["seconds"]) >= 0.0).all()
    np.testing.assert_allclose(np.sort(np.asarray(events.frame) / take.control_rate), table["seconds"])
    row, event = table[0], int(np.argmin(events.frame))
    assert (row["attacker"], row["victim"]) == (events.attacker[event], events.victim[event])
    assert row["hand"] == ("left", "right")[events.hand[event]]
    assert row["limb"] == ("left_hand", "right_hand", "left_foot", "right_foot")[events.limb[event]]
    assert (row["x"], row["y"], row["z"]) == tuple(events.point[event])
    landed, missed = take.strikes(landed=True), take.strikes(landed=False)
    assert landed["landed"].all()
    assert not missed["landed"].any()
    assert len(landed) == np.count_nonzero(events.landed)
    assert len(landed) + len(missed) == len(table)


def test_a_run_that_is_opened_answers_as_the_one_in_memory_does(workplace: Path) -> None:
    path = write_scene(workplace / "four.yaml", duration=60)
    assert command_line("run", path, "--out", "run") == 0
    here, opened = run(load_scenario(path)), open_run("run")
    opened_take, policies, notes = opened
    assert (opened.take, opened.policies, opened.notes) == (opened_take, policies, notes)
    np.testing.assert_array_equal(opened.joints(3, 2.5), here.joints(3, 2.5))
    np.testing.assert_array_equal(opened.strikes(), here.strikes())
    assert opened.joint_names(0) == here.joint_names(0)


def test_a_take_without_policies_says_what_opens_both(workplace: Path) -> None:
    crowdsim.run_to("run", load_scenario(write_scene(workplace / "four.yaml")))
    alone = open_take("run")
    assert len(alone.strikes()) >= 0
    with pytest.raises(TakeError, match=r"the take has no policies, which poses need; crowdsim.open_run opens"):
        alone.joints(0, 1.0)
