"""A small policy with falls, trained once in a process, and its motion."""

from functools import cache
from pathlib import Path

import numpy as np
import yaml

from crowdsim.motion import quaternion
from crowdsim.motion.body import Body
from crowdsim.motion.database import MotionDatabase, build_database
from crowdsim.motion.measuring import measure_clips
from crowdsim.performer.session import perform
from crowdsim.policy.policy import Policy
from crowdsim.training.recipe import Recipe
from crowdsim.training.train import train_policy


def recipe(falls: int = 1) -> Recipe:
    """The recipe of tiny policies, with falls."""
    text = (Path(__file__).parent / "tiny_policy.yaml").read_text(encoding="utf-8")
    document = yaml.safe_load(text)
    document["motion"]["performer"]["falls"] = falls
    return Recipe.model_validate(document)


@cache
def falling_policy() -> Policy:
    """A small policy with a take of every fall and stagger, and their mirror images."""
    return train_policy(recipe(), "falling")[0]


@cache
def falling_database() -> MotionDatabase:
    """Motion of half a minute of performance and a take of every fall and stagger."""
    return build_database(measure_clips([performed.clip for performed in perform(30, 3, falls=1)]), mirror=True)


def lowest_points(body: Body, positions: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """How low each capsule of a posed body reaches. Shape (F, K) for joints (F, J, 3) and (F, J, 4)."""
    low = np.full((len(positions), len(body.capsule_joints)), np.inf)
    for k, joint in enumerate(body.capsule_joints):
        for end, radius in zip((body.capsule_starts[k], body.capsule_ends[k]), body.capsule_radii[k], strict=True):
            height = positions[:, joint, 1] + quaternion.rotate(rotations[:, joint].astype(float), end)[..., 1]
            low[:, k] = np.minimum(low[:, k], height - radius)
    return low
