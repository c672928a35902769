"""A scenario that lets avatars rest says so where their policy cannot."""

from crowdsim.scenario.scenario import load_scenario
from crowdsim.scenario.warnings import policy_warnings


def test_the_event_rest_needs_a_policy_with_rests() -> None:
    scenario = load_scenario("bout")
    rests = [number for number, event in enumerate(scenario.events) if event.kind == "rest"]
    assert rests
    report = {"sustained_speed": 1.0, "falls": {"directions": [0.0]}}
    found = policy_warnings(scenario, {"boxer": report})
    assert [finding.loc for finding in found] == [("events", number, "kind") for number in rests]
    assert all("expected a recipe with 'rest: {}'" in finding.message for finding in found)
    assert not policy_warnings(scenario, {"boxer": {**report, "rests": {"count": 8}}})
