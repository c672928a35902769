"""How a body steps and stands in its capture."""

import numpy as np

from crowdsim.poses.gait import USUAL, measure_gait


def walk(lengths: list[float], rate: float = 60.0) -> tuple[np.ndarray, np.ndarray]:
    """Contacts (P, 2) and balls (P, 2, 3) of one who takes left steps: 0.1 s and 0.2 s more a metre, 1 cm high."""
    contacts, places, x = [], [], 0.0
    for length in lengths:
        air = round((0.1 + 0.2 * length) * rate)
        part = np.linspace(0.0, 1.0, air + 1)[1:]
        contacts += [True] * 20 + [False] * (air - 1) + [True]
        places += [(x, 0.0)] * 20 + [(x + length * s, 0.04 * s * (1.0 - s)) for s in part]
        x += length
    feet = np.zeros((len(places), 2, 3))
    feet[:, 0, :2] = places
    return np.stack([contacts, np.ones(len(contacts), bool)], axis=1), feet


def test_steps_last_longer_the_further_they_go() -> None:
    contacts, feet = walk(np.linspace(0.05, 0.4, 30).tolist())
    gait = measure_gait(contacts, feet, np.array([0, len(feet)]), 60.0)
    # Two frames more than the foot is in the air.
    assert abs(gait.seconds + 0.2 * gait.seconds_each - (0.14 + 2 / 60)) < 0.01
    assert abs(gait.seconds_each - 0.2) < 0.1
    assert abs(gait.height + 0.2 * gait.height_each - 0.01) < 0.001
    assert gait.slide == 0.0


def test_a_border_of_clips_is_no_step() -> None:
    contacts, feet = walk([0.2] * 5)
    far = feet + np.array([5.0, 0.0, 0.0])
    both = measure_gait(np.concatenate([contacts] * 4), np.concatenate([feet, far] * 2), np.arange(5) * len(feet), 60.0)
    assert both.slide == 0.0
    assert both.height < 0.02


def test_who_hardly_steps_is_taken_to_step_as_people_do() -> None:
    contacts, feet = walk([0.2] * 3)
    assert measure_gait(contacts, feet, np.array([0, len(feet)]), 60.0) == USUAL
