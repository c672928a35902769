"""Units and up axes are found where they are plain, and left open where they are not."""

from __future__ import annotations

import numpy as np
import pytest

from crowdsim.capture.units import UNITS, describe_heights, find_scale, find_up_axis, parse_unit, parse_up_axis
from crowdsim.errors import MotionError


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("height", [1.5, 1.75, 1.95])
def test_the_unit_of_an_adult_is_found(unit, height):
    assert find_scale(height / UNITS[unit]) == UNITS[unit]


@pytest.mark.parametrize("unit", ["m", "cm", "inch"])
def test_the_unit_of_a_child_is_found(unit):
    assert find_scale(1.1 / UNITS[unit]) == UNITS[unit]


@pytest.mark.parametrize("height", [0.0, -1.0, float("nan"), float("inf"), 0.3, 5.0, 500.0, 1e9])
def test_no_unit_is_guessed_for_what_no_unit_fits(height):
    assert find_scale(height) is None


@pytest.mark.parametrize("height", [22.0, 40.5])
def test_no_unit_is_guessed_where_two_are_as_likely(height):
    assert find_scale(height) is None
    assert describe_heights(height).endswith("are as likely")


def test_an_implausible_height_is_reported_in_every_unit():
    assert describe_heights(500.0) == (
        "unknown scale: the body's height would be 500 m in m, 50 m in dm, 5 m in cm, 0.5 m in mm, 12.7 m in inch, "
        "28.2 m in cmu; expected 1 m to 2.4 m"
    )


@pytest.mark.parametrize(("unit", "scale"), [("cm", 0.01), ("cmu", 0.0254 / 0.45), ("0.5", 0.5), (2, 2.0)])
def test_a_unit_is_given_by_name_or_in_metres(unit, scale):
    assert parse_unit(unit) == scale


def test_an_unknown_unit_is_refused_with_the_choices():
    with pytest.raises(MotionError) as error:
        parse_unit("inches")
    assert str(error.value) == (
        "unit 'inches' is unknown (did you mean 'inch'?); expected m, dm, cm, mm, inch, cmu or metres as a number"
    )


@pytest.mark.parametrize("unit", ["0", "-1", "nan", "inf"])
def test_a_unit_that_is_no_length_is_refused(unit):
    with pytest.raises(MotionError, match="expected a positive number of metres"):
        parse_unit(unit)


def test_an_unknown_up_axis_is_refused_with_the_choices():
    assert parse_up_axis("-z") == "-z"
    with pytest.raises(MotionError) as error:
        parse_up_axis("w")
    assert str(error.value) == "up axis 'w' is unknown; expected x, y, z, -x, -y, -z"


def _walker(frames: int = 40) -> np.ndarray:
    """A head over two feet that goes along z; joints: head, left foot, right foot."""
    pose = np.array([[0.0, 1.6, 0.0], [0.1, 0.0, 0.0], [-0.1, 0.0, 0.0]])
    return pose + np.linspace(0.0, 3.0, frames)[:, None, None] * np.array([0.0, 0.0, 1.0])


def test_capture_upright_along_another_axis_overrules_the_rest_pose():
    poses = _walker()
    rest = poses[0]
    turned = poses[..., [2, 0, 1]]
    assert find_up_axis(rest, poses, [0], [1, 2]) == "y"
    assert find_up_axis(rest, turned, [0], [1, 2]) == "z"


def test_someone_who_lies_keeps_to_the_floor_of_the_rest_pose():
    poses = _walker()
    lying = np.stack([poses[..., 0], 0.05 + 0.0 * poses[..., 1], poses[..., 1]], axis=-1)
    lying[:, :, 2] += np.linspace(0.0, 3.0, len(lying))[:, None]
    assert find_up_axis(poses[0], lying, [0], [1, 2]) == "y"


def test_nothing_is_known_of_one_pose_without_top_and_bottom():
    assert find_up_axis(None, _walker(1), [], []) is None
