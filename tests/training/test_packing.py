"""Packed policies: unpacked to the bundle that was packed, once and whole; refused when damaged or foreign."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from crowdsim import assets
from crowdsim.errors import PolicyError, RunError
from crowdsim.policy import bundle
from crowdsim.policy.environment import Axis, build_grid
from crowdsim.training.mirroring import values_with_images
from crowdsim.training.packing import pack_policy, pack_table, unpack_policy, unpack_table
from crowdsim.training.train import find_bundle, is_trained, ready_policy, train_recipe

# Not mirror-symmetric; Q in bytes by a backup of V, V in bytes, and Q in bytes by sweeps over Q.
UNSYMMETRIC = """\
version: 1
motion:
  performer: {seconds: 12, seed: 3}
  mirror: false
precision: int8
behaviours:
  punch:
    axes:
      distance: {count: 6, fade: 0.5}
      bearing: {count: 8}
      height: {count: 3}
    rewards:
      - {kind: strike}
      - {kind: transition, weight: 0.1}
    lookup: q
  approach:
    axes:
      distance: {minimum: 0, maximum: 4, count: 5}
      bearing: {count: 8}
    rewards:
      - {kind: proximity}
  turn:
    axes:
      distance: {minimum: 0, maximum: 4, count: 3}
      bearing: {count: 4}
    rewards:
      - {kind: proximity}
    backup: max_of_interpolated
    lookup: q
"""
STAGE = "unpacking policy tiny (once)"


@pytest.fixture(scope="module")
def unsymmetric(tmp_path_factory):
    folder = tmp_path_factory.mktemp("unsymmetric")
    (folder / "small.yaml").write_text(UNSYMMETRIC)
    return train_recipe(folder / "small.yaml", threads=2)[0]


@pytest.fixture(scope="module")
def falling(tmp_path_factory):
    folder = tmp_path_factory.mktemp("falling")
    (folder / "falling.yaml").write_text(UNSYMMETRIC.replace("seed: 3", "seed: 3, falls: 1"))
    return train_recipe(folder / "falling.yaml", threads=2)[0]


@pytest.fixture
def installed(tiny_policy, tmp_path, monkeypatch):
    """A folder of recipes as a wheel has it, with the policy ``tiny`` packed; the user's cache is beside it."""
    folder = tmp_path / "package" / "policies"
    folder.mkdir(parents=True)
    shutil.copy(tiny_policy.with_suffix(".yaml"), folder)
    pack_policy(tiny_policy, folder / "packed")
    monkeypatch.setattr(assets, "_cache", lambda: tmp_path / "cache")
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def stages_of(call):
    """What ``call`` returns, and the stages that it reports."""
    stages: list[str] = []
    result = call(lambda stage, done, total: stages.append(stage))
    return result, list(dict.fromkeys(stages))


@pytest.mark.parametrize("name", ["tiny_policy", "unsymmetric", "falling"])
def test_what_is_unpacked_is_what_was_packed_byte_for_byte(request, name, tmp_path):
    trained = request.getfixturevalue(name)
    pack_policy(trained, tmp_path / "packed")
    unpack_policy(tmp_path / "packed" / f"{trained.name}.json", tmp_path / "unpacked")
    assert contents(tmp_path / "unpacked") == contents(trained)
    bundle.load_policy(tmp_path / "unpacked")


def test_policies_of_the_same_motion_share_it(tiny_policy, tmp_path):
    shutil.copytree(tiny_policy, tmp_path / "twin")
    path = tmp_path / "twin" / "policy.json"
    document = {**json.loads(path.read_text()), "name": "twin"}
    del document["checksum"]
    path.write_text(json.dumps(bundle.with_checksum(document)))
    for folder in (tiny_policy, tmp_path / "twin"):
        pack_policy(folder, tmp_path / "packed")
    names = sorted(path.name.split("-")[0] for path in (tmp_path / "packed").iterdir())
    assert names == ["motion", "tiny", "tiny.json", "twin", "twin.json"]


@given(
    kind=st.sampled_from([np.uint8, np.uint16, np.float16, np.float32]),
    axes=st.sampled_from(
        ["distance", "distance bearing", "distance bearing height", "distance bearing height heading"]
    ),
    symmetric=st.booleans(),
    seed=st.integers(0, 1000),
)
def test_any_table_is_unpacked_as_it_was(kind, axes, symmetric, seed):
    grid = build_grid(
        Axis(name, -np.pi, np.pi, 6, wraps=True) if name in ("bearing", "heading") else Axis(name, 0.0, 2.0, 3)
        for name in axes.split()
    )
    draw = np.random.default_rng(seed)
    values = draw.integers(0, 256, (4, grid.cells)).astype(kind)
    table = (values_with_images(values[:2], grid) if symmetric else values).ravel()
    kept = pack_table(table, grid, 4)
    assert (len(kept), kept.dtype) == (2 if symmetric else 4, table.dtype)
    found = unpack_table(kept, grid, 4)
    assert found.dtype == table.dtype
    np.testing.assert_array_equal(found, table)


def test_values_that_follow_their_neighbours_have_small_codes():
    grid = build_grid([Axis("distance", 0.0, 1.0, 20), Axis("bearing", -1.0, 1.0, 20)])
    plane = np.add.outer(500 * np.arange(20), 30 * np.arange(20)).astype(np.uint16)
    kept = pack_table(np.concatenate([plane.ravel(), plane.ravel() + np.uint16(1)]), grid, 2)
    assert (kept[:, 1:, 1:] == 0).all()


def test_a_packed_policy_is_unpacked_into_the_cache_once_and_nothing_is_trained(installed, tiny_policy, tmp_path):
    recipe = installed / "tiny.yaml"
    before = sorted(installed.rglob("*"))
    assert is_trained(recipe)
    result, stages = stages_of(lambda report: train_recipe(recipe, progress=report))
    assert (result, stages) == ((tmp_path / "cache" / "tiny", False), [STAGE])
    assert contents(result[0]) == contents(tiny_policy)
    _, stages = stages_of(lambda report: ready_policy(recipe, progress=report))
    assert stages == []
    assert sorted(installed.rglob("*")) == before
    assert [path.name for path in (tmp_path / "cache").iterdir()] == ["tiny"]


def test_commands_that_need_a_bundle_find_one_that_is_only_packed(installed, tmp_path):
    found, stages = stages_of(lambda report: find_bundle(installed / "tiny.yaml", report))
    assert (found, stages) == (tmp_path / "cache" / "tiny", [STAGE])
    assert find_bundle(found) == found


def test_a_changed_recipe_is_trained_although_an_older_one_is_packed(installed):
    recipe = installed / "tiny.yaml"
    recipe.write_text(recipe.read_text().replace("seconds: 24", "seconds: 20"))
    assert not is_trained(recipe)
    with pytest.raises(PolicyError, match="is not trained yet"):
        find_bundle(recipe)
    (folder, trained), stages = stages_of(lambda report: train_recipe(recipe, threads=2, progress=report))
    assert trained
    assert STAGE not in stages
    assert folder == assets.bundle_folder(recipe)


def test_damaged_and_foreign_packed_policies_are_refused(installed, tmp_path):
    recipe, path = installed / "tiny.yaml", installed / "packed" / "tiny.json"
    good, part = path.read_text(), next((installed / "packed").glob("tiny-*.xz"))
    for text, message in (
        ("{", f"{path}: damaged: is no JSON"),
        ('{"kind": "cake"}', f"{path}: foreign: its kind is not 'crowdsim packed policy'"),
        (
            good.replace('"version": 2', '"version": 9', 1),
            "its format version is 9, expected 2; install crowdsim again",
        ),
        (
            good.replace('"tiny"', '"huge"', 1),
            "damaged: its checksum does not match its contents; install crowdsim again",
        ),
    ):
        path.write_text(text)
        with pytest.raises(PolicyError) as caught:
            train_recipe(recipe)
        assert message in str(caught.value)
    path.write_text(good)
    content = part.read_bytes()
    part.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    with pytest.raises(PolicyError, match=r"\.xz: damaged: its SHA-256 is not the one in tiny\.json; install crowdsim"):
        train_recipe(recipe)
    part.unlink()
    with pytest.raises(PolicyError, match=r"\.xz: cannot be read: No such file or directory; install crowdsim again"):
        train_recipe(recipe)
    assert not list((tmp_path / "cache").iterdir())


def test_a_full_disk_leaves_nothing(installed, tmp_path, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(bundle.np, "save", full)
    with pytest.raises(RunError, match="cannot be written: No space left on device"):
        train_recipe(installed / "tiny.yaml")
    assert not list((tmp_path / "cache").iterdir())


PROGRAM = """
import json, os, sys
from pathlib import Path
from crowdsim import assets
from crowdsim.policy import bundle
from crowdsim.training.train import train_recipe
recipe, cache, files = Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])
assets._cache = lambda: cache
save = bundle.np.save
def save_some(*values, **named):
    global files
    files -= 1
    if files == 0:
        os._exit(9)
    save(*values, **named)
bundle.np.save = save_some
stages = []
folder, trained = train_recipe(recipe, progress=lambda stage, done, total: stages.append(stage))
print(json.dumps([trained, stages[0] if stages else ""]))
"""


def unpacking(installed: Path, cache: Path, files: int = 0) -> subprocess.Popen:
    """Start a process that unpacks; it is gone at once when it has to write so many files."""
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(installed / "tiny.yaml"), str(cache), str(files)],
        stdout=subprocess.PIPE, text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip


def test_what_a_killed_process_left_is_no_bundle_and_is_unpacked_again(installed, tiny_policy, tmp_path):
    killed = unpacking(installed, tmp_path / "cache", files=5)
    killed.communicate(timeout=120)
    assert killed.returncode == 9
    assert not (tmp_path / "cache" / "tiny").exists()
    assert contents(train_recipe(installed / "tiny.yaml")[0]) == contents(tiny_policy)


def test_one_of_two_processes_unpacks_and_the_other_uses_that(installed, tiny_policy, tmp_path):
    processes = [unpacking(installed, tmp_path / "cache") for _ in range(2)]
    outcomes = [json.loads(process.communicate(timeout=120)[0]) for process in processes]
    assert not any(trained for trained, _ in outcomes)
    others = {"", "wait for another process that trains it"}
    assert sorted(stage == STAGE for _, stage in outcomes) == [False, True]
    assert all(stage in others for _, stage in outcomes if stage != STAGE)
    assert contents(tmp_path / "cache" / "tiny") == contents(tiny_policy)
    assert [path.name for path in (tmp_path / "cache").iterdir()] == ["tiny"]
