"""The benchmark of consequences tells falls apart, sees who strikes too late, and marks what misses its goal."""

import importlib
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from take.synthetic_take import actions, build_take

from crowdsim.crowd.events import Events

ROOT = Path(__file__).parents[1]


@pytest.fixture
def measures(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The module of the benchmark."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    monkeypatch.delitem(sys.modules, "_fights.consequences", raising=False)
    return importlib.import_module("_fights.consequences")


def test_mirror_images_are_alike_and_other_poses_are_not(measures: ModuleType) -> None:
    rng = np.random.default_rng(1)
    one, other = rng.uniform(-0.5, 0.5, (2, 4, 11, 3))
    mirror = one[:, measures._MIRROR] * [-1.0, 1.0, 1.0]
    poses = [measures._seen_from_pelvis(each, 0.0) for each in (one, mirror, one + 0.01, other)]
    assert measures._groups(poses).tolist() == [3, 1]


@pytest.mark.parametrize("late", [False, True])
def test_strikes_after_the_blow_and_falls_at_once_are_counted(measures: ModuleType, late: bool) -> None:
    first, lengths = actions(2, longest=12, seed=3)
    take, _ = build_take([[0] * 20, [0] * 20], first, lengths, 75)
    action, done = np.array(take.action), np.array(take.action_frame)
    # The second avatar is knocked down in frame 14.5, and falls in action 1.
    begins = 15 + 3 * late
    action[begins:, 1], done[begins:, 1] = 1, 0.5 + np.arange(75 - begins)
    struck = [(14.5, 0, 1, True), (14.0, 1, 0, False), (20.0, 1, 0, False)][: 2 + late]
    frame, attacker, victim, down = (np.array(column) for column in zip(*struck, strict=True))
    count = len(struck)
    events = Events(
        frame.astype(np.float32), attacker.astype(np.int32), victim.astype(np.int32), np.zeros(count, np.uint8),
        np.zeros((count, 3), np.float32), np.ones(count, np.float32), np.ones(count, bool), down=down,
    )  # fmt: skip
    take = replace(take, action=action, action_frame=done, events=events)
    frames = 300
    joints = np.zeros((2, frames, 11, 3), np.float32)
    joints[1, :, :, 2] = 1.0
    heights = np.where(np.arange(frames) < (90 if late else 70), 0.9, 0.2)
    joints[1, :, measures.HIPS, 1], joints[0, :, measures.HIPS, 1] = heights, 0.9
    neck = joints[:, :, measures.HIPS] + np.float32([0.0, 0.5, 0.0])
    ahead = np.tile(np.float32([0.0, 1.0]), (2, frames, 1))
    posed = measures.Posed(take, joints, neck, ahead, ahead, 60)
    figures = measures.measure_consequences([posed], np.array([1]), np.array([0]))
    assert figures["knock_downs"] == 1
    assert figures["struck_after"] == float(late)
    assert figures["left_within"] == figures["crumple_down"] == float(not late)
    assert figures["attacker_faces"] == 1.0
    assert figures["someone_looks"] is None
    text = "\n".join(measures.lines({"scene": figures}))
    assert ("**1**" in text) == late
