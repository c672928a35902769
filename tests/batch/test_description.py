"""Batch files and options: what they mean, and what is wrong with them."""

import re
from pathlib import Path

import pytest
from batches import write_batch
from scenes import write_scene

from crowdsim.batch.description import batch_of_options, batch_reference, load_batch, with_overrides
from crowdsim.batch.plan import resolve
from crowdsim.errors import BatchError, CrowdsimError
from crowdsim.scenario.scenario import load_scenario

ROOT = Path(__file__).parents[2]
HEAD = "version: 1\nname: trial\nscenarios: [four.yaml]\n"


def fault(folder: Path, text: str, *more: str) -> list[str]:
    """Return what is wrong with a batch file, without the folder."""
    write_scene(folder / "four.yaml")
    (folder / "trial.yaml").write_text(HEAD + text, encoding="utf-8")
    with pytest.raises(CrowdsimError) as caught:
        resolve(load_batch(folder / "trial.yaml"))
    return str(caught.value).replace(f"{folder}/", "").splitlines()


def option_fault(*values: object) -> list[str]:
    with pytest.raises(CrowdsimError) as caught:
        resolve(batch_of_options(*values))
    return str(caught.value).splitlines()


def test_axes_are_multiplied_and_keys_of_one_axis_change_together(workplace: Path) -> None:
    axes = [{"seed": "0:3"}, {"duration": [20, 30], "groups[0].count": [1, 2]}]
    batch = load_batch(write_batch(workplace, axes=axes))
    found = [one.values for one in batch.combinations()]
    pairs = [(20, 1), (30, 2)]
    assert found == [{"seed": s, "duration": d, "groups[0].count": c} for s in range(3) for d, c in pairs]


def test_excluded_combinations_are_left_out(workplace: Path) -> None:
    axes = [{"seed": "0:4"}, {"duration": [20, 30]}]
    exclude = [{"seed": [0, 1], "duration": 30}, {"seed": 3}]
    _, combinations = resolve(load_batch(write_batch(workplace, axes=axes, exclude=exclude)))
    found = [(one.values["seed"], one.values["duration"]) for one, _ in combinations]
    assert found == [(0, 20), (1, 20), (2, 20), (2, 30)]


def test_options_describe_the_batch_that_a_file_does(workplace: Path) -> None:
    axes = [{"seed": "0:3"}, {"duration": [20, 30]}]
    file, _ = resolve(load_batch(write_batch(workplace, axes=axes)))
    options, _ = resolve(batch_of_options(["four.yaml"], "0:3", ["duration=20,30"]))
    assert list(file) == list(options)
    assert len(file) == 6


def test_the_id_of_a_run_depends_on_its_scenario_alone(workplace: Path) -> None:
    axes = [{"seed": [2, 1]}, {"duration": [20]}]
    one, _ = resolve(load_batch(write_batch(workplace, axes=axes)))
    turned = [{"duration": [20]}, {"seed": [1, 2]}]
    other, _ = resolve(load_batch(write_batch(workplace, axes=turned, outputs={"bvh": {"fps": 30}})))
    assert set(one) == set(other)
    longer, _ = resolve(load_batch(write_batch(workplace, axes=[{"seed": [1, 2]}, {"duration": [20, 21]}])))
    assert set(one) < set(longer)


def test_combinations_of_equal_scenarios_are_one_run(workplace: Path) -> None:
    runs, combinations = (
        resolve(batch_of_options(["four.yaml"], None, ["duration=20,20"])) if write_batch(workplace) else ({}, [])
    )
    assert (len(runs), len(combinations)) == (1, 2)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("axes:\n  - seed: 4\n",
         "trial.yaml:5:11: axes[0].seed: is 4, expected a list of values, or text such as 0:10 for whole numbers"),
        ("axes:\n  - seed: 4:1\n",
         "trial.yaml:5:11: axes[0].seed: is '4:1', expected a list of values, or text such as 0:10 for whole numbers"),
        ("axes:\n  - seed: [1, 2]\n    duration: [1]\n",
         "trial.yaml:6:15: axes[0].duration: has 1 values, expected 2 as seed has, since they change together"),
        ("axes:\n  - seed: [1]\n  - seed: [2]\n",
         "trial.yaml:6:5: axes[1].seed: is an axis already, see axes[0]; expected it once"),
        ("axes:\n  - outputs.bvh.fps: [1]\n",
         "trial.yaml:5:5: axes[0].outputs.bvh.fps: is the same for all runs, expected a key that changes what happens"),
        ("exclude:\n  - sed: 1\n", "trial.yaml:5:5: exclude[0].sed: is no axis, expected scenario"),
        ("axes:\n  - seed: 0:3\nexclude:\n  - seed: 3\n",
         "trial.yaml:7:11: exclude[0].seed: never is 3, expected one of its values"),
        ("axes:\n  - seed: 0:10000000\n",
         "trial.yaml:5:3: axes: ask for 10,000,000 runs, expected at most 100,000"),
        ("frames_per_task: 100\n",
         "trial.yaml:4:18: frames_per_task: is 100, expected a whole number from 240 to 1000000"),
        ("axs: []\n",
         "trial.yaml:4:1: axs: unknown key, expected version, name, description, scenarios, axes, set, exclude, "
         "outputs or frames_per_task (did you mean 'axes'?)"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_batch_is_found_at_its_position(workplace: Path, text: str, said: str) -> None:
    assert fault(workplace, text) == [said]


def test_a_sweep_over_a_missing_key_is_found_once_with_the_key_that_is_meant(workplace: Path) -> None:
    (said,) = fault(workplace, "axes:\n  - groups[0].cuont: [5, 15]\n")
    assert said.startswith("trial.yaml:5:5: axes[0].groups[0].cuont: for four.yaml: groups[0].cuont: unknown key")
    assert said.endswith("(did you mean 'count'?)")


def test_a_value_of_the_wrong_type_is_found_where_it_is_written(workplace: Path) -> None:
    assert fault(workplace, "axes:\n  - seed: 0:3\n  - groups[0].count: [2, two]\n") == [
        "trial.yaml:6:26: axes[1].groups[0].count[1]: for four.yaml: groups[0].count: is 'two', "
        "expected a whole number from 1 to 10000000"
    ]


def test_what_comes_of_several_values_is_found_of_their_combination(workplace: Path) -> None:
    placement = "[{kind: line, start: [-1, 0.7], end: [-0.5, 0.7]}]"
    (said,) = fault(workplace, f"axes:\n  - groups[0].placement: {placement}\n  - groups[0].count: [1, 40]\n")
    assert said.startswith("trial.yaml:5:3: axes: four.yaml, groups[0].placement=")
    assert "groups[0].count=40: " in said


def test_outputs_of_a_batch_are_checked_against_its_scenarios(workplace: Path) -> None:
    assert fault(workplace, "outputs: {bvh: {avatars: [4]}}\n") == [
        "trial.yaml:4:27: outputs.bvh.avatars[0]: for four.yaml: is 4, expected an avatar from 0 to 3"
    ]


def test_a_scenario_that_is_missing_is_found(workplace: Path) -> None:
    path = workplace / "trial.yaml"
    path.write_text("version: 1\nname: trial\nscenarios: [duel, dual]\n", encoding="utf-8")
    with pytest.raises(BatchError, match=r"trial.yaml:3:19: scenarios\[1\]: dual: no such scenario") as caught:
        resolve(load_batch(path))
    assert "did you mean 'duel'?" in str(caught.value)


def test_options_that_are_wrong_are_found_by_their_names(workplace: Path) -> None:
    write_scene(workplace / "four.yaml")
    assert option_fault(["four.yaml"], "0:10000000") == [
        "--seeds 0:10000000: axes: ask for 10,000,000 runs, expected at most 100,000"
    ]
    assert option_fault(["four.yaml"], None, ["seed"]) == [
        "--sweep seed: is no axis, expected KEY=VALUE,VALUE, such as groups[0].count=5,15,30"
    ]
    assert option_fault(["four.yaml"], None, ["seed=1,x"]) == [
        "--sweep seed=1,x: axes[0].seed[1]: for four.yaml: seed: is 'x', "
        "expected a whole number from 0 to 9223372036854775807"
    ]


def test_values_that_are_set_are_those_of_all_scenarios(workplace: Path) -> None:
    write_scene(workplace / "four.yaml")
    set_for_all, _ = resolve(with_overrides(batch_of_options(["four.yaml"], "0:2"), ["duration=20"]))
    swept, _ = resolve(batch_of_options(["four.yaml"], "0:2", ["duration=20"]))
    assert list(set_for_all) == list(swept)
    path = write_batch(workplace, axes=[{"seed": "0:2"}], set=["duration=30", "outputs={bvh: {fps: 15}}"])
    in_file, _ = resolve(with_overrides(load_batch(path), ["duration=20", "outputs.bvh.fps=30"]))
    assert list(in_file) == list(swept)
    assert {one.outputs.bvh.fps for one in in_file.values() if one.outputs.bvh} == {30}


@pytest.mark.parametrize("text", ["duraton=3", "duration=long", "groups[4].count=2", "duration", "fps=-1"])
def test_what_is_wrong_with_a_value_that_is_set_is_said_as_run_says_it(workplace: Path, text: str) -> None:
    write_scene(workplace / "four.yaml")
    with pytest.raises(CrowdsimError) as caught:
        resolve(with_overrides(batch_of_options(["four.yaml"], "0:2"), [text]))
    with pytest.raises(CrowdsimError) as of_run:
        load_scenario("four.yaml", [text])
    assert str(caught.value) == str(of_run.value)
    assert str(caught.value).startswith(f"--set {text}: ")


def test_a_key_is_set_or_an_axis(workplace: Path) -> None:
    write_scene(workplace / "four.yaml")
    with pytest.raises(BatchError) as caught:
        with_overrides(batch_of_options(["four.yaml"], "0:2"), ["seed=3"])
    assert str(caught.value) == "--set seed=3: sets seed, which is an axis; expected another key"
    assert fault(workplace, "axes:\n  - seed: 0:3\nset: [seed=3]\n") == [
        "trial.yaml:6:7: set[0]: sets seed, which is an axis; expected another key"
    ]


def test_the_example_of_the_documentation_is_a_batch(tmp_path: Path) -> None:
    (block,) = re.findall(r"```yaml\n(.*?)```", (ROOT / "docs" / "batch.md").read_text(encoding="utf-8"), re.DOTALL)
    (tmp_path / "counts.yaml").write_text(block, encoding="utf-8")
    runs, _ = resolve(load_batch(tmp_path / "counts.yaml"))
    assert len(runs) == 28


def test_the_reference_page_is_that_of_the_schema() -> None:
    assert (ROOT / "docs" / "batch_files.md").read_text(encoding="utf-8") == batch_reference()
