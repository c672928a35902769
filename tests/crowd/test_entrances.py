"""Avatars that travel: they enter one by one along a path and fight at its end, and go away along another."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from naive_places import gap_to
from scenes import crowdsim, scene, write_scene
from test_simulation import bytes_of
from test_state import through_a_file

from crowdsim.crowd.crowd import Crowd, build_avatars
from crowdsim.crowd.draw import draw_crowd
from crowdsim.crowd.entering import AGAIN, first_in_line
from crowdsim.crowd.initial_states import first_actions
from crowdsim.crowd.kernels import layout
from crowdsim.crowd.kernels.layout import Observed
from crowdsim.crowd.kernels.records import STRIKE
from crowdsim.crowd.kernels.terms.pace import AT_NOBODY, OFF_PACE, keep_pace
from crowdsim.crowd.kernels.travelling import AHEAD, see_way
from crowdsim.crowd.model import build_model
from crowdsim.crowd.simulation import Simulation
from crowdsim.crowd.travelling import ARRIVED, GONE, defend_travellers, set_out, travel_on
from crowdsim.places.arrays import pack_parts
from crowdsim.places.description import WallObstacle
from crowdsim.policy.bundle import load_policy
from crowdsim.scenario.scenario import load_scenario
from crowdsim.take.store import open_take

START, CORNER, END = (0.0, -6.0), (0.0, -3.0), (2.0, -2.0)
FRAMES = 150


def keys(enter: dict[str, Any] | None = None, events: tuple = (), late: dict | None = None, **others: Any) -> dict:
    """Keys of a scenario: two red avatars, and three blue ones that come in along a path."""
    blue = {
        "name": "blue", "team": "blue", "type": "boxer", "count": 3,
        "enter": {"path": [START, CORNER, END], "rate": 1.0, "until": "end", **(enter or {})}, **(late or {}),
    }  # fmt: skip
    red = {**scene()["groups"][0], "placement": {"kind": "line", "start": [7, 1], "end": [9, 1]}}
    return scene(duration=FRAMES, pre_roll=0, groups=[red, blue], events=list(events), **others)


@pytest.fixture(scope="module")
def policies(tiny_policy: Path) -> list:
    return [load_policy(tiny_policy)]


def drawn(policies: list, enter: dict[str, Any] | None = None, *events: dict, **others: Any) -> Crowd:
    return draw_crowd(load_scenario(keys(enter, events, **others), policies=["tiny"]), policies)


def is_there(chunk: Any) -> np.ndarray:
    return chunk.action >= 0


def test_avatars_enter_one_by_one_at_the_start_of_their_path_and_look_along_it(policies):
    chunk = Simulation(drawn(policies)).run(60)
    there = is_there(chunk)
    first = [int(np.argmax(there[:, i])) for i in (2, 3, 4)]
    assert first[0] == 0
    for before, now, due in zip(first, first[1:], (15, 30), strict=False):
        # Where the start is not free yet, it is tried again every few frames.
        assert now == due or (now > due and now % AGAIN == 0)
        assert now > before
    for frame, i in zip(first, (2, 3, 4), strict=True):
        np.testing.assert_allclose([chunk.x[frame, i], chunk.z[frame, i]], START, atol=1e-6)
        assert abs(chunk.heading[frame, i]) < 1e-6
        others = there[frame] & (np.arange(5) != i)
        distance = np.hypot(chunk.x[frame, others] - START[0], chunk.z[frame, others] - START[1])
        assert distance.min(initial=9.0) >= 0.8 - 1e-6
        assert not there[:frame, i].any()


def test_travellers_have_no_opponent_follow_their_path_and_fight_at_its_end(policies):
    chunk = Simulation(drawn(policies)).run(FRAMES)
    for i in (2, 3, 4):
        there = np.flatnonzero(is_there(chunk)[:, i])
        travels = there[chunk.opponent[there, i] == -1]
        fights = there[chunk.opponent[there, i] >= 0]
        assert len(fights)
        assert travels.max() < fights.min()
        places = np.column_stack([chunk.x[travels, i], chunk.z[travels, i]])
        assert np.linalg.norm(places - CORNER, axis=1).min() < ARRIVED + 0.3
        # The last action on the way is done before the avatar turns to its opponent.
        assert np.linalg.norm(places - END, axis=1).min() < ARRIVED + 0.3
        assert _distance_from_path(places).max() < 1.2


def _distance_from_path(places):
    best = np.full(len(places), np.inf)
    for a, b in ((START, CORNER), (CORNER, END)):
        a, b = np.array(a), np.array(b)
        share = np.clip((places - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(places - a - share[:, None] * (b - a), axis=1))
    return best


@pytest.mark.parametrize("gait", ["walk", "run"])
def test_travellers_throw_no_strikes(policies, gait):
    chunk = Simulation(drawn(policies, {"gait": gait})).run(FRAMES)
    events = chunk.events
    frame = np.floor(events.frame).astype(int)
    assert (chunk.opponent[frame, events.attacker] != -1).all()
    assert (events.attacker >= 2).any()


def test_an_avatar_waits_behind_those_that_stand_at_the_start_of_its_path(policies):
    one = drawn(policies, {"rate": 1.0})
    x, z = one.x.copy(), one.z.copy()
    x[0], z[0] = START
    chunk = Simulation(replace(one, x=x, z=z, skip=np.full(5, -2, np.int32), fixed=np.full(5, -1, np.int32))).run(40)
    there = is_there(chunk)
    distance = np.hypot(chunk.x[:, 0] - START[0], chunk.z[:, 0] - START[1])
    first = np.argmax(there[:, 2]) if there[:, 2].any() else 40
    assert first > 0
    assert (distance[: first - AGAIN] < 1.0).all()
    whole = Simulation(replace(one, x=x, z=z, skip=np.full(5, -2, np.int32), fixed=np.full(5, -1, np.int32)))
    whole.run(40)
    assert whole.arrivals_text().startswith(("avatar blue_0 was", "2 avatars, blue_0", "3 avatars, blue_0"))


def test_a_group_with_a_placement_takes_its_positions_behind_its_path(policies):
    places = {"kind": "points", "points": [[1.5, -5], [1.5, -3.8], [1.5, -2.6]]}
    one = drawn(policies, {"path": [START, [0, -4.5]]}, late={"placement": places})
    chunk = Simulation(one).run(FRAMES)
    for i, (x, z) in zip((2, 3, 4), places["points"], strict=True):
        there = is_there(chunk)[:, i] & (chunk.opponent[:, i] == -1)
        assert np.hypot(chunk.x[there, i] - x, chunk.z[there, i] - z).min() < ARRIVED + 0.3
        assert np.hypot(chunk.x[there, i][0] - START[0], chunk.z[there, i][0] - START[1]) < 1e-5


ADD = {"kind": "add", "group": "blue", "when": {"kind": "frame", "frame": 20}}


def test_a_waiting_group_begins_to_enter_when_it_is_added_and_not_where_it_is_removed_before(policies):
    chunk = Simulation(drawn(policies, None, ADD, late={"waits": True})).run(60)
    there = is_there(chunk)
    assert [int(np.argmax(there[:, i])) for i in (2, 3)] == [20, 35]
    gone = {"kind": "remove", "group": "blue", "when": {"kind": "frame", "frame": 30}}
    chunk = Simulation(drawn(policies, None, ADD, gone, late={"waits": True})).run(60)
    assert np.flatnonzero(is_there(chunk)[:, 2]).tolist() == list(range(20, 30))
    assert not is_there(chunk)[:, 3:].any()


LEAVE = {"kind": "leave", "group": "red", "path": [[10, 3], [12, 3]], "gait": "run"}


def test_avatars_that_leave_are_gone_at_the_end_of_their_path_and_come_back_when_they_are_added(policies):
    events = (
        {**LEAVE, "when": {"kind": "frame", "frame": 10}},
        {"kind": "add", "group": "red", "when": {"kind": "frame", "frame": 120}},
    )
    chunk = Simulation(drawn(policies, None, *events)).run(FRAMES)
    there = is_there(chunk)
    for i in (0, 1):
        left = int(np.argmin(there[:, i]))
        assert 10 < left < 110
        assert (chunk.opponent[left - 1, i]) == -1
        assert np.hypot(chunk.x[left - 1, i] - 12, chunk.z[left - 1, i] - 3) < GONE + 0.4
        assert not there[left:120, i].any()
        assert there[120:, i].all()
        # They fight again, where they are placed.
        assert np.hypot(chunk.x[120, i] - (7, 9)[i], chunk.z[120, i] - 1) < 1e-5
        assert (chunk.opponent[135:, i] >= 0).any()


def test_winners_leave_when_the_end_has_come(policies):
    near = {**scene()["groups"][0], "placement": {"kind": "line", "start": [-0.5, -1.5], "end": [0.5, -1.5]}}
    event = {**LEAVE, "group": None, "when": {"kind": "ended"}, "path": [[0, 2]], "until": "attacked"}
    del event["group"]
    given = {**keys(None, (event,)), "until": {"landed": 1}, "linger": 9}
    given["groups"][0] = near
    one = draw_crowd(load_scenario(given, policies=["tiny"]), policies)
    whole = Simulation(one)
    chunk = whole.run(FRAMES)
    assert whole.outcome is not None
    ended = whole.outcome.frame
    assert 0 < ended < FRAMES - 30
    assert len(chunk.action) == min(FRAMES, ended + 9 * 15)
    first, rest = Simulation(one), Simulation(one)
    before = first.run(ended)
    assert (before.opponent[-1, :2] >= 0).all()
    first.run(1)
    assert (first.avatars.conditions["mode"][:2] == layout.TRAVELS).all()
    rest.restore(through_a_file(first.state()))
    assert bytes_of([rest.run(40)]) == bytes_of([first.run(40)])
    steps = Simulation(one)
    assert bytes_of([steps.run(count) for count in (1, 7, 3, FRAMES)]) == bytes_of([chunk])


def test_who_leaves_with_low_health_and_rests_at_the_end_does_both_in_any_chunks(policies):
    events = (
        {**LEAVE, "health_below": 99, "when": {"kind": "frame", "frame": 0}, "path": [[0, -40]]},
        {"kind": "rest", "when": {"kind": "ended"}},
    )
    given = {**keys(None, events), "until": {"landed": 1}, "linger": 9}
    given["types"]["boxer"]["damage"] = {}
    given["groups"][0] = {
        **scene()["groups"][0],
        "placement": {"kind": "line", "start": [-0.5, -1.5], "end": [0.5, -1.5]},
    }
    for event in given["events"]:
        event.pop("group", None)
    one = draw_crowd(load_scenario(given, policies=["tiny"]), policies)
    whole, steps = Simulation(one), Simulation(one)
    expected = bytes_of([whole.run(FRAMES)])
    assert whole.outcome is not None
    assert bytes_of([steps.run(1) for _ in range(whole.frame)]) == expected
    np.testing.assert_array_equal(steps.avatars.conditions["mode"], whole.avatars.conditions["mode"])


def test_a_group_that_leaves_while_it_enters_does_not_go_on_entering(policies):
    event = {**LEAVE, "group": "blue", "path": [[0, -7]], "when": {"kind": "frame", "frame": 20}}
    chunk = Simulation(drawn(policies, None, event)).run(FRAMES)
    assert not is_there(chunk)[:, 4].any()
    assert not is_there(chunk)[-1, 2:].any()


def test_avatars_leave_as_soon_as_their_health_is_low(policies):
    def crowd_of(points):
        event = {**LEAVE, "group": "blue", "health_below": points, "when": {"kind": "frame", "frame": 0}}
        near = {"placement": {"kind": "line", "start": [0.5, -1], "end": [3.5, -1]}}
        red = {**scene()["groups"][0], **near}
        one = keys({"path": [START, [0, -5]], "rate": 2.0}, (event,), types={"boxer": {"policy": "tiny", "damage": {}}})
        one["groups"][0] = red
        return draw_crowd(load_scenario(one, policies=["tiny"]), policies)

    simulation = Simulation(crowd_of(99.9))
    healths, modes = [], []
    for _ in range(FRAMES):
        simulation.step()
        healths.append(simulation.avatars.conditions["health"].copy())
        modes.append(simulation.avatars.conditions["travel"].copy())
    healths, modes = np.array(healths), np.array(modes)
    hurt = healths[:, 2:] < 99.9
    assert hurt.any()
    assert not hurt.all(axis=1).all()
    leaves = modes[1:, 2:] == 2.0
    # An avatar leaves from the frame on in which it is hurt, and none before.
    assert not leaves[~hurt[1:]].any()
    out = simulation._agenda.progress.out[2:]
    assert leaves[hurt[:-1] & ~out].all()
    never = Simulation(crowd_of(0.001))
    never.run(FRAMES)
    assert not (never.avatars.conditions["travel"] == 2.0).any()


def test_travellers_come_in_where_no_strike_has_to_follow(policies):
    model, many = build_model(policies), np.zeros(3000, int)
    state = int(model.actions["next"][first_actions(3, many, model, np.arange(1), many[:1])[0]])
    # Strikes are counted up to each action: from one state on, each action has one.
    model.actions["strikes"][model.offsets[state] :] += 1
    for k in range(model.offsets[state], model.offsets[state + 1]):
        model.actions["strikes"][k + 1 :] += 1
    for calm in (False, True):
        actions = first_actions(3, many, model, np.arange(3000), many, calm)
        assert (model.actions["next"][actions] == state).any() != calm
        assert len(np.unique(actions)) > 10


def travellers(policies, until: str) -> tuple[Crowd, Any]:
    one = drawn(policies, {"until": until})
    avatars = build_avatars(one, build_model(policies))
    set_out(one, avatars, np.array([2, 3, 4]), 0, 1)
    return one, avatars


@pytest.mark.parametrize("until", ["attacked", "end"])
def test_avatars_that_are_attacked_fight_if_their_path_says_so(policies, until):
    one, avatars = travellers(policies, until)
    thrown = np.zeros(3, STRIKE)
    thrown["victim"] = [3, 0, -1]
    thrown["outcome"] = [layout.MISSED, layout.LANDED, layout.MISSED]
    defend_travellers(one, avatars, thrown)
    mode = avatars.conditions["mode"]
    assert mode[[2, 4]].tolist() == [layout.TRAVELS, layout.TRAVELS]
    assert mode[3] == (layout.FIGHTS if until == "attacked" else layout.TRAVELS)
    assert mode[0] == layout.FIGHTS


def test_travellers_are_led_from_point_to_point(policies):
    one, avatars = travellers(policies, "end")

    def at(number, x, z):
        avatars.x[avatars.slot_of[number]], avatars.z[avatars.slot_of[number]] = x, z

    def way(number):
        row = avatars.conditions[number]
        return float(row["way_x"]), float(row["way_z"])

    at(2, 0.0, -4.0)  # not there yet
    at(3, 0.0, CORNER[1] - 0.9 * ARRIVED)
    at(4, 2.0, CORNER[1] + 0.1)  # past it
    assert travel_on(one, avatars, 5).tolist() == []
    assert (way(2), way(3), way(4)) == (CORNER, END, END)
    at(3, *END)
    assert travel_on(one, avatars, 5).tolist() == []
    assert avatars.conditions["mode"][[2, 3, 4]].tolist() == [layout.TRAVELS, layout.FIGHTS, layout.TRAVELS]
    assert avatars.conditions["travel"][[2, 3, 4]].tolist() == [1.0, 0.0, 1.0]
    # Absent avatars go nowhere.
    at(2, *CORNER)
    present = int(avatars.slot_of[2])
    travel_on(one, avatars, present)
    assert way(2) == CORNER


def test_of_those_that_wait_at_one_path_the_first_may_enter(policies):
    one = drawn(policies)
    assert first_in_line(one, {}).tolist() == []
    assert first_in_line(one, {4: 0, 2: 15, 3: 0, 0: 3, 1: 9}).tolist() == [0, 1, 3]
    assert first_in_line(replace(one, entries=np.zeros(0, np.int32)), {4: 0, 2: 15}).tolist() == [2, 4]


@pytest.mark.parametrize("scale", [0.9, 1.2])
def test_a_traveller_sees_its_way_ahead_and_prefers_actions_at_its_pace_without_strikes(policies, scale):
    one, _ = travellers(policies, "end")
    one = replace(one, cast=replace(one.cast, scales=np.full(5, scale, np.float32)), present=np.ones(5, bool))
    simulation = Simulation(one)
    model, avatars, scratch = simulation.model, simulation.avatars, simulation._scratch
    set_out(one, avatars, np.array([2]), 0, 1)
    own = int(avatars.slot_of[2])
    avatars.x[own], avatars.z[own] = 0.5, -4.0
    alone = Observed(np.full(1, -1, np.int32), np.zeros(1, np.int32), np.zeros((1, 12), np.int32))
    target = see_way(model, avatars, simulation._world, 0.0, own, alone, 0)
    there = np.array([0.5, -4.0]) + AHEAD * scale * np.array([-0.5, 1.0]) / np.hypot(0.5, 1.0)
    np.testing.assert_allclose([target.x, target.z], there, atol=1e-6)
    assert avatars.fight["next_opponent"][own] == -1
    assert avatars.conditions["does_next"][2] == layout.TRAVELS
    scratch.situations["x"][0], scratch.situations["z"][0] = -1.0, 3.0
    scratch.values[0] = 0.0
    keep_pace(model, avatars, simulation._world, simulation._now, own, alone, 0, scratch)
    state = model.actions["next"][avatars.motion["action"][own]]
    actions = range(model.offsets[state], model.offsets[state + 1])
    assert len(actions) > 1
    for k, action in enumerate(actions):
        along = (3.0 * model.moves["z"][action] - model.moves["x"][action]) / np.hypot(1.0, 3.0)
        pace = along / (model.actions["length"][action] / avatars.motion["speed"][own])
        strikes = model.actions["strikes"][action + 1] - model.actions["strikes"][action]
        expected = -OFF_PACE * abs(pace - one.travels[0].pace) - AT_NOBODY * strikes
        assert scratch.values[0, k] == pytest.approx(expected, abs=1e-5)
    avatars.conditions["does_next"][2], scratch.values[0] = layout.FIGHTS, 0.0
    keep_pace(model, avatars, simulation._world, simulation._now, own, alone, 0, scratch)
    assert not scratch.values[0].any()


def test_travellers_go_around_walls_that_are_in_their_way(policies):
    wall = [{"kind": "wall", "points": [[-1.6, -4.5], [1.0, -4.5]]}]
    chunk = Simulation(drawn(policies, obstacles=wall)).run(FRAMES)
    (part,) = pack_parts([(0, WallObstacle.model_validate(wall[0]))], None)
    for i in (2, 3, 4):
        there = is_there(chunk)[:, i]
        x, z = chunk.x[there, i], chunk.z[there, i]
        assert min(gap_to(part, *point) for point in zip(x, z, strict=True)) > 0.1
    first = np.column_stack([chunk.x[:, 2], chunk.z[:, 2]])
    assert first[np.argmin(np.abs(first[:, 1] + 4.5)), 0] > 1.0
    assert np.hypot(*(first - END).T).min() < 1.0


def busy(policies) -> Crowd:
    """A crowd that enters, is attacked, leaves on conditions and comes back."""
    events = (
        {**LEAVE, "when": {"kind": "frame", "frame": 60}, "until": "attacked"},
        {**LEAVE, "group": "blue", "health_below": 95.0, "when": {"kind": "frame", "frame": 5}, "path": [[0, -4]]},
        {"kind": "add", "group": "red", "when": {"kind": "frame", "frame": 130}},
    )
    types = {"boxer": {"policy": "tiny", "damage": {}}}
    return drawn(policies, {"until": "attacked", "rate": 1.3}, *events, types=types)


@pytest.mark.parametrize("search", ["auto", "kd_tree"])
def test_travels_go_on_from_a_state_and_depend_on_no_threads_order_or_steps(policies, search):
    one = busy(policies)
    whole = Simulation(one, 1, search)
    expected = bytes_of([whole.run(FRAMES)])
    assert bytes_of([Simulation(one, 2, "kd_tree", order=np.array([4, 2, 0, 1, 3])).run(FRAMES)]) == expected
    steps = Simulation(one, 1, search)
    assert bytes_of([steps.run(count) for count in (1, 2, 11, 40, 96)]) == expected
    for stop in (10, 33, 70, 125):
        first, second = Simulation(one, 1, search), Simulation(one, 1, search)
        before = first.run(stop)
        second.restore(through_a_file(first.state()))
        assert bytes_of([before, second.run(FRAMES - stop)]) == expected
        assert {key: values.tobytes() for key, values in second.state().items()} == {
            key: values.tobytes() for key, values in whole.state().items()
        }


def test_states_with_paths_that_there_are_not_are_refused(policies):
    one = busy(policies)
    simulation = Simulation(one)
    simulation.run(10)
    state = simulation.state()
    assert state["agenda.expected"].tolist() == [[3, 11], [4, 23]]
    for name, value in (("travel", 4.0), ("travel", 0.5), ("travel", 0.0), ("leg", 3.0), ("leg", -1.0), ("mode", 5.0)):
        wrong = {key: values.copy() for key, values in state.items()}
        wrong[f"avatars.conditions.{name}"][2] = value
        with pytest.raises(ValueError, match=f"array 'avatars.conditions.{name}' holds .*, which is out of range"):
            Simulation(one).restore(wrong)
    for name, values in (
        ("agenda.expected", [[9, 20]]), ("agenda.expected", [[2, 20]]), ("agenda.expected", [[3, -1]]),
        ("agenda.standing", [7]),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=f"array '{name}' holds .*, which is out of range"):
            Simulation(one).restore({**state, name: np.array(values)})


def findings(workplace: Path, capsys, data: dict) -> str:
    path = write_scene(workplace / "four.yaml", **data)
    capsys.readouterr()
    crowdsim("validate", path)
    return capsys.readouterr().err


@pytest.mark.parametrize(
    ("enter", "expected"),
    [
        ({"path": [[0, 0]]},
         "groups[1].enter.path: has 1 point, expected 2 or more: where avatars appear, and where they go"),
        ({"path": [[0, 0], [0, 0.05]]},
         "groups[1].enter.path[1]: is nearer than 0.1 m to the point before it, expected a way between them"),
        ({"path": [[0, 0], [0, 4001]]}, "groups[1].enter.path[1][1]: is 4001, expected a number from -4000 to 4000"),
        ({"rate": 0}, "groups[1].enter.rate: is 0, expected a number above 0"),
        ({"gait": "crawl"}, "groups[1].enter.gait: is 'crawl', expected 'walk' or 'run'"),
        ({"gait": "runn"}, "groups[1].enter.gait: is 'runn', expected 'walk' or 'run' (did you mean 'run'?)"),
        ({"until": "never"}, "groups[1].enter.until: is 'never', expected 'attacked' or 'end'"),
        ({"speed": 2}, "groups[1].enter.speed: unknown key, expected path, rate, gait or until"),
        ({"rate": 0.11},
         "groups[1].enter.rate: is 0.11, so that 2 of 3 avatars enter before the end after 150 control frames (10 s)"),
    ],
)  # fmt: skip
def test_entrances_that_cannot_be_are_findings(workplace, capsys, enter, expected):
    assert expected in findings(workplace, capsys, keys(enter))


@pytest.mark.parametrize(
    ("event", "expected"),
    [
        ({"path": []}, "events[0].path: has 0 points, expected 1 or more: where avatars go"),
        (
            {"health_below": 50, "until": "attacked"},
            "events[0].until: is 'attacked', but avatars whose health is low leave again at once",
        ),
        ({"when": {"kind": "ended"}}, "events[0].when: never comes without 'until', expected an 'until'"),
        ({"gait": "hop"}, "events[0].gait: is 'hop', expected 'walk' or 'run'"),
        ({"group": "rde"}, "events[0].group: is 'rde', expected a group: red or blue (did you mean 'red'?)"),
        ({"health_below": 50}, "events[0].health_below: nothing hurts these avatars, expected 'damage' of their type"),
        ({"when": {"kind": "seconds", "seconds": 99}}, "events[0].when.seconds: is 99, but the run ends after"),
    ],
)
def test_exits_that_cannot_be_are_findings(workplace, capsys, event, expected):
    event = {**LEAVE, "when": {"kind": "frame", "frame": 3}, **event}
    assert expected in findings(workplace, capsys, keys(None, (event,)))


def test_groups_that_never_come_or_are_nowhere_are_findings(workplace, capsys):
    assert "groups[1].waits: no event adds the group, expected one of kind 'add'" in findings(
        workplace, capsys, keys(late={"waits": True})
    )
    assert "groups[1].facing: has no effect with 'enter', since avatars look along their path" in findings(
        workplace, capsys, keys(late={"facing": "enemies"})
    )
    both = keys()
    del both["groups"][1]["enter"]
    assert "groups[1].placement: missing, expected a mapping with 'kind', or 'enter' with a path" in findings(
        workplace, capsys, both
    )
    assert "events[0].group: is 'red', which is there from the start" in findings(
        workplace, capsys, keys(None, ({**ADD, "group": "red"},))
    )
    assert findings(workplace, capsys, keys(None, (ADD,), {"waits": True})) == ""


def test_a_run_in_which_avatars_travel_is_exported_and_extended(workplace):
    red = {**LEAVE, "when": {"kind": "frame", "frame": 100}}
    path = write_scene(workplace / "four.yaml", **keys(None, (red,)), outputs={"bvh": {"avatars": ["blue"]}})
    assert crowdsim("run", path, "--out", "run") == 0
    assert crowdsim("verify", "run") == 0
    assert {one.name for one in (workplace / "run" / "bvh").iterdir()} == {
        "blue_0.bvh", "blue_1.bvh", "blue_2.bvh", "avatars.csv",
    }  # fmt: skip
    assert crowdsim("run", path, "--out", "run", "--extend", "50") == 0
    assert crowdsim("run", path, "--out", "undisturbed", "--frames", "200") == 0
    result, expected = (open_take(workplace / name / "take.zarr") for name in ("run", "undisturbed"))
    for name in ("action", "action_frame", "x", "z", "heading", "opponent"):
        assert np.array_equal(getattr(result, name)[:], getattr(expected, name)[:], equal_nan=True)
    assert (result.action[:] >= 0).all(axis=1).any()
