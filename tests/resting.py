"""A small policy with rests, trained once in a process, and the same recipe without them."""

from functools import cache
from pathlib import Path
from unittest.mock import patch

import yaml

from crowdsim.performer.rests import AT_EASE
from crowdsim.policy.policy import Policy
from crowdsim.training.recipe import Recipe
from crowdsim.training.train import train_policy


def recipe(rests: int = 1) -> Recipe:
    """The recipe of tiny policies, with falls, and with rests."""
    text = (Path(__file__).parent / "tiny_policy.yaml").read_text(encoding="utf-8")
    document = yaml.safe_load(text)
    document["motion"]["performer"] |= {"falls": 1, "rests": rests}
    document["rest"] = {}
    return Recipe.model_validate(document)


@cache
def resting_policy() -> Policy:
    """A small policy with a take of every fall, stagger and rest, walks among them, and their mirror images."""
    return train_policy(recipe(), "resting")[0]


@cache
def staying_policy() -> Policy:
    """The same policy whose motion has rests on the spot alone."""
    with patch("crowdsim.performer.session.RESTS", AT_EASE):
        return train_policy(recipe(), "staying")[0]


@cache
def restless_policy() -> Policy:
    """The same policy whose motion has no rests, though its recipe asks for them."""
    return train_policy(recipe(0), "restless")[0]
