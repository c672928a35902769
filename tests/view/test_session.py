"""What is done to a session is repeated by its scenario, byte for byte."""

import re

import numpy as np
import pytest
from scenes import crowdsim, scene, write_scene

import crowdsim as library
from crowdsim.crowd.draw import sees_strikes, unlearned_behaviours
from crowdsim.crowd.script import CirclePath, KeyPath, seen_targets, target_positions
from crowdsim.errors import OutputError, RunError, ScenarioError
from crowdsim.play.session import Session, boxer_and_target
from crowdsim.preparation.prepare import load_policies
from crowdsim.scenario.scenario import load_scenario

CIRCLE = {"ball": {"kind": "circle", "radius": 1.5, "speed": 0.4}}
FOLLOWS = {"kind": "target", "target": "ball"}


@pytest.fixture
def session(workplace):
    def begin(scenario):
        return Session(scenario, load_policies(scenario))

    return begin


def same_take(one, other) -> None:
    for name in ("action", "action_frame", "x", "z", "heading", "opponent", "targets"):
        np.testing.assert_array_equal(np.asarray(getattr(one, name)[:]), np.asarray(getattr(other, name)[:]))
    for name in one.events.__dataclass_fields__:
        np.testing.assert_array_equal(np.asarray(getattr(one.events, name)), np.asarray(getattr(other.events, name)))


def steps(session, count):
    return [session.step() for _ in range(count)]


def test_a_target_that_is_dragged_is_followed_and_the_session_repeated(session, workplace) -> None:
    played = session(boxer_and_target("tiny"))
    steps(played, 5)
    for frame in range(60):
        played.drag(0, 0.02 * frame, 1.5 + 0.002 * frame, 2.0 + 0.05 * frame)
        played.step()
    steps(played, 30)
    played.record(workplace / "kept")
    assert crowdsim("verify", workplace / "kept", "-q") == 0
    assert crowdsim("run", workplace / "kept" / "scenario.resolved.yaml", "--out", workplace / "again", "-q") == 0
    kept, again = (library.open_run(workplace / name) for name in ("kept", "again"))
    same_take(kept, again)
    assert kept.frame_count == 95
    np.testing.assert_allclose(kept.targets[5 + 20, 0], [0.4, 1.54, 3.0], atol=1e-6)
    np.testing.assert_allclose(kept.targets[90, 0], [1.18, 1.618, 4.95], atol=1e-6)
    # It has gone after it.
    assert np.hypot(kept.x[-1, 0] - 1.18, kept.z[-1, 0] - 4.95) < 2.0


def test_everything_that_can_be_done_is_repeated(session, workplace) -> None:
    played = session(load_scenario(write_scene(workplace / "four.yaml")))
    weights = played.tunings()["boxer"]["behaviours"]
    steps(played, 8)
    played.tune("boxer", next(iter(weights)), 0.3)
    played.tune("boxer", "temperature", 0.3)
    played.tune("boxer", "tempo", 200)
    played.set_on(0, 3)
    played.remove(1)
    frames = steps(played, 12)
    assert frames[-1].opponent[0] == 3
    assert frames[-1].action[1] == -1
    played.add(1)
    played.set_on(0, None)
    frames = steps(played, 12)
    assert frames[-1].action[1] >= 0
    played.remove(2)
    assert steps(played, 2)[-1].action[2] == -1
    played.record(workplace / "kept")
    assert crowdsim("run", workplace / "kept" / "scenario.resolved.yaml", "--out", workplace / "again", "-q") == 0
    same_take(library.open_run(workplace / "kept"), library.open_run(workplace / "again"))


@pytest.mark.parametrize("alone", [False, True])
def test_avatars_that_are_put_elsewhere_are_there_and_the_session_is_repeated(session, workplace, alone) -> None:
    data = scene(types={"boxer": {"policy": "tiny", "damage": {"health": 400, "knock_down": 400, "stagger": 400}}})
    played = session(boxer_and_target("tiny") if alone else load_scenario(data))
    steps(played, 25)
    who, before = 0, played.health()[0].copy()
    if not alone:
        who = int(np.argmin(before))
        assert before[who] < 400
    heading = played.simulation.avatars.heading[played.simulation.avatars.slot_of[who]]
    said = played.place(who, 6.0, -3.0)
    frames = steps(played, 3)
    assert said.endswith("is put at 6.00, -3.00.")
    # Events of the next frame have happened: it is absent for the one after it.
    away = [frame.action[who] for frame in frames]
    assert [one < 0 for one in away] == [False, True, False]
    assert np.hypot(frames[2].x[who] - 6.0, frames[2].z[who] + 3.0) < 0.1
    assert abs(np.angle(np.exp(1j * (frames[2].heading[who] - heading)))) < 0.6
    if not alone:
        assert played.health()[0][who] <= before[who]
    steps(played, 10)
    played.record(workplace / "kept")
    assert crowdsim("verify", workplace / "kept", "-q") == 0
    assert crowdsim("run", workplace / "kept" / "scenario.resolved.yaml", "--out", workplace / "again", "-q") == 0
    same_take(library.open_run(workplace / "kept"), library.open_run(workplace / "again"))


def test_avatars_are_put_beside_others_and_not_into_obstacles_or_out_of_the_arena(session) -> None:
    wall = {"kind": "box", "centre": [8, 0], "size": [6, 6], "height": 2}
    data = scene(arena={"kind": "circle", "radius": 20}, obstacles=[wall])
    played = session(load_scenario(data))
    frame = steps(played, 5)[-1]
    said = played.place(0, float(frame.x[3]), float(frame.z[3]))
    x, z = map(float, re.findall(r"-?\d+\.\d+", said))
    assert 0.4 < np.hypot(x - frame.x[3], z - frame.z[3]) <= 1.01
    for point in ((8.0, 0.0), (30.0, 0.0)):
        with pytest.raises(ScenarioError, match=r"red_1 has no room within 1 m of"):
            played.place(1, *point)
    # Beside an obstacle it keeps off it.
    x, z = map(float, re.findall(r"-?\d+\.\d+", played.place(1, 5.2, 0.0)))
    assert x < 4.8
    with pytest.raises(ScenarioError, match=r"expected x and z up to"):
        played.place(1, float("nan"), 0.0)
    played.remove(2)
    steps(played, 3)
    with pytest.raises(ScenarioError, match=r"blue_0 is not there"):
        played.place(2, 0.0, 4.0)


def test_health_is_restored_and_the_session_is_repeated(session, workplace) -> None:
    data = scene(types={"boxer": {"policy": "tiny", "damage": {"health": 400}}}, duration=600)
    played = session(load_scenario(data))
    while np.count_nonzero(played.health()[0] < 400) < 2:
        played.step()
    low = int(np.argmin(played.health()[0]))
    played.heal(low)
    played.step()
    others = np.arange(4) != low
    rows = played.simulation.avatars.conditions
    assert (played.health()[0][others] < 400).any()
    played.heal()
    played.step()
    assert (rows["health"] == 400).sum() >= 3
    steps(played, 10)
    played.record(workplace / "kept")
    assert crowdsim("run", workplace / "kept" / "scenario.resolved.yaml", "--out", workplace / "again", "-q") == 0
    same_take(library.open_run(workplace / "kept"), library.open_run(workplace / "again"))


def test_tuning_reaches_the_simulation(session) -> None:
    played = session(load_scenario(scene()))
    key = next(iter(played.tunings()["boxer"]["behaviours"]))
    for what, value in ((key, 1.5), ("temperature", 0.4), ("tempo", 90)):
        played.tune("boxer", what, value)
    played.step()
    played.step()
    world = played.simulation._world
    assert (world.weights[:, 0] == 1.5).all()
    assert (world.cohorts["temperature"] == 0.4).all()
    assert (world.cohorts["interval"] == 60 * played.crowd.rate / 90).all()
    assert played.tunings()["boxer"]["tempo"] == 90


def test_sliders_follow_events_of_the_scenario(session) -> None:
    key = next(iter(session(load_scenario(scene())).tunings()["boxer"]["behaviours"]))
    event = {
        "kind": "weights", "when": {"kind": "frame", "frame": 5}, "behaviours": {key: 0.25}, "tempo": 150,
        "temperature": 0.2,
    }  # fmt: skip
    played = session(load_scenario(scene(events=[event])))
    steps(played, 4)
    before = played.tunings()["boxer"]
    assert before["behaviours"][key] != 0.25
    # What is asked for shows at once, and stays where the scenario says nothing else.
    other = list(before["behaviours"])[-1]
    played.tune("boxer", other, 0.75)
    steps(played, 4)
    after = played.tunings()["boxer"]
    assert (after["behaviours"][key], after["tempo"], after["temperature"]) == (0.25, 150, 0.2)
    assert other == key or after["behaviours"][other] == 0.75


def test_a_session_that_nobody_changes_is_the_run(session, workplace) -> None:
    path = write_scene(workplace / "four.yaml", types={"boxer": {"policy": "tiny", "damage": {"health": 40}}})
    played = session(load_scenario(path))
    steps(played, 40)
    played.record(workplace / "kept")
    same_take(library.open_run(workplace / "kept"), library.run(load_scenario(path)))


def test_a_scripted_target_keeps_its_path_until_it_is_dragged(session, workplace) -> None:
    data = scene(targets=CIRCLE, opponents=FOLLOWS, groups=scene()["groups"][:1])
    played, plain = session(load_scenario(data)), library.run(load_scenario(data))
    steps(played, 10)
    played.drag(0, 3.0, 1.4, 0.0)
    steps(played, 10)
    played.record(workplace / "kept")
    kept = library.open_run(workplace / "kept")
    np.testing.assert_array_equal(kept.targets[:10], plain.targets[:10])
    np.testing.assert_array_equal(kept.x[:10], plain.x[:10])
    np.testing.assert_allclose(kept.targets[10:, 0], np.tile([3.0, 1.4, 0.0], (10, 1)))
    written = load_scenario(workplace / "kept" / "scenario.resolved.yaml")
    assert [key[0] for key in written.targets["ball"].keys] == [10]
    assert written.targets["ball"].before.radius == 1.5


def test_a_target_of_a_recording_is_dragged_amid_its_keys(session, workplace) -> None:
    keys = [[0, 0.0, 1.55, 2.0], [7, 1.0, 1.4, 2.3], [23, -0.7, 1.5, 1.9], [30, 0.3, 1.5, 2.0]]
    data = scene(
        targets={"ball": {"kind": "keys", "keys": keys}}, opponents=FOLLOWS, groups=scene()["groups"][:1], duration=40
    )
    played, plain = session(load_scenario(data)), library.run(load_scenario(data))
    steps(played, 12)
    played.drag(0, 3.0, 1.4, 0.0)
    steps(played, 8)
    played.drag(0, 3.1, 1.4, 0.0)
    played.drag(0, 3.2, 1.4, 0.0)
    steps(played, 8)
    played.record(workplace / "kept")
    kept = library.open_run(workplace / "kept")
    np.testing.assert_array_equal(kept.targets[:12], plain.targets[:12])
    np.testing.assert_allclose(kept.targets[12:, 0, 0], [3.0] * 8 + [3.2] * 8)


def test_a_key_amid_others_leaves_the_way_before_it_as_it_was() -> None:
    def path(before=None):
        return KeyPath(15.0, [3, 10, 20], [(0.1, 1.5, 2.0), (0.4, 1.5, 2.3), (9.0, 1.5, 2.0)], before)

    circle = CirclePath(2.0, 0.5, (0.0, 0.0), 1.6)
    for before in (None, circle):
        for frame in range(25):
            one = path(before)
            one.add(frame, (5.0, 1.0, 5.0))
            assert one.frames == sorted(set(one.frames))
            old = target_positions([path(before)], 0, 25, 15.0)
            new = target_positions([one], 0, 25, 15.0)
            np.testing.assert_array_equal(new[:frame], old[:frame])
            np.testing.assert_array_equal(new[frame:, 0], np.tile([5.0, 1.0, 5.0], (25 - frame, 1)))


def test_a_session_begins_again_as_it_began(session) -> None:
    played = session(load_scenario(scene()))
    before = steps(played, 10)
    played.remove(0)
    steps(played, 3)
    played.restart()
    assert (played.frame, played.is_changed) == (0, False)
    after = steps(played, 10)
    np.testing.assert_array_equal(before[-1].x, after[-1].x)


def test_a_session_is_kept_as_a_scenario_that_runs(session, workplace) -> None:
    played = session(load_scenario(scene()))
    steps(played, 6)
    played.remove(3)
    steps(played, 6)
    assert played.is_changed
    played.keep(workplace / "session")
    assert crowdsim("run", workplace / "session" / "scenario.yaml", "--out", workplace / "run", "-q") == 0
    run = library.open_run(workplace / "run")
    assert run.frame_count == 12
    assert (run.action[:, 3] >= 0).sum() in (6, 7)


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda one: one.tune("giant", "tempo", 3), "type 'giant': expected one of boxer"),
        (lambda one: one.tune("boxer", "haste", 3), "'haste' of type 'boxer': expected one of "),
        (lambda one: one.tune("boxer", "temperature", -1), "temperature: Input should be greater than or equal to 0"),
        (lambda one: one.set_on(0, 0), "avatar 0 cannot fight itself"),
        (lambda one: one.set_on(0, 9), "avatar 9: expected a number from 0 to 3"),
        (lambda one: one.remove(-1), "avatar -1: expected a number from 0 to 3"),
        (lambda one: one.add(2), "avatar 2 has not been taken out"),
        (lambda one: one.place(9, 0, 0), "avatar 9: expected a number from 0 to 3"),
        (lambda one: one.heal(1), "nothing hurts red_1, expected an avatar whose type has 'damage'"),
        (lambda one: one.heal(), "nothing hurts or tires these avatars"),
        (lambda one: one.drag(0, 0, 1, 0), "target 0: expected one of 0"),
        (lambda one: one.record("nowhere"), "nothing has been simulated yet"),
    ],
)
def test_what_cannot_be_done_is_refused(session, act, message) -> None:
    played = session(load_scenario(scene()))
    with pytest.raises(ScenarioError, match=re.escape(message)):
        act(played)
    assert not played.is_changed


def test_a_target_cannot_be_dragged_out_of_the_world(session) -> None:
    played = session(boxer_and_target("tiny"))
    for point in ((np.nan, 1, 0), (1e9, 1, 0), (0, -1, 0), (0, 11, 0)):
        with pytest.raises(ScenarioError, match="expected x and z up to"):
            played.drag(0, *point)


def test_a_session_is_not_recorded_over_something_else(session, workplace) -> None:
    played = session(load_scenario(scene()))
    steps(played, 3)
    (workplace / "mine").mkdir()
    (workplace / "mine" / "take.zarr").write_text("mine")
    with pytest.raises(OutputError):
        played.record(workplace / "mine")


def test_after_the_end_nothing_can_be_changed(session) -> None:
    played = session(load_scenario(scene(until={"landed": 1}, linger=0.5)))
    while not played.is_over:
        played.step()
    with pytest.raises(ScenarioError, match="has come to its end"):
        played.remove(0)
    with pytest.raises(RunError, match="is over"):
        played.step()


def test_a_path_of_keys_goes_through_its_keys_and_is_not_foreseen() -> None:
    path = KeyPath(15.0, [0], [(0.0, 1.5, 2.0)])
    path.add(10, (1.0, 1.5, 2.0))
    path.add(11, (2.0, 1.5, 2.0))
    path.add(11, (2.5, 1.5, 2.0))
    assert path.frames == [0, 9, 10, 11]
    there = target_positions([path], 0, 14, 15.0)[:, 0, 0]
    assert there.tolist() == [0.0] * 10 + [1.0, 2.5, 2.5, 2.5]
    # In frame 10, of which frames 9 and 10 are known.
    assert seen_targets([path], 9, 2, 6, 15.0)[:, 0, 0].tolist() == [0.0, 1.0, 1.0, 1.0, 1.0, 1.0]


def test_a_path_before_its_first_key_is_foreseen_as_it_was_planned() -> None:
    circle = CirclePath(2.0, 0.5, (0.0, 0.0), 1.6)
    path = KeyPath(15.0, [20], [(9.0, 1.6, 9.0)], circle)
    planned = target_positions([circle], 0, 40, 15.0)
    np.testing.assert_array_equal(target_positions([path], 0, 20, 15.0), planned[:20])
    np.testing.assert_array_equal(seen_targets([path], 10, 2, 30, 15.0), planned[10:])
    assert (seen_targets([path], 19, 2, 30, 15.0)[1:, 0, 0] == 9.0).all()
    assert path.at_first() is circle


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ([[5, 0, 1, 0], [5, 1, 1, 0]], "targets.ball.keys[1]: is at frame 5, expected one after 5"),
        ([], "targets.ball.keys"),
        ([[0, 0, -1, 0]], "targets.ball.keys[0]"),
    ],
)
def test_keys_that_are_no_path_are_reported(workplace, keys, message) -> None:
    with pytest.raises(ScenarioError) as caught:
        load_scenario(scene(targets={"ball": {"kind": "keys", "keys": keys}}, opponents=FOLLOWS))
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("event", "message"),
    [
        ({"kind": "remove", "group": "red", "member": 2}, "events[0].member: is 2, expected an avatar of 'red'"),
        ({"kind": "retarget", "member": 0, "opponents": {"kind": "fixed", "group": "red"}}, "events[0].member"),
        (
            {"kind": "retarget", "group": "red", "member": 0,
             "opponents": {"kind": "fixed", "group": "red", "member": 0}},
            "would fight themselves",
        ),
        ({"kind": "weights", "type": "giant", "tempo": 20}, "events[0].type: is 'giant', expected a type"),
        ({"kind": "weights", "group": "red"}, "changes nothing"),
        (
            {"kind": "weights", "group": "red", "type": "spare", "tempo": 20},
            "events[0].type: is 'spare', but group 'red' has no avatars of it, expected one that it has: boxer",
        ),
        (
            {"kind": "weights", "type": "spare", "tempo": 20},
            "events[0].type: is 'spare', but the scenario has no avatars of it, expected one that it has: boxer",
        ),
    ],
)  # fmt: skip
def test_events_of_single_avatars_are_checked(workplace, event, message) -> None:
    kinds = {"boxer": {"policy": "tiny"}, "spare": {"policy": "tiny"}}
    with pytest.raises(ScenarioError) as caught:
        load_scenario(scene(types=kinds, events=[{**event, "when": {"kind": "frame", "frame": 1}}]))
    assert message in str(caught.value)


def test_a_time_to_react_needs_a_policy_that_reacts(workplace) -> None:
    kinds = {"boxer": {"policy": "tiny"}, "quick": {"policy": "other", "reaction": 0.1}}
    events = [{"kind": "weights", "when": {"kind": "frame", "frame": 3}, "reaction": 0.3, "type": "boxer"}]
    groups = [*scene()["groups"], {**scene()["groups"][0], "name": "green", "type": "quick"}]
    scenario = load_scenario(scene(types=kinds, groups=groups, events=events), policies={"tiny", "other"})
    learned = {"tiny": ["punch"], "other": ["punch"]}
    for reacting, expected in (
        ([], [("types", "quick", "reaction"), ("events", 0, "reaction")]),
        (["tiny"], [("types", "quick", "reaction")]),
        (["other"], [("events", 0, "reaction")]),
    ):
        found = unlearned_behaviours(scenario, learned, reacting)
        assert [one.loc for one in found] == expected
        assert all("do not react to strikes; expected one whose recipe has" in one.message for one in found)
    assert sees_strikes(["punch", "defend"], {"distance"})
    assert sees_strikes(["punch"], {"distance", "impact"})
    assert not sees_strikes(["punch"], {"distance", "velocity"})


def test_a_session_offers_a_time_to_react_to_those_who_react(session, workplace, capsys) -> None:
    played = session(load_scenario(scene()))
    assert "reaction" not in played.tunings()["boxer"]
    with pytest.raises(ScenarioError, match="'reaction' of type 'boxer': expected one of"):
        played.tune("boxer", "reaction", 0.3)
    event = {"kind": "weights", "when": {"kind": "frame", "frame": 3}, "reaction": 0.3}
    path = write_scene(workplace / "four.yaml", events=[event])
    assert crowdsim("validate", path) == 2
    assert "events[0].reaction: has no effect, avatars of policy 'tiny' do not react" in capsys.readouterr().err
