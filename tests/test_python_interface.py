"""Python as an interface: the documentation's examples run, and takes answer questions about joints and strikes."""

import ast
import json
import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scenes import crowdsim as command_line
from scenes import scene, write_scene

import crowdsim
from crowdsim import (
    PoseSampler,
    Simulation,
    build_scenario,
    draw_crowd,
    load_policies,
    load_scenario,
    open_run,
    open_take,
    run,
)
from crowdsim.crowd.events import VARIABLES
from crowdsim.errors import CrowdsimError, OutputError, RunError, ScenarioError, TakeError
from crowdsim.runs.recorded import RecordedRun
from crowdsim.take.take import Take

ROOT = Path(__file__).parents[1]
GUIDE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
README = (ROOT / "README.md").read_text(encoding="utf-8")
METHODS = {
    Simulation: ("step",),
    RecordedRun: ("joints", "joint_names", "strikes", "export", "render"),
    PoseSampler: ("sample",),
}
"""Public methods that the guide shows."""
NOTEBOOK = json.loads((ROOT / "docs" / "python.ipynb").read_text(encoding="utf-8"))


@pytest.fixture
def stand_in(workplace: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder in which ``brawl_30`` is a fight of six for 14 s, ``boxer`` a policy soon trained."""
    monkeypatch.setenv("MPLBACKEND", "Agg")
    for name in ("tiny.yaml", "tiny"):
        (workplace / "policies" / name).rename(workplace / "policies" / name.replace("tiny", "boxer"))
    (workplace / "scenarios").mkdir()
    group = {"name": "boxers", "type": "boxer", "count": 6, "placement": {"kind": "ring", "radius": 1.5}}
    types = {"boxer": {"policy": "boxer"}}
    scene = {"name": "brawl_30", "duration": 211, "types": types, "groups": [group], "opponents": {"kind": "anyone"}}
    write_scene(workplace / "scenarios" / "brawl_30.yaml", **scene)
    return workplace


def note_calls(monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """Return the names of the public functions and methods that are called from now on."""
    called: set[str] = set()

    def noted(name: str, function: Any) -> Any:
        def call(*arguments: Any, **keywords: Any) -> Any:
            called.add(name)
            return function(*arguments, **keywords)

        return call

    for name in set(crowdsim.__all__) - {"__version__"}:
        value = getattr(crowdsim, name)
        if not (isinstance(value, type) and issubclass(value, Exception)):
            monkeypatch.setattr(crowdsim, name, noted(name, value), raising=False)
    for owner, names in METHODS.items():
        for name in names:
            monkeypatch.setattr(owner, name, noted(f"{owner.__name__}.{name}", getattr(owner, name)))
    return called


@pytest.fixture
def take(workplace: Path) -> RecordedRun:
    return run(load_scenario(write_scene(workplace / "four.yaml", duration=120)))


def execute(blocks: list[str], name: str) -> dict[str, Any]:
    """Execute blocks of code one after another in one namespace, and return it."""
    namespace: dict[str, Any] = {"__name__": "__main__"}
    for number, block in enumerate(blocks):
        exec(compile(block, f"{name}, block {number}", "exec"), namespace)
    return namespace


def test_examples_of_the_guide_run_and_call_everything_that_is_public(
    stand_in: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    swept = ("--seeds", "1:3", "--set", "duration=8", "--out", "output/counts", "--jobs", "1", "--quiet")
    assert command_line("batch", "brawl_30", *swept) == 0
    called = note_calls(monkeypatch)
    report = execute(re.findall(r"```python\n(.*?)```", GUIDE, re.DOTALL), "docs/python.md")
    public = {name for name in crowdsim.__all__ if not name.endswith(("Error", "__"))}
    methods = {f"{owner.__name__}.{name}" for owner, names in METHODS.items() for name in names}
    assert (public | methods) - called == set()
    assert report["positions"].shape == (60, 6, len(report["names"]), 3)
    assert report["rotations"].shape == (*report["positions"].shape[:3], 4)
    assert 1.2 < report["head"][1] < 2.0
    assert report["heads"].shape == (45, 6, 3)
    assert report["speed"].shape == (61,)
    assert report["counts"].sum() == len(report["landed"]) > 0
    assert (report["short"].avatar_count, report["duel"].avatar_count) == (4, 2)
    assert (report["frame"].number, report["walked"].shape) == (59, (6,))
    assert list(report["per_minute"]) == [1, 2, 3]
    assert len(set(report["per_minute"].values())) > 1
    assert report["first_second"].shape == (15, 6)
    assert (stand_in / "trajectories.png").stat().st_size > 1000
    assert [path.name for path in report["clips"]] == ["boxers_3.bvh", "avatars.csv"]
    clouds = [path.name for path in report["clouds"]]
    assert clouds == ["000000.ply", "000020.ply", "000040.ply", "avatars.csv"]
    assert report["sheet"] == [Path("pictures/contact_sheet.png")]
    assert all(path.is_file() for path in (*report["clips"], *report["clouds"], *report["sheet"]))
    assert list(report["data"].seed) == [1, 2]
    assert len(report["clip"].rotations) == 120
    printed = capsys.readouterr().out
    assert "groups[0].count: is -1, expected a whole number" in printed
    assert "opponents.kind: " in printed


def test_examples_of_the_readme_run(stand_in: Path) -> None:
    report = execute(re.findall(r"```python\n(.*?)```", README, re.DOTALL), "README.md")
    assert report["run"].x.shape == (211, 6)


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


def test_avatars_and_times_may_be_text(take: Take) -> None:
    expected = take.joints(3, 2.0)
    for avatar in ("blue_1", "blue_01", np.int64(3)):
        for times in ("2s", "2.0 s", "30", 2):
            np.testing.assert_array_equal(take.joints(avatar, times), expected)
    assert take.joint_names("red_0") == take.joint_names(0)
    several = take.joints(["red_1", 3], "1s:2s")
    assert several.shape == (15, 2, len(take.joint_names(0)), 3)
    np.testing.assert_array_equal(several[:, 1], take.joints(3, np.arange(15, 30) / 15))
    np.testing.assert_array_equal(take.joints(seconds=["2s", 3.0])[0, 3], expected)
    np.testing.assert_array_equal(take.joints("blue_1")[30], expected)
    np.testing.assert_array_equal(take.times(None), np.arange(120) / 15)
    sampled = take.sampler.sample(60, 62, 30, ["red_1", "blue_0"])[0]
    assert sampled.avatars.tolist() == [1, 2]


@pytest.mark.parametrize(
    ("avatar", "message"),
    [
        (4, "there is no avatar 4, expected 0 to 3, or its name"),
        (-1, "there is no avatar -1, expected 0 to 3, or its name"),
        ("blu_1", r"there is no avatar 'blu_1', expected a number, or red_0 to red_1, blue_0 to blue_1 \(did you mean "
         r"'blue_1'\?\)"),
        ("red_7", r"there is no avatar 'red_7', .* \(did you mean 'red_0'\?\)"),
        (1.0, "avatar 1.0 is of type float, expected a number or a name"),
        (True, "avatar True is of type bool, expected a number or a name"),
        (["red_0", "gren_0"], "there is no avatar 'gren_0'"),
    ],
)  # fmt: skip
def test_avatars_that_are_not_in_the_take_are_refused(take: Take, avatar: Any, message: str) -> None:
    with pytest.raises(TakeError, match=f"^{message}"):
        take.joints(avatar, 0.0)
    with pytest.raises(TakeError, match=f"^{message}"):
        take.sampler.sample(0, 1, 15, avatar)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([1.0, -0.1], r"-0.1 s is not in the take, expected at least 0 and less than 8 s"),
        (8.1, r"8.1 s is not in the take, expected at least 0 and less than 8 s"),
        (float("nan"), r"nan s is not in the take, expected at least 0 and less than 8 s"),
        ("120", r"8 s is not in the take, expected at least 0 and less than 8 s"),
        ("4x", "time '4x': expected seconds as in 4s, the number of a control frame, or a range as in 2s:5s"),
        (["1s", "one"], "time 'one': expected seconds as in 4s"),
        ("5s:2s", "frames '5s:2s': is empty"),
        ("5s:9s", "frames '5s:9s': there are frames 0 to 119 at 15 fps, 8 s"),
        ({}, "times are {}, expected seconds as numbers, or text as in 4s, 60 or 2s:5s"),
        ([[1.0], [1.0, 2.0]], r"times are \[\[1.0\], \[1.0, 2.0\]\], expected seconds as numbers"),
    ],
)
def test_times_that_are_not_in_the_take_are_refused(take: Take, times: Any, message: str) -> None:
    with pytest.raises(TakeError, match=f"^{message}"):
        take.joints(0, times)


def test_an_unknown_outcome_suggests_a_near_one(take: Take) -> None:
    with pytest.raises(TakeError, match=r"outcome is 'bloked', expected one of .* \(did you mean 'blocked'\?\)"):
        take.strikes(outcome="bloked")


@pytest.mark.parametrize("ended", [False, True], ids=["by its duration", "by its last event"])
@pytest.mark.parametrize("linger", [0.0, 0.5])
def test_steps_are_the_frames_of_a_run(workplace: Path, ended: bool, linger: float) -> None:
    leave = {"kind": "remove", "group": "blue", "when": {"kind": "frame", "frame": 45}}
    until = {"until": {"landed": 1}, "linger": linger} if ended else {}
    scenario = load_scenario(write_scene(workplace / "four.yaml", duration=90, events=[leave], **until))
    expected, frames = run(scenario), []
    assert expected.frame_count == 90 or ended
    with Simulation(draw_crowd(scenario, load_policies(scenario)), threads=2) as simulation:
        while not simulation.is_over:
            frames.append(simulation.step())
        with pytest.raises(RunError, match=rf"the run is over after {len(frames)} control frames, expected no step"):
            simulation.step()
    assert [frame.number for frame in frames] == list(range(expected.frame_count))
    for name in VARIABLES:
        steps = np.stack([getattr(frame, name) for frame in frames])
        assert steps.tobytes() == getattr(expected, name).tobytes()
    for name in ("attacker", "victim", "landed", "point"):
        thrown = np.concatenate([getattr(frame.events, name) for frame in frames])
        assert thrown.tobytes() == getattr(expected.events, name).tobytes()
    crowd = draw_crowd(scenario, load_policies(scenario))
    assert [frame.number for frame in Simulation(crowd)] == list(range(expected.frame_count))
    # It may stop at any time, and go on many frames at once.
    simulation = Simulation(crowd)
    first = [simulation.step() for _ in range(3)]
    rest = simulation.run(1000)
    assert len(first) + rest.frames == expected.frame_count
    assert np.concatenate([[frame.x for frame in first], rest.x]).tobytes() == expected.x.tobytes()


def test_a_crowd_is_drawn_once_for_the_take_and_the_simulation(workplace: Path) -> None:
    kind = {"policy": "tiny", "tempo": {"kind": "uniform", "minimum": 20, "maximum": 80}, "stance": {"southpaw": 0.5},
            "scale": {"kind": "normal", "deviation": 0.05}, "range": 0.2}  # fmt: skip
    scenario = load_scenario(write_scene(workplace / "four.yaml", types={"boxer": kind}))
    crowd = draw_crowd(scenario, load_policies(scenario))
    np.testing.assert_allclose(50.0 / crowd.temperaments[:, 0], crowd.cast.tempos, rtol=1e-6)
    np.testing.assert_allclose(crowd.temperaments[:, 2], crowd.cast.ranges, rtol=1e-6)
    avatars = Simulation(crowd).avatars
    np.testing.assert_array_equal(avatars.conditions["stance"], crowd.cast.stances)
    assert run(scenario).cast.tempos.tobytes() == crowd.cast.tempos.tobytes()


def test_a_crowd_needs_the_policies_of_its_scenario(workplace: Path) -> None:
    scenario = load_scenario(write_scene(workplace / "four.yaml"))
    others = [replace(policy, name="other") for policy in load_policies(scenario)]
    with pytest.raises(ScenarioError, match=r"types\.boxer\.policy: policy 'tiny' is not among those given, other; "):
        draw_crowd(scenario, others)


def test_what_is_no_scenario_or_crowd_is_refused(workplace: Path) -> None:
    scenario = load_scenario(write_scene(workplace / "four.yaml"))
    for wrong in ("four.yaml", {"name": "four"}, None):
        expected = "is of type (str|dict|NoneType), expected a scenario, as crowdsim.load_scenario gives it"
        for call in (run, load_policies, partial(crowdsim.run_to, "run"), lambda data: draw_crowd(data, [])):
            with pytest.raises(ScenarioError, match=expected):
                call(wrong)
    with pytest.raises(RunError, match=r"cannot simulate a Scenario, expected one of crowdsim\.draw_crowd"):
        Simulation(scenario)
    crowd = draw_crowd(scenario, load_policies(scenario))
    with pytest.raises(RunError, match="cannot simulate a crowd without policies, expected one of"):
        Simulation(replace(crowd, policies=()))
    with pytest.raises(ScenarioError, match=r"policy 'tiny' is not among those given, none; "):
        draw_crowd(scenario, [])


def test_scenarios_from_plain_data_are_those_of_files(workplace: Path) -> None:
    data = scene(duration="2s", seed=np.int64(3))
    data["groups"][0]["placement"]["start"] = np.array([-1.0, 0.7])
    file = load_scenario(write_scene(workplace / "four.yaml", duration="2s", seed=3))
    assert load_scenario(data) == build_scenario(**data) == load_scenario(file) == file
    del data["version"]
    assert load_scenario(data, "seed=4", frames="1s", fraction=0.5).avatar_count == 2
    assert run(load_scenario(data)).x.tobytes() == run(file).x.tobytes()
    changed = load_scenario(file, frames=7)
    assert (changed.duration, changed.seed) == (7, 3)


def test_findings_of_plain_data_are_those_of_a_file(workplace: Path) -> None:
    wrong = {"groups": [{"type": "boxr", "count": -1, "placement": {"kind": "rng"}}], "sed": 3, "duration": {1, 2}}
    with pytest.raises(ScenarioError) as caught:
        load_scenario(scene(**wrong))
    lines = str(caught.value).splitlines()
    assert lines == [str(finding) for finding in caught.value.findings]  # type: ignore[attr-defined]
    assert all(line.startswith("four: ") for line in lines)
    keys = {finding.key for finding in caught.value.findings}  # type: ignore[attr-defined]
    assert keys >= {"sed", "duration", "groups[0].type", "groups[0].count", "groups[0].placement.kind"}
    assert "four: duration: is of type set, expected what YAML can hold" in lines
    assert not any("duration" in line and "missing" in line for line in lines)
    path = write_scene(workplace / "four.yaml", **{key: wrong[key] for key in ("groups", "sed")})
    with pytest.raises(ScenarioError) as of_file:
        load_scenario(path)
    said = {line.split(": ", 1)[1] for line in str(of_file.value).splitlines()}
    assert said == {line.split(": ", 1)[1] for line in lines if not line.startswith("four: duration")}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"frames": "4x"}, "frames '4x': expected a whole number of frames from 1, or seconds as in 20s"),
        ({"frames": 2.5}, "the length is 2.5, expected control frames, or text such as '20s'"),
        ({"frames": (4.0, True)}, r"the length is \(4.0, True\), expected control frames"),
        ({"frames": 0}, "the number of control frames is 0, expected one from 1"),
        ({"frames": "99999999s"}, r"the length is 1e\+08 s, expected seconds above 0"),
        ({"seed": "x"}, "the seed is 'x', expected a whole number from 0"),
        ({"seed": 1.5}, "the seed is 1.5, expected a whole number from 0"),
        ({"fraction": "half"}, "the fraction is 'half', expected a number above 0 and up to 1"),
        ({"overrides": "seed=-1"}, "--set seed=-1: seed: is -1, expected"),
        ({"source": 5}, "the scenario is of type int, expected a file, the name of a scenario, or a mapping"),
        ({"source": {}}, "scenario: name: missing"),
    ],
)
def test_arguments_of_load_scenario_are_checked(workplace: Path, changes: dict[str, Any], message: str) -> None:
    path = write_scene(workplace / "four.yaml")
    with pytest.raises(ScenarioError, match=f"^{message}"):
        load_scenario(**{"source": path, **changes})


def test_exports_and_pictures_of_a_run_are_those_of_the_command_line(workplace: Path) -> None:
    path = write_scene(workplace / "four.yaml", duration=30)
    here = run(load_scenario(path))
    assert command_line("run", path, "--out", "run") == 0
    select = ("--avatars", "1,3", "--frames", "0:40", "--fps", "30")
    assert command_line("export", "run", "--bvh", "--ply", "--every", "8", "--points", "60", *select, "--out", "a") == 0
    draw = ("--frames", "0:2", "--size", "64x48", "--camera", "follow:3", "--png", "--out", "a")
    assert command_line("render", "run", *draw) == 0
    chosen: dict[str, Any] = {"avatars": ["blue_1", 1], "frames": (0, 40), "fps": 30, "every": 8, "points": 60}
    for source, out in ((here, "b"), (open_run("run"), "c")):
        files = source.export(["bvh", "ply"], out, **chosen)
        files += source.render(out, "0:2", "follow:blue_1", (64, 48), png=True)
        assert sorted(file.relative_to(out) for file in files) == sorted(
            file.relative_to("a") for file in Path("a").rglob("*.*") if file.suffix in (".bvh", ".csv", ".ply", ".png")
        )
        for file in files:
            assert file.read_bytes() == ("a" / file.relative_to(out)).read_bytes()
    files = open_run("run").export("bvh", avatars=0)
    assert [file.as_posix() for file in files] == ["run/bvh/red_0.bvh", "run/bvh/avatars.csv"]
    # What the command line has drawn is known, and not drawn again.
    before = {path: path.stat().st_mtime_ns for path in sorted(Path("a/frames").iterdir())}
    assert open_run("run").render("a", "0:2", "follow:3", (64, 48), png=True) == list(before)
    assert {path: path.stat().st_mtime_ns for path in before} == before


def test_exports_and_pictures_that_cannot_be_are_refused(take: RecordedRun) -> None:
    with pytest.raises(
        CrowdsimError, match=r"cannot export 'bhv', expected bvh, ply, pcd, clips, csv, glb \(did you mean 'bvh'\?\)"
    ):
        take.export("bhv", "out")
    with pytest.raises(
        OutputError, match="the run is in memory and has no folder, expected one for its files as 'out'"
    ):
        take.export("bvh")
    with pytest.raises(TakeError, match="there is no avatar 'red_9'"):
        take.export("bvh", "out", avatars="red_9")
    with pytest.raises(TakeError, match=r"frames \(1, 2, 3\): expected two numbers, or text such as 0:120 or 2s:5s"):
        take.render("out", frames=(1, 2, 3))  # type: ignore[arg-type]
    with pytest.raises(CrowdsimError, match="size '64': expected WIDTHxHEIGHT"):
        take.render("out", size="64")
    with pytest.raises(CrowdsimError, match="red_9"):
        take.render("out", camera="follow:red_9")
    assert not Path("out").exists()


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
    assert (opened.folder, opened.notes, opened.arena.tolist()) == (Path("run"), (), here.arena.tolist())
    np.testing.assert_array_equal(opened.joints(3, 2.5), here.joints(3, 2.5))
    np.testing.assert_array_equal(opened.strikes(), here.strikes())
    assert opened.joint_names(0) == here.joint_names(0)


def test_a_take_without_policies_says_what_opens_both(workplace: Path) -> None:
    crowdsim.run_to("run", load_scenario(write_scene(workplace / "four.yaml")))
    alone = open_take("run")
    assert len(alone.strikes()) >= 0
    with pytest.raises(TakeError, match=r"the take has no policies, which poses need; crowdsim.open_run opens"):
        alone.joints(0, 1.0)
