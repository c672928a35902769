"""Mutated scenarios are valid or refused with positions; nothing else happens.

Hypothesis draws seeds of batches: a mutation costs less than drawing an example.
"""

import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

sys.path.insert(0, str(Path(__file__).parent))
from mutating import Guard, check_batch
from yaml_files import maker, reader

from crowdsim.config.files import find_faults
from crowdsim.crowd.placement import place_groups
from crowdsim.errors import ScenarioError
from crowdsim.scenario.scenario import Scenario, load_scenario

SHIPPED = sorted((Path(__file__).parents[2] / "scenarios").glob("*.yaml"))
BATCH = 100

SMALL = b"""\
version: 1
name: small
duration: 60
types: {a: {policy: boxer}, b: {extends: a, scale: 1.1}}
groups:
- {name: red, team: red, type: a, count: 2, placement: {kind: grid}}
- {team: blue, mix: {a: 1, b: 2}, count: 2, placement: {kind: points, file: rows.csv}}
"""
RICH = b"""\
version: 1
name: rich
description: "text"
seed: 3
duration: {seconds: 2}
arena: {kind: circle, radius: 50, solid: true}
obstacles:
  - {kind: wall, points: [[-30, 30], [30, 30]], doors: [{at: 20, opens: 2}]}
  - {kind: box, centre: [30, -10], size: [1, 2], rotation: 20}
  - {kind: disc, centre: [-30, -10], radius: 0.5}
types:
  a: &a {policy: boxer, behaviours: {strike: 1}, candidates: {margin: 0.5}, tempo: null, colour: '#a0b0c0'}
  b: {<<: *a, speed: {kind: uniform, minimum: 0.9, maximum: 1.1}}
groups:
- name: red
  type: a
  count: 3
  facing: enemies
  placement: {kind: disc, radius: 9, distance: 0.8}
- {name: blue, team: two, type: b, count: 2, waits: true, placement: {kind: points, points: [[20, 1], [21, 2]]}}
- {name: green, type: a, count: 2, placement: {kind: disc, centre: [30, 0], radius: 2}}
- {name: cast, team: two, mix: {a: 1, b: 2}, placement: {kind: table, file: cast.csv}}
- {name: door, team: two, type: b, count: 2, enter: {path: [[40, 0], [35, 0]], rate: 2, gait: run, until: end}}
opponents: {kind: other_team, hysteresis: 0.2}
targets: {head: {kind: points, points: [[1, 2], [3, 4]]}}
events:
- {kind: add, group: blue, when: {kind: seconds, seconds: 0.5}}
- {kind: retarget, group: red, opponents: {kind: target, target: head}, when: {kind: strikes, count: 3, team: two}}
- {kind: leave, group: red, path: [[0, 30]], gait: walk, when: {kind: frame, frame: 20}}
- {kind: weights, temperature: 0.3, when: {kind: distance, group: red, to: blue, below: 2}}
outputs:
  bvh: {fps: 30, avatars: [0, 1], frames: 0:10}
  ply: {every: 2, points: 100, frames: {seconds: [0, 1]}}
  render: {size: [320, 240], camera: {kind: follow, avatar: 1}, contact_sheet: 4}
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with files of points, a link that leaves it, and a file that would run code if it were unpickled."""
    folder = tmp_path_factory.mktemp("root") / "scenes"
    folder.mkdir()
    (folder / "rows.csv").write_text("x,z\n0,9\n1,9\n")
    (folder / "cast.csv").write_text("name,x,z,type,team,number\nAnna,0,20,a,,1\nBen,1,20,,one,0\n")
    np.save(folder / "rows.npy", np.array([[0.0, 9.0], [1.0, 9.0]]))
    (folder / "huge.npy").write_bytes(
        (folder / "rows.npy").read_bytes().replace(b"(2, 2), }         ", b"(10000000000, 2), }")
    )
    (folder / "pickled.npy").write_bytes(b"cos\nsystem\n(S'echo canary'\ntR.")
    (folder.parent / "up.csv").write_text("0,0\n1,1\n")
    (folder / "link.csv").symlink_to(folder.parent / "up.csv")
    return folder


def place(path: Path) -> None:
    """Resolve a valid scenario, and place its avatars where there are few."""
    scenario = load_scenario(path)
    if scenario.avatar_count < 1000:
        failure: object = f"{path}:"
        try:
            place_groups(scenario)
        except ScenarioError as error:
            failure = error
        assert str(failure).startswith(f"{path}:"), failure


MAKE = maker([SMALL, RICH, *(path.read_bytes() for path in SHIPPED)])


CONTEXT = {"policies": ["boxer", "boxer_crowd", "boxer_cmu"]}


@pytest.fixture(scope="module")
def guard(folder: Path) -> Guard:
    """A guard; what is read is valid unless mutated, and reading it has loaded all that it needs."""
    for seed in (SMALL, RICH):
        (folder / "seed.yaml").write_bytes(seed)
        assert find_faults(folder / "seed.yaml", Scenario, (), {"folder": folder, **CONTEXT}) == []
        place(folder / "seed.yaml")
    return Guard(folder)


def check(guard: Guard, folder: Path, seed: int) -> None:
    check_batch(guard, seed, BATCH, MAKE, reader(folder, Scenario, {"folder": folder, **CONTEXT}, place))


several = settings(
    max_examples=4, deadline=None, phases=[Phase.explicit, Phase.generate], suppress_health_check=list(HealthCheck)
)


@several
@given(seed=st.integers(0, 2**63))
def test_mutated_scenarios_are_valid_or_refused_with_positions(guard: Guard, folder: Path, seed: int) -> None:
    check(guard, folder, seed)


@pytest.mark.slow
@settings(several, max_examples=1000)
@given(seed=st.integers(0, 2**63))
def test_a_hundred_thousand_mutated_scenarios_are_valid_or_refused(guard: Guard, folder: Path, seed: int) -> None:
    check(guard, folder, seed)
