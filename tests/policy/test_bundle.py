"""Bundles: written whole, read back the same, refused when damaged, foreign or of another version, found when stale."""

import itertools
import json
import os
import shutil

import numpy as np
import pytest
from naive_policy import action_values

from crowdsim import files
from crowdsim.array_checks import ArrayFault, check_table
from crowdsim.errors import MotionError, OutputError, PolicyError
from crowdsim.policy import bundle
from crowdsim.policy.axes.axis import Target
from crowdsim.policy.bundle import load_policy
from crowdsim.policy.kernels.axes import Corners
from crowdsim.policy.kernels.values import evaluate_actions
from crowdsim.training.recipe import load_recipe
from crowdsim.training.scales import SHOWN, advantages
from crowdsim.training.statistics import inspect_bundle
from crowdsim.training.train import ready_policy, stale, train_policy, train_recipe

RECIPE = """\
version: 1
motion:
  performer:
    seconds: 12
    seed: 3
  mirror: false
behaviours:
  approach:
    axes:
      distance:
        minimum: 0
        maximum: 4
        count: 5
      bearing:
        count: 8
    rewards:
      - kind: proximity
    finer: 2
  punch:
    axes:
      distance:
        count: 6
        fade: 0.5
      bearing:
        count: 8
      height:
        count: 3
    rewards:
      - kind: strike
      - kind: transition
        weight: 0.1
    lookup: q
"""


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """Folder of a recipe that has been trained into the bundle beside it."""
    folder = tmp_path_factory.mktemp("policies")
    (folder / "small.yaml").write_text(RECIPE)
    assert train_recipe(folder / "small.yaml") == (folder / "small", True)
    return folder


@pytest.fixture
def copied(trained, tmp_path):
    shutil.copytree(trained, tmp_path / "copy")
    return tmp_path / "copy"


def test_a_second_training_does_nothing_and_force_trains_the_same_bytes_on_two_threads(copied):
    assert train_recipe(copied / "small.yaml") == (copied / "small", False)
    before = {path.name: path.read_bytes() for path in (copied / "small").iterdir()}
    assert train_recipe(copied / "small.yaml", threads=2, force=True) == (copied / "small", True)
    after = {path.name: path.read_bytes() for path in (copied / "small").iterdir()}
    del before["timings.json"], after["timings.json"]
    assert before == after
    assert {path.name for path in copied.iterdir()} == {"small.yaml", "small"}  # nothing temporary is left


def test_what_is_read_is_what_was_trained(trained):
    fresh, _ = train_policy(load_recipe(trained / "small.yaml"), "small")
    read = load_policy(trained / "small")
    assert read.name == "small"
    assert read.fingerprint == fresh.fingerprint
    assert [b.grid for b in read.behaviours] == [b.grid for b in fresh.behaviours]
    assert [b.terms for b in read.behaviours] == [b.terms for b in fresh.behaviours]
    for ours, theirs in zip(read.behaviours, fresh.behaviours, strict=True):
        np.testing.assert_array_equal(ours.table, theirs.table)
    np.testing.assert_array_equal(read.database.rotations, fresh.database.rotations)
    np.testing.assert_array_equal(read.graph.action_next, fresh.graph.action_next)
    for ours, theirs in zip(read.actions, fresh.actions, strict=True):
        np.testing.assert_array_equal(ours, theirs)
    assert read.database.skeleton.names == fresh.database.skeleton.names
    assert read.body == fresh.body
    assert json.loads(json.dumps(fresh.statistics)) == read.statistics


def test_values_are_mapped_into_memory(trained):
    base = load_policy(trained / "small").values
    while getattr(base, "base", None) is not None and not isinstance(base, np.memmap):
        base = base.base
    assert isinstance(base, np.memmap) or type(base).__name__ == "mmap"


def test_compiled_look_ups_are_those_of_the_plain_version(trained):
    policy = load_policy(trained / "small")
    tables = policy.lookup_tables()
    draw = np.random.default_rng(0)
    corners, out = Corners(np.empty(64, np.int64), np.empty(64)), np.empty(100)
    for _ in range(200):
        state = int(draw.integers(policy.actions.state_count))
        target = draw.uniform([-2.0, 1.0, -2.0], [2.0, 1.8, 2.0])
        weights = {"approach": float(draw.integers(0, 2)), "punch": float(draw.uniform(0, 2))}
        seen = Target(*target, 0.0, 0.0, 0.0)
        n = evaluate_actions(tables, np.array(list(weights.values())), state, seen, corners, out)
        np.testing.assert_allclose(out[:n], action_values(policy, weights, state, target), rtol=1e-4, atol=1e-5)


def test_inspect_reports_what_is_asked_for(trained):
    report = inspect_bundle(load_policy(trained / "small"), bundle.read_timings(trained / "small"))
    assert set(report) >= {"motion", "graph", "behaviours", "fingerprint"}
    assert set(report["motion"]) >= {"clips", "frames", "seconds", "strikes", "frames_kept_by_clip"}
    graph = {"frames", "transitions", "states", "actions", "branching", "action_frames", "transitions_per_second"}
    assert set(report["graph"]) >= {*graph, "seconds_between_transitions"}
    punch = report["behaviours"]["punch"]
    keys_of_each = {
        "axes",
        "cells",
        "entries",
        "bytes",
        "solver",
        "backup",
        "residual",
        "seconds",
        "updates_per_second",
    }
    assert set(punch) >= keys_of_each
    assert punch["cells"] == 6 * 8 * 3
    assert punch["entries"] == punch["cells"] * report["graph"]["actions"] == punch["bytes"] // 4
    assert punch["seconds"] > 0
    json.dumps(report, allow_nan=False)


def test_a_flipped_bit_in_any_array_is_found(copied):
    for name in ("values.npy", "graph_action_next.npy", "database_ground.npy"):
        path = copied / "small" / name
        good = path.read_bytes()
        path.write_bytes(good[:-3] + bytes([good[-3] ^ 1]) + good[-2:])
        with pytest.raises(PolicyError) as error:
            load_policy(copied / "small")
        expected = f"{path}: damaged: its SHA-256 is not the one in policy.json; train the policy again"
        assert str(error.value) == expected
        path.write_bytes(good)


def test_a_short_or_missing_array_is_found(copied):
    path = copied / "small" / "values.npy"
    size = path.stat().st_size
    path.write_bytes(path.read_bytes()[:-8])
    with pytest.raises(PolicyError) as error:
        load_policy(copied / "small")
    assert str(error.value) == f"{path}: damaged: has {size - 8} bytes, expected {size}; train the policy again"
    path.unlink()
    with pytest.raises(PolicyError, match=r"values\.npy: no such file, but policy\.json lists it"):
        load_policy(copied / "small")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.update(version=99), "its format version is 99, expected 1; train it again"),
        (lambda d: d.update(kind="cake"), "foreign: its kind is not 'crowdsim policy'"),
        (lambda d: d.update(name="other"), "damaged: its checksum does not match its contents; train it again"),
        (
            lambda d: d["behaviours"][0].update(scale=7),
            "damaged: its checksum does not match its contents; train it again",
        ),
    ],
)
def test_other_versions_foreign_and_changed_documents_are_refused(copied, change, message):
    path = copied / "small" / "policy.json"
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))
    with pytest.raises(PolicyError) as error:
        load_policy(copied / "small")
    assert str(error.value) == f"{path}: {message}"


def test_broken_json_and_an_empty_folder_are_refused(copied):
    path = copied / "small" / "policy.json"
    path.write_text("{")
    with pytest.raises(PolicyError, match=r"policy\.json: damaged: is no JSON"):
        load_policy(copied / "small")
    path.unlink()
    with pytest.raises(PolicyError, match=r"policy\.json: no such file, expected a trained policy"):
        load_policy(copied / "small")


def test_a_changed_recipe_makes_a_bundle_stale_and_a_comment_does_not(copied):
    path = copied / "small.yaml"
    path.write_text(RECIPE + "# nothing\n")
    assert not stale(copied / "small", load_recipe(path))
    path.write_text(RECIPE.replace("seed: 3", "seed: 4"))
    assert stale(copied / "small", load_recipe(path)) == "its recipe changed"
    fresh = ready_policy(path)
    assert fresh.recipe["motion"]["performer"]["seed"] == 4
    assert not stale(copied / "small", load_recipe(path))


def test_a_bundle_of_another_version_is_trained_again(copied):
    path = copied / "small" / "policy.json"
    document = json.loads(path.read_text())
    document["version"] = 0
    path.write_text(json.dumps(document))
    assert train_recipe(copied / "small.yaml")[1]
    load_policy(copied / "small")


def test_nothing_is_left_when_writing_fails(copied, monkeypatch):
    policy = load_policy(copied / "small")

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(bundle.np, "save", full)
    with pytest.raises(OutputError, match="cannot be written: No space left on device"):
        bundle.write_bundle(copied / "small", policy, {})
    assert {path.name for path in copied.iterdir()} == {"small.yaml", "small"}
    load_policy(copied / "small")


def test_an_array_of_another_version_is_refused_with_advice():
    with pytest.raises(ArrayFault, match=r"is unknown, .* made again, a policy by 'crowdsim train'"):
        check_table({}, {"falls_stagger_last": np.zeros(1)}, {})


def test_a_folder_that_is_no_bundle_is_not_overwritten(copied):
    policy = load_policy(copied / "small")
    (copied / "mine").mkdir()
    (copied / "mine" / "notes.txt").write_text("mine")
    with pytest.raises(OutputError, match="is no trained policy, so it is not overwritten"):
        bundle.write_bundle(copied / "mine", policy, {})
    assert (copied / "mine" / "notes.txt").read_text() == "mine"


def test_missing_capture_names_what_to_give(tmp_path, monkeypatch):
    monkeypatch.delenv("CROWDSIM_MOCAP", raising=False)
    capture = "  capture:\n    clips:\n      - fight/*.bvh\n"
    performer = "  performer:\n    seconds: 12\n    seed: 3\n"
    path = tmp_path / "c.yaml"
    path.write_text(RECIPE.replace(performer, capture))
    with pytest.raises(PolicyError) as error:
        train_recipe(path)
    what = "motion.capture.clips: needs motion capture, expected its folder by --mocap DIR or in CROWDSIM_MOCAP"
    assert str(error.value) == f"{path}: {what}"
    (tmp_path / "empty").mkdir()
    with pytest.raises(PolicyError, match=r"holds nothing like 'fight/\*\.bvh'"):
        train_recipe(path, tmp_path / "empty")
    with pytest.raises(PolicyError, match="no such folder, expected motion capture"):
        train_recipe(path, tmp_path / "nowhere")
    assert {one.name for one in tmp_path.iterdir()} == {"c.yaml", "empty"}


def test_motion_without_strikes_is_refused_with_what_a_strike_is(trained):
    from dataclasses import replace

    from crowdsim.training.ranges import check_strikes

    database = load_policy(trained / "small").database
    check_strikes(database)
    still = replace(database, strike_frames=database.strike_frames[:0])
    with pytest.raises(MotionError, match=r"no strikes found in 12\.0 s of motion, .* moves at \d\.\d m/s or more"):
        check_strikes(still)


def relative_to_the_best(behaviour, actions):
    """Q-values less that of the state's best action in each cell, in the layout of a table."""
    values, parts = behaviour.values(), []
    for first, end in itertools.pairwise(actions.offsets.tolist()):
        rows = values[first * behaviour.grid.cells : end * behaviour.grid.cells].reshape(-1, end - first)
        parts.append((rows - rows.max(axis=1, keepdims=True)).ravel())
    return np.concatenate(parts)


def test_bytes_of_a_table_of_actions_hold_how_far_they_are_below_the_best(trained, tmp_path):
    path = tmp_path / "small.yaml"
    path.write_text(RECIPE + "precision: int8\n")
    coarse, fine = ready_policy(path).behaviour("punch"), load_policy(trained / "small").behaviour("punch")
    actions = load_policy(trained / "small").actions
    assert (coarse.lookup, coarse.table.dtype, coarse.scale) == ("q", np.uint8, fine.scale)
    expected = np.maximum(relative_to_the_best(fine, actions), -SHOWN * fine.scale)
    assert coarse.step * 255 == pytest.approx(-expected.min(), rel=1e-3)
    # Half a step of the table, and one of the values that it is a backup of: half for the action, half for the best.
    behind = bundle.read_document(tmp_path / "small")["behaviours"][1]["state_values"]["step"]
    wrong = 0.501 * coarse.step + behind
    assert behind < 0.2 * coarse.step
    assert np.abs(coarse.values() - expected).max() <= wrong
    assert np.abs(relative_to_the_best(coarse, actions) - expected).max() <= wrong


def test_actions_far_below_the_best_are_as_far_below_as_is_shown(trained):
    policy = load_policy(trained / "small")
    punch = policy.behaviour("punch")
    found = advantages(punch.table, policy.actions, punch.grid.cells, 2.0 * punch.scale)
    expected = relative_to_the_best(punch, policy.actions)
    assert expected.min() < -3.0 * punch.scale
    np.testing.assert_allclose(found, np.maximum(expected, -2.0 * punch.scale), atol=1e-6)


@pytest.mark.parametrize("precision", ["float16", "int16", "int8"])
def test_coarser_values_are_near_and_smaller(trained, tmp_path, precision):
    path = tmp_path / "small.yaml"
    path.write_text(RECIPE + f"precision: {precision}\n")
    coarse = ready_policy(path)
    fine = load_policy(trained / "small")
    size, kind, steps = {
        "float16": (2, np.float32, 500), "int16": (2, np.uint16, 65536 * 1.9), "int8": (1, np.uint8, 509)
    }[precision]  # fmt: skip
    assert (tmp_path / "small" / "values.npy").stat().st_size < size * len(fine.values) + 500
    for ours, theirs in zip(coarse.behaviours, fine.behaviours, strict=True):
        assert ours.table.dtype == kind
        best_alone = precision == "int8" and ours.lookup == "q"
        spread = SHOWN * theirs.scale if best_alone else float(np.ptp(theirs.values()))
        if not best_alone:
            assert np.abs(ours.values() - theirs.values()).max() <= spread / steps
        close = 2.0 * spread / (steps * ours.scale)
        for state in range(0, coarse.actions.state_count, 9):
            found, expected = (action_values(one, {ours.name: 1.0}, state, (0.2, 1.5, 0.9)) for one in (coarse, fine))
            if best_alone:
                assert expected[found.argmax()] >= expected.max() - close
            else:
                np.testing.assert_allclose(found, expected, atol=close)


def test_a_damaged_bundle_in_a_folder_called_version_is_damaged_and_not_stale(trained, tmp_path):
    folder = tmp_path / "version 2"
    shutil.copytree(trained / "small", folder)
    recipe = load_recipe(trained / "small.yaml")
    document = json.loads((folder / "policy.json").read_text())
    (folder / "policy.json").write_text(json.dumps({**document, "checksum": "0"}))
    with pytest.raises(PolicyError, match="damaged"):
        stale(folder, recipe)
    (folder / "policy.json").write_text(json.dumps({**document, "version": 0}))
    assert stale(folder, recipe) == "it is of another format version"


@pytest.mark.parametrize("exchanges", [True, False])
def test_a_bundle_that_is_replaced_is_never_missing_and_leaves_nothing(copied, monkeypatch, exchanges):
    folder, policy = copied / "small", load_policy(copied / "small")
    if not exchanges:
        monkeypatch.setattr(files, "_exchange", lambda *_: False)
    replace, seen = os.replace, []

    def watch(source, target) -> None:
        seen.append((folder / "policy.json").exists())
        replace(source, target)
        seen.append((folder / "policy.json").exists())

    monkeypatch.setattr(files.os, "replace", watch)
    bundle.write_bundle(folder, policy, {})
    assert all(seen) == exchanges
    bundle.load_policy(folder)
    assert [path.name for path in copied.iterdir() if path.name.startswith(".")] == []


def test_what_a_killed_process_has_left_of_a_bundle_is_brought_back_or_removed(copied):
    folder = copied / "small"
    os.replace(folder, copied / ".small.old-12")
    for name in (".small.new-12", ".small.old-3x", ".smaller.old-12"):
        (copied / name).mkdir()
    assert bundle.tidy(folder)
    bundle.load_policy(folder)
    assert sorted(path.name for path in copied.iterdir() if path.name.startswith(".")) == [
        ".small.old-3x",
        ".smaller.old-12",
    ]
    assert not bundle.tidy(folder)
