"""Mutated recipes are valid or refused with positions; nothing else happens.

Hypothesis draws seeds of batches: a mutation costs less than drawing an example.
"""

import sys
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

sys.path.insert(0, str(Path(__file__).parent))
from mutating import Guard, check_batch
from yaml_files import maker, reader

from crowdsim.config.files import find_faults
from crowdsim.errors import PolicyError
from crowdsim.training.fingerprint import capture_files
from crowdsim.training.recipe import Recipe, load_recipe, plain

SHIPPED = sorted((Path(__file__).parents[2] / "policies").glob("*.yaml"))
BATCH = 100

SMALL = b"""\
version: 1
motion: {performer: {seconds: 60, seed: 2}}
behaviours:
  strike:
    axes: {distance: {count: 4}}
    rewards: [{kind: strike, weight: 2}]
"""
RICH = b"""\
version: 1
description: 'text'
motion: {capture: {clips: ["*.bvh", "below/one.bvh"], unit: cm, up_axis: y, strict: false}, mirror: false}
strikes: {limbs: [hands, left_foot]}
control_rate: 15
playback_rate: 60
graph: {branching: 4, actions: 500, joint_weights: {head: 0.5}}
prune: {transitions: 4}
behaviours:
  strike: &strike
    axes: {distance: {count: 4, minimum: 0.2, maximum: 2.0, stretch: 1.0}, bearing: {count: 5}, height: {count: 3}}
    rewards: [{kind: strike, tolerance: 0.2, form: max}, {kind: transition, each: 0.1}]
    target: {speed: 0.5, directions: 4}
  approach:
    <<: *strike
    rewards: [{kind: proximity, distance: [0.5, 1.5], facing: true}]
    solver: {kind: q_learning, max_sweeps: 5}
    backup: max_of_interpolated
weights: {strike: 1, approach: 0.5}
precision: int8
"""


def find_capture(path: Path) -> None:
    """Look for the files of a valid recipe."""
    recipe = load_recipe(path)
    assert Recipe.model_validate(plain(recipe))
    try:
        found = capture_files(recipe, path.parent)
    except PolicyError:
        return
    assert all(file.resolve().is_relative_to(path.parent.resolve()) for file in found)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of capture, with a file above it."""
    folder = tmp_path_factory.mktemp("root") / "capture"
    (folder / "below").mkdir(parents=True)
    for path in (folder / "one.bvh", folder / "below" / "one.bvh", folder.parent / "up.csv"):
        path.touch()
    return folder


@pytest.fixture(scope="module")
def guard(folder: Path) -> Guard:
    """A guard; what is read is valid unless mutated, and reading it has loaded all that it needs."""
    for seed in (SMALL, RICH):
        (folder / "seed.yaml").write_bytes(seed)
        assert find_faults(folder / "seed.yaml", Recipe) == []
        find_capture(folder / "seed.yaml")
    return Guard(folder)


MAKE = maker([SMALL, RICH, *(path.read_bytes() for path in SHIPPED)])


def check(guard: Guard, folder: Path, seed: int) -> None:
    check_batch(guard, seed, BATCH, MAKE, reader(folder, Recipe, {}, find_capture))


several = settings(
    max_examples=4, deadline=None, phases=[Phase.explicit, Phase.generate], suppress_health_check=list(HealthCheck)
)


@several
@given(seed=st.integers(0, 2**63))
def test_mutated_recipes_are_valid_or_refused_with_positions(guard: Guard, folder: Path, seed: int) -> None:
    check(guard, folder, seed)


@pytest.mark.slow
@settings(several, max_examples=1000)
@given(seed=st.integers(0, 2**63))
def test_a_hundred_thousand_mutated_recipes_are_valid_or_refused(guard: Guard, folder: Path, seed: int) -> None:
    check(guard, folder, seed)


@pytest.mark.parametrize("name", ["../up.csv", "/etc/passwd", "..\\\\up.csv", "below/../../up.csv", "\\0"])
def test_clips_outside_the_folder_of_capture_are_refused(folder: Path, name: str) -> None:
    (folder / "clips.yaml").write_bytes(RICH.replace(b"*.bvh", name.encode()))
    (finding,) = find_faults(folder / "clips.yaml", Recipe)
    assert finding.key == "motion.capture.clips[0]"
    assert finding.message.endswith("expected a file or a pattern below the folder of capture")
