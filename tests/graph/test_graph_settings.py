import pytest
from pydantic import ValidationError

from crowdsim.graph.settings import GraphSettings, JointWeights
from crowdsim.motion.body import ROLES


def test_a_number_of_actions_replaces_the_threshold():
    assert GraphSettings().threshold is not None
    assert GraphSettings(actions=27072).threshold is None


def test_settings_come_back_from_what_they_are_written_as():
    for settings in (GraphSettings(), GraphSettings(actions=500), GraphSettings(threshold=0.2)):
        assert GraphSettings(**settings.model_dump()) == settings


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"threshold": 0.1, "actions": 100}, "both given"),
        ({"threshold": None}, "expected one of the two"),
        ({"threshold": -1}, "greater than 0"),
        ({"threshold": float("inf")}, "finite"),
        ({"treshold": 0.1}, "Extra inputs"),
        ({"joint_weights": {"paw": 1}}, "Extra inputs"),
        ({"branching": 0}, "greater than or equal to 1"),
    ],
)
def test_settings_that_make_no_sense_are_refused(values, message):
    with pytest.raises(ValidationError, match=message):
        GraphSettings(**values)


def test_every_role_has_a_weight():
    assert all(JointWeights().of_role(role) >= 0 for role in ROLES)
    assert JointWeights(hand=2.5).of_role("left_hand") == JointWeights(hand=2.5).of_role("right_hand") == 2.5


def test_weights_that_are_all_zero_are_refused():
    with pytest.raises(ValidationError, match="every weight is 0"):
        JointWeights(**dict.fromkeys(JointWeights.model_fields, 0.0))
