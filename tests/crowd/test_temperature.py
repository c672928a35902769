"""The randomness that avatars have by default varies what they do, and costs them little of what they want."""

from dataclasses import replace

import numpy as np
import pytest

from crowdsim.crowd.crowd import Crowding, build_crowd
from crowdsim.crowd.script import CirclePath
from crowdsim.crowd.simulate import simulate
from crowdsim.policy.bundle import load_policy
from crowdsim.scenario.parts import AvatarType

COUNT = 600
SECONDS = 20.0
NEAR = 0.8
DEFAULT = AvatarType()


@pytest.fixture(scope="module")
def trained(tiny_policy):
    return load_policy(tiny_policy)


def approach(trained, seed, **fields):
    """Actions of avatars that walk to a still target, and when each has arrived, or the whole time [s]."""
    rng = np.random.default_rng(seed)
    bearing, distance = rng.uniform(-np.pi, np.pi, COUNT), rng.uniform(2.0, 4.0, COUNT)
    weights = np.array([[float(each.name == "approach") for each in trained.behaviours]])
    people = build_crowd(
        distance * np.sin(bearing), distance * np.cos(bearing), rng.uniform(-3, 3, COUNT), weights=weights,
        skip=np.full(COUNT, -2), fixed=np.full(COUNT, -2), crowding=Crowding.none(), seed=seed, **fields,
    )  # fmt: skip
    rate = trained.database.control_rate
    script = dict(targets=(CirclePath(radius=1.0, speed=0.0, centre=(0.0, -1.0), height=1.5),))
    chunks = list(simulate(replace(people, policies=[trained], **script), round(SECONDS * rate)))
    far = np.hypot(*(np.concatenate([getattr(chunk, axis) for chunk in chunks]) for axis in "xz"))
    arrived = (far < NEAR).any(axis=0)
    times = np.where(arrived, (far < NEAR).argmax(axis=0) / rate, SECONDS)
    return np.concatenate([chunk.action for chunk in chunks]), times


def test_the_default_temperature_costs_at_most_a_tenth_of_arrival_time(trained):
    default = {
        "temperature": DEFAULT.temperature,
        "margin": DEFAULT.candidates.margin,
        "most": DEFAULT.candidates.maximum,
    }
    best, drawn, wild = (
        [approach(trained, seed, **fields) for seed in range(3)]
        for fields in ({"temperature": 0.0}, default, {"temperature": 1.0, "margin": 4.0, "most": 20})
    )
    times = [np.mean([arrivals for _, arrivals in runs]) for runs in (best, drawn, wild)]
    assert times[0] < 0.3 * SECONDS, "they arrive"
    assert times[1] <= 1.1 * times[0]
    assert times[2] > 1.5 * times[0], "ten times the randomness is too much"
    for (one, _), (two, _) in zip(best, drawn, strict=True):
        assert np.mean(one != two) > 0.1, "they vary"
