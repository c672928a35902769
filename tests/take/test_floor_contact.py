"""Bodies that are down rest on the floor, however they are built."""

from dataclasses import replace

import numpy as np
from falling import falling_database
from take.synthetic_take import sampler
from take.test_down_state import FPS, FRAMES, RATE, spans, takes

from crowdsim.motion import quaternion
from crowdsim.poses.capsules import PosedBodies, place_capsules
from crowdsim.poses.kernels.columns import LOWER
from crowdsim.poses.layers import floor
from crowdsim.poses.motion import prepare_motion
from crowdsim.poses.sampler import Poses
from crowdsim.take.take import Take

LEGS, ARMS = [0.95, 1.05], [1.05, 0.95]


def built(**build: list[float]) -> tuple[Take, object]:
    """The falls of ``test_down_state``, every other avatar built otherwise."""
    take, policy = takes()
    rows = {name: np.resize(values, take.avatar_count).astype(np.float32) for name, values in build.items()}
    return replace(take, cast=replace(take.cast, **rows)), policy


def lowest(motion: object, poses: Poses) -> np.ndarray:
    """The lowest point of each body, of shoes their soles. Shape (T, N)."""
    body, feet = falling_database().body, motion.legs.joints[:, LOWER]
    positions, rotations = poses.joints()
    posed = PosedBodies(body, poses.avatars, poses.scales, poses.girths, poses.stretches, positions, rotations)
    capsules = place_capsules([posed], *positions.shape[:2])
    low = np.minimum(capsules.starts[..., 1] - capsules.radii[..., 0], capsules.ends[..., 1] - capsules.radii[..., 1])
    order = np.argsort(body.capsule_joints != body.roles["pelvis"], kind="stable")
    low[..., np.isin(body.capsule_joints[order], feet)] = np.inf
    soles = quaternion.rotate(rotations[:, :, feet, None].astype(float), body.sole_offsets)
    heights = positions[:, :, feet, 1][..., None] + soles[..., 1] * poses.scales[:, None, None]
    return np.minimum(low.min(axis=-1), heights.min(axis=(2, 3)))


def extremes(take: Take, policy: object) -> tuple[float, float]:
    """The lowest point of all bodies that are down, and the highest lowest point of those that lie."""
    low = lowest(prepare_motion(policy), sampler(take, policy).sample(0, int(FRAMES / RATE * FPS) - 8, FPS)[0])
    deep, high = [], []
    for n, frames in enumerate(spans()):
        first, down, rise, last = (int(frame * FPS / RATE) for frame in frames)
        deep.append(low[first:last, n].min())
        high.append(low[down:rise, n].max())
    return min(deep), max(high)


def test_bodies_of_any_build_that_are_down_neither_sink_nor_float(monkeypatch) -> None:
    for build in ({"legs": LEGS, "arms": ARMS}, {"girths": [1.2, 0.88]}, {}):
        deep, high = extremes(*built(**build))
        assert deep > -0.01
        assert high < 0.01
    monkeypatch.setattr(floor.Settling, "settle", lambda *_: None)
    assert extremes(*built(girths=[1.2, 0.88]))[0] < -0.015
    assert extremes(*built(legs=LEGS, arms=ARMS))[0] < -0.01
