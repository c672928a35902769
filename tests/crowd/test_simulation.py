import dataclasses
from dataclasses import replace
from types import SimpleNamespace

import naive_crowd
import numpy as np
import pytest
from avatar_fields import set_situations
from naive_policy import action_values
from synthetic_policy import policy, with_axes

from crowdsim.crowd import buffers, simulation
from crowdsim.crowd.buffers import empty_record, empty_scratch
from crowdsim.crowd.crowd import Crowding, build_crowd
from crowdsim.crowd.draw import draw_crowd
from crowdsim.crowd.events import VARIABLES
from crowdsim.crowd.kernels.layout import LANDED
from crowdsim.crowd.kernels.values import value_actions
from crowdsim.crowd.model import build_model, farthest
from crowdsim.crowd.script import Change, CirclePath, LinePath
from crowdsim.crowd.simulate import simulate
from crowdsim.crowd.simulation import Simulation
from crowdsim.crowd.triggers import AtFrame, Landed, Near
from crowdsim.errors import RunError
from crowdsim.policy.bundle import encode
from crowdsim.policy.environment import Axis
from crowdsim.policy.rewards import ProximityTerm, StrikeTerm, TransitionTerm
from crowdsim.scenario.scenario import load_scenario

FURTHER = {
    "headings": [Axis("heading", -np.pi, np.pi, 5, wraps=True)],
    "velocities": [Axis("velocity", -0.1, 0.1, 4)],
    "impacts": [Axis("impact", 0.0, 8.0, 5)],
}
STRIKES = StrikeTerm(kind="strike", tolerance=0.3)
POLICIES = [policy(0, "v", name="one"), policy(1, "q", frames=50, stride=2, name="two")]


def crowd(count=12, seed=0, spacing=1.0, policies=2, **other):
    rng = np.random.default_rng(seed)
    side = int(np.ceil(np.sqrt(count)))
    z, x = np.divmod(np.arange(count), side)
    fields = {
        "policy": rng.integers(0, policies, count),
        "scale": rng.uniform(0.9, 1.1, count),
        "speed": rng.uniform(0.8, 1.4, count),
        "arena": np.array([1.0, side / 2, side / 2, side * 0.7, side * 0.7]),
        "seed": seed,
        "variety": 1.0,
        **other,
    }
    jitter = rng.normal(0, 0.1, (2, count))
    return build_crowd(x * spacing + jitter[0], z * spacing + jitter[1], rng.uniform(-3, 3, count), **fields)


def near(**fields):
    return ProximityTerm(kind="proximity", **{"distance": 0.5, **fields})


def whole(chunks):
    """All chunks as one: what is recorded, and the strikes."""
    parts = list(chunks)
    record = {name: np.concatenate([getattr(part, name) for part in parts]) for name in VARIABLES}
    fields = [field.name for field in dataclasses.fields(parts[0].events)]
    events = {name: np.concatenate([getattr(part.events, name) for part in parts]) for name in fields}
    return record, events


def bytes_of(chunks):
    record, events = whole(chunks)
    return {**{k: v.tobytes() for k, v in record.items()}, **{f"events.{k}": v.tobytes() for k, v in events.items()}}


@pytest.mark.parametrize(
    ("name", "fields", "targets"),
    [
        ("free for all", {}, ()),
        ("two teams", {"team": np.arange(12) % 2}, ()),
        ("fixed opponents", {"skip": np.full(12, -2), "fixed": np.roll(np.arange(12), 3)}, ()),
        ("nobody to fight", {"skip": np.full(12, -2), "fixed": np.full(12, -1)}, ()),
        (
            "scripted targets",
            {"skip": np.full(12, -2), "fixed": np.where(np.arange(12) % 2, -2, -3)},
            (CirclePath(2.0, 1.0, (1.0, 1.0), 1.5), LinePath(np.array([[0.0, 0.0], [3.0, 1.0]]), 0.7, True, 1.6)),
        ),
        ("a rectangle", {"arena": np.array([2.0, 1.5, 1.5, 1.0, 2.0])}, ()),
        ("the best action only", {"temperature": 0.0}, ()),
        ("no collision avoidance", {"crowding": Crowding.none()}, ()),
        ("no variety", {"variety": 0.0}, ()),
        ("much variety for some", {"variety": 20.0, "spacing": 6.0, "interval": 20.0}, ()),
        ("bursts and rests", {"interval": 20.0}, ()),
        ("two teams that rest", {"interval": 90.0, "team": np.arange(12) % 2}, ()),
        ("nothing worth less than the best", {"margin": 0.0}, ()),
        ("two candidates of wide choice", {"temperature": 2.0, "margin": 50.0, "most": 2}, ()),
    ],
)
def test_a_run_is_that_of_the_naive_twin(name, fields, targets):
    compare_with_twin(crowd(**fields, targets=targets), POLICIES)


@pytest.mark.parametrize(
    ("fields", "targets"),
    [
        ({}, ()),
        ({"skip": np.full(12, -2), "fixed": np.full(12, -2)}, (CirclePath(2.0, 1.0, (1.0, 1.0), 1.5),)),
    ],
    ids=["free for all", "a scripted target"],
)
@pytest.mark.parametrize("axes", FURTHER.values(), ids=FURTHER.keys())
def test_a_run_with_policies_that_see_more_is_that_of_the_naive_twin(fields, targets, axes):
    people = crowd(**fields, targets=targets, reactions=np.array([1]))
    seeing = [with_axes(one, *axes) for one in POLICIES]
    compare_with_twin(people, seeing)
    assert not np.array_equal(*(whole(simulate(replace(people, policies=tuple(all_of)), 60))[0]["action"]
                                for all_of in (seeing, POLICIES)))  # fmt: skip


def compare_with_twin(people, policies):
    """Compare a run of 60 control frames with the naive one."""
    record, events = whole(simulate(replace(people, policies=tuple(policies)), 60))
    naive = naive_crowd.run(people, policies, 60)
    assert np.array_equal(record["action"], naive.action)
    assert np.array_equal(record["opponent"], naive.opponent)
    for variable in ("action_frame", "x", "z"):
        np.testing.assert_allclose(record[variable], getattr(naive, variable), atol=2e-5)
    turned = record["heading"] - naive.heading
    np.testing.assert_allclose(np.sin(turned / 2), 0, atol=2e-5)
    assert len(events["frame"]) == len(naive.strikes) > 20
    for k, strike in enumerate(naive.strikes):
        assert (events["attacker"][k], events["victim"][k], events["limb"][k]) == strike[1:4]
        np.testing.assert_allclose(events["frame"][k], strike[0], atol=1e-5)
        np.testing.assert_allclose(events["point"][k], strike[4:7], atol=2e-5)
        np.testing.assert_allclose(events["speed"][k], strike[7], rtol=1e-5)
        assert events["outcome"][k] == strike[8]
        assert events["landed"][k] == (strike[8] == LANDED)


@pytest.mark.parametrize("lookup", ["v", "q"])
@pytest.mark.parametrize("precisions", [("float32", "float32"), ("int8", "int8"), ("int8", "float32")])
def test_actions_are_worth_what_the_policy_says(lookup, precisions):
    one, two = policy(4, lookup), policy(5, "q" if lookup == "v" else "v", frames=30)
    one, two = (in_precision(each, precision) for each, precision in zip((one, two), precisions, strict=True))
    model = build_model([one, two])
    assert model.table.dtype == (np.uint8 if precisions == ("int8", "int8") else np.float32)
    rng = np.random.default_rng(2)
    scratch = empty_scratch(model, 1, 60)
    scratch.order[:] = rng.permutation(60)
    for index, chosen in enumerate((one, two)):
        states = rng.integers(chosen.actions.state_count, size=60)
        targets, weights = rng.uniform([-3, 1.0, -3], [3, 1.9, 3], (60, 3)), rng.uniform(0, 2, (60, 2))
        set_situations(scratch, targets)
        scratch.cohorts[:], scratch.policies[:] = np.arange(60), index
        scratch.states[:] = states + model.policies["states"][index]
        scratch.values[:] = np.nan
        value_actions(model, weights, scratch, 0, 60)
        for k in range(60):
            named = {b.name: weights[k, column] for column, b in enumerate(chosen.behaviours)}
            expected = action_values(chosen, named, states[k], targets[k])
            np.testing.assert_allclose(scratch.values[k, : len(expected)], expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(
    "terms",
    [
        [near(), near(sigma=10.0)],
        [near(weight=0.3, sigma=0.7), near(weight=2.0, sigma=4.0), near(sigma=0.2)],
        [near(), near(distance=1.5), near(distance=1.5, sigma=3.0)],
        [near(facing=True), near(sigma=3.0, facing=True), near(sigma=3.0)],
        [near(form="max"), near(form="max", sigma=3.0), near(sigma=3.0), near(form="max")],
        [near(), STRIKES, near(sigma=10.0), TransitionTerm(kind="transition"), near(sigma=2.0)],
        [near(weight=0.0), near(sigma=10.0)],
    ],
    ids=["two widths", "three weights", "two distances", "facing", "the greatest", "others between", "no weight"],
)
def test_terms_of_proximity_add_up_whatever_they_share(terms):
    chosen = policy(4, "v")
    chosen = replace(chosen, behaviours=tuple(replace(each, terms=tuple(terms)) for each in chosen.behaviours))
    model = build_model([chosen])
    rng = np.random.default_rng(4)
    scratch = empty_scratch(model, 1, 30)
    states, targets = rng.integers(chosen.actions.state_count, size=30), rng.uniform([-3, 1, -3], [3, 1.9, 3], (30, 3))
    scratch.order[:], scratch.cohorts[:], scratch.policies[:], scratch.states[:] = np.arange(30), 0, 0, states
    set_situations(scratch, targets)
    value_actions(model, np.ones((1, 2)), scratch, 0, 30)
    for k in range(30):
        expected = action_values(chosen, {each.name: 1.0 for each in chosen.behaviours}, states[k], targets[k])
        np.testing.assert_allclose(scratch.values[k, : len(expected)], expected, rtol=1e-6, atol=1e-6)


def test_a_target_beyond_all_grids_is_seen_where_they_end():
    chosen = policy(4, "v")
    grids = [replace(b.grid, axes=tuple(replace(axis, fade=0.0) for axis in b.grid.axes)) for b in chosen.behaviours]
    behaviours = [replace(b, grid=grid) for b, grid in zip(chosen.behaviours, grids, strict=True)]
    chosen = replace(chosen, behaviours=tuple(behaviours))
    model = build_model([chosen])
    end = farthest(chosen)
    assert end == max(axis.maximum for grid in grids for axis in grid.axes if axis.name == "distance")
    scratch = empty_scratch(model, 1, 20)
    rng = np.random.default_rng(3)
    bearings = rng.uniform(-3, 3, 20)
    at_end = end * np.stack([np.sin(bearings), np.zeros(20), np.cos(bearings)], axis=-1) + [0.0, 1.5, 0.0]
    states = rng.integers(chosen.actions.state_count, size=20)
    scratch.order[:], scratch.cohorts[:], scratch.policies[:], scratch.states[:] = np.arange(20), 0, 0, states
    set_situations(scratch, (at_end - [0.0, 1.5, 0.0]) * rng.uniform(1.1, 9.0, (20, 1)) + [0.0, 1.5, 0.0])
    value_actions(model, np.ones((1, 2)), scratch, 0, 20)
    for k in range(20):
        expected = action_values(chosen, {b.name: 1.0 for b in behaviours}, states[k], at_end[k])
        assert np.ptp(expected) > 0.0
        np.testing.assert_allclose(scratch.values[k, : len(expected)], expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("lookup", ["v", "q"])
def test_a_behaviour_counts_less_beyond_its_bearings(lookup):
    chosen = policy(4, lookup)

    def narrow(axis):
        return replace(axis, minimum=-1.0, maximum=1.0, wraps=False, fade=1.5) if axis.name == "bearing" else axis

    grids = [replace(b.grid, axes=tuple(narrow(axis) for axis in b.grid.axes)) for b in chosen.behaviours]
    behaviours = [replace(b, grid=grid) for b, grid in zip(chosen.behaviours, grids, strict=True)]
    chosen = replace(chosen, behaviours=tuple(behaviours))
    model, scratch = build_model([chosen]), empty_scratch(build_model([chosen]), 1, 40)
    bearings = np.linspace(-3, 3, 40)
    targets = np.stack([np.sin(bearings), np.full(40, 1.5), np.cos(bearings)], axis=-1)
    scratch.order[:], scratch.cohorts[:], scratch.policies[:], scratch.states[:] = np.arange(40), 0, 0, 2
    set_situations(scratch, targets)
    value_actions(model, np.ones((1, 2)), scratch, 0, 40)
    assert np.all(scratch.values[0, :2] == 0.0), "nothing counts behind"
    for k in range(40):
        expected = action_values(chosen, {b.name: 1.0 for b in behaviours}, 2, targets[k])
        np.testing.assert_allclose(scratch.values[k, : len(expected)], expected, rtol=1e-6, atol=1e-6)


def in_precision(chosen, precision):
    """Return a policy whose tables are stored so."""
    behaviours = []
    for behaviour in chosen.behaviours:
        table, low, step = encode(behaviour.table, precision)
        behaviours.append(replace(behaviour, table=table, low=low, step=step))
    values = np.concatenate([behaviour.table for behaviour in behaviours])
    return replace(chosen, behaviours=tuple(behaviours), values=values)


@pytest.mark.parametrize("team", [None, np.arange(40) % 3])
def test_stages_frames_and_chunks_give_the_same_bytes(team, monkeypatch):
    people = crowd(40, team=team)
    together = bytes_of(simulate(replace(people, policies=POLICIES), 40))
    assert bytes_of(simulate(replace(people, policies=POLICIES), 40, chunk=7)) == together
    monkeypatch.setattr(simulation, "SMALL", 0)
    assert bytes_of(simulate(replace(people, policies=POLICIES), 40)) == together
    assert bytes_of(simulate(replace(people, policies=POLICIES), 40, search="scipy")) == together


def lattice(count, **fields):
    """A crowd of one size and pace in exact rows, where many are equally far away from each other."""
    z, x = np.divmod(np.random.default_rng(5).permutation(count), int(np.sqrt(count)))
    return build_crowd(x, z, policy=np.arange(count) % 2, **fields)


@pytest.mark.parametrize(
    "people",
    [
        crowd(30),
        crowd(200, team=np.arange(200) % 2),
        crowd(350, team=np.arange(350) % 3),
        lattice(30),
        lattice(400, team=np.arange(400) % 2),
        lattice(500),
        crowd(30, present=np.arange(30) > 9),
    ],
    ids=["brawl", "two teams", "three teams", "ties", "ties of two teams", "ties of many", "some absent"],
)
def test_every_search_gives_the_same_bytes(people):
    late = ~people.present
    script = dict(changes=(Change(AtFrame(7), who=late, present=True),) if late.any() else ())
    auto = bytes_of(simulate(replace(people, policies=POLICIES, **script), 20))
    for search in ("kd_tree", "scipy"):
        assert bytes_of(simulate(replace(people, policies=POLICIES, **script), 20, search=search)) == auto


def test_a_crowd_of_any_size_is_searched_as_it_was_asked_for():
    for count, auto in ((30, "direct"), (500, "kd_tree")):
        for search, expected in (("auto", auto), ("kd_tree", "kd_tree"), ("scipy", "scipy")):
            run = Simulation(replace(crowd(count), policies=POLICIES), search=search)
            run.run(3)
            assert run.searches == [expected]


@pytest.mark.parametrize("team", [None, np.arange(6000) % 2])
def test_threads_and_the_order_of_storage_change_no_byte(team):
    people = crowd(6000, team=team)
    one = bytes_of(simulate(replace(people, policies=POLICIES), 25))
    order = np.random.default_rng(3).permutation(6000)
    assert bytes_of(simulate(replace(people, policies=POLICIES), 25, threads=2)) == one
    assert bytes_of(simulate(replace(people, policies=POLICIES), 25, order=order)) == one
    assert bytes_of(simulate(replace(people, policies=POLICIES), 25, search="scipy")) == one


def test_the_order_of_storage_changes_no_byte_of_a_small_crowd():
    people = crowd(30)
    assert bytes_of(simulate(replace(people, policies=POLICIES), 50)) == bytes_of(
        simulate(replace(people, policies=POLICIES), 50, order=np.arange(30)[::-1])
    )


def test_another_seed_gives_another_run():
    assert bytes_of(simulate(replace(crowd(seed=1), policies=POLICIES), 20)) != bytes_of(
        simulate(replace(crowd(seed=2), policies=POLICIES), 20)
    )


def test_avatars_go_on_from_where_their_last_action_has_ended():
    people = crowd(20, speed=1.0, policy=0)
    record, _ = whole(simulate(replace(people, policies=POLICIES), 80))
    ground = POLICIES[0].database.ground
    fastest = np.hypot(*np.diff(ground[::4, :2], axis=0).T).max() * people.cast.scales.max()
    steps = np.hypot(np.diff(record["x"], axis=0), np.diff(record["z"], axis=0))
    shifts = POLICIES[0].actions.shifts[:, :2]
    assert steps.max() <= fastest * 1.05 + np.hypot(*shifts.T).max() * people.cast.scales.max()
    assert (record["action_frame"] == np.round(record["action_frame"])).all()


@pytest.mark.parametrize("held", [np.nan, np.inf, -1e9])
def test_what_memory_held_before_changes_no_result(held, monkeypatch):
    def dirty(shape, dtype=float):
        values = np.empty(shape, dtype)
        if values.dtype.kind == "f":
            values[...] = held
        return values

    expected = bytes_of(simulate(replace(crowd(30), policies=POLICIES), 200))
    namespace = SimpleNamespace(**{**vars(np), "empty": dirty})
    monkeypatch.setattr(buffers, "np", namespace)
    assert bytes_of(simulate(replace(crowd(30), policies=POLICIES), 200)) == expected


def test_speed_makes_decisions_come_so_much_sooner():
    slow, fast = (Simulation(replace(crowd(30, speed=speed, policy=0), policies=POLICIES)) for speed in (0.5, 1.0))
    slow.run(400)
    fast.run(200)
    decisions = [one.avatars.fight["decisions"].mean() for one in (slow, fast)]
    np.testing.assert_allclose(decisions[0], decisions[1], rtol=0.05)


def test_a_table_that_is_no_number_names_avatar_and_frame():
    broken = policy(0, "v")
    broken.values[:] = np.nan
    with pytest.raises(RunError, match=r"avatar \d+ at control frame \d+"):
        list(simulate(replace(crowd(policies=1), policies=[broken]), 10))


def test_motion_that_is_no_number_names_avatar_and_frame():
    broken = policy(0, "v")
    broken.database.ground[50:] = np.nan
    for count in (12, 500):
        with pytest.raises(RunError, match=r"avatar \d+ at control frame \d+"):
            list(simulate(replace(crowd(count, policies=1), policies=[broken]), 30))


def test_an_avatar_that_starts_nowhere_is_refused_by_its_number():
    people = crowd()
    people.x[7] = np.nan
    with pytest.raises(RunError, match="avatar 7 starts at"):
        next(simulate(replace(people, policies=POLICIES), 5))


def test_one_avatar_alone_keeps_moving():
    record, _ = whole(simulate(replace(crowd(1), policies=POLICIES), 30))
    assert (record["opponent"] == -1).all()
    assert np.ptp(record["x"]) > 0


@pytest.mark.parametrize("count", [12, 500])
def test_groups_enter_and_leave(count):
    late = np.arange(count) % 3 == 0
    gone = np.arange(count) % 3 == 1
    people = crowd(count, present=~late)
    script = dict(changes=(Change(AtFrame(10), who=late, present=True), Change(AtFrame(20), who=gone, present=False)))
    record, events = whole(simulate(replace(people, policies=POLICIES, **script), 60))
    assert (record["action"][:10, late] == -1).all()
    assert (record["action"][10:, late] >= 0).all()
    away = np.hypot(record["x"][10, late] - people.x[late], record["z"][10, late] - people.z[late])
    assert np.median(away) < 1e-5
    assert away.max() < 1.0 + 1e-5
    assert (record["action"][20:, gone] == -1).all()
    assert np.isnan(record["x"][20:, gone]).all()
    assert not np.isin(events["attacker"][events["frame"] < 10], np.flatnonzero(late)).any()
    # An avatar that has decided since has another opponent; the longest action is over by then.
    assert not np.isin(record["opponent"][50:, ~gone], np.flatnonzero(gone)).any()
    assert bytes_of(simulate(replace(people, policies=POLICIES, **script), 30, chunk=4)) == bytes_of(
        simulate(replace(people, policies=POLICIES, **script), 30)
    )


def test_those_who_enter_a_small_crowd_change_nothing_in_how_it_runs(monkeypatch):
    people = crowd(30, present=np.arange(30) > 9)
    script = dict(changes=(Change(AtFrame(7), who=np.arange(30) < 10, present=True),))
    together = bytes_of(simulate(replace(people, policies=POLICIES, **script), 30))
    monkeypatch.setattr(simulation, "SMALL", 0)
    assert bytes_of(simulate(replace(people, policies=POLICIES, **script), 30)) == together


def test_a_change_waits_for_its_condition():
    people = crowd(20, team=np.arange(20) % 2, group=np.arange(20) % 2)
    nobody = {"who": np.ones(20, bool), "skip": np.full(20, -2), "fixed": np.full(20, -1)}
    _, before = whole(simulate(replace(people, policies=POLICIES), 200))
    third = int(np.ceil(before["frame"][before["landed"]][2]))
    record, _ = whole(simulate(replace(people, policies=POLICIES, changes=(Change(Landed(3), **nobody),)), 200))
    frames = np.flatnonzero((record["opponent"] == -1).any(axis=1))
    assert frames[0] >= third + 1
    record, _ = whole(simulate(replace(people, policies=POLICIES, changes=(Change(Near(0, 1, 100.0), **nobody),)), 60))
    assert (record["opponent"][0] >= 0).all()
    assert (record["opponent"][30:] == -1).any()


def test_weights_are_needed_for_every_behaviour():
    people = crowd(4)
    with pytest.raises(RunError, match="weights of 1 behaviours, expected 2"):
        Simulation(replace(people, weights=people.weights[:, :1], policies=POLICIES))


def test_new_weights_change_what_avatars_do():
    people = crowd(20)
    change = Change(AtFrame(20), weights=np.array([[0.0, np.nan]]), temperatures=np.array([np.nan]))
    one, _ = whole(simulate(replace(people, policies=POLICIES), 40))
    two, _ = whole(simulate(replace(people, policies=POLICIES, changes=(change,)), 40))
    assert np.array_equal(one["action"][:20], two["action"][:20])
    assert not np.array_equal(one["action"], two["action"])


def test_keeping_apart_keeps_bodies_apart():
    def overlap(crowding):
        record, _ = whole(
            simulate(replace(crowd(36, crowding=crowding, policies=1, speed=1.0), policies=POLICIES), 150)
        )
        x, z = record["x"], record["z"]
        near = np.hypot(x[:, :, None] - x[:, None], z[:, :, None] - z[:, None]) < 0.4
        return near.sum(axis=2).mean() - 1

    assert overlap(Crowding(wasted=0.0)) < 0.5 * overlap(Crowding.none())


def test_a_scenario_may_let_avatars_walk_through_one_another():
    for said, rules in ((True, Crowding()), (False, Crowding.none())):
        changes = ["types.boxer.behaviours={fight: 1}", f"collision_avoidance={str(said).lower()}"]
        scenario = load_scenario("brawl_30", changes)
        chosen = POLICIES[0]
        fight = replace(chosen.behaviours[0], name="fight")
        boxer = [replace(chosen, name="boxer", behaviours=(fight, *chosen.behaviours[1:]))]
        assert draw_crowd(scenario, boxer).crowding == rules


def test_avatars_turn_back_at_the_border():
    far = crowd(9, arena=np.zeros(5), speed=1.0, policies=1)
    kept = crowd(9, arena=np.array([1.0, 1.5, 1.5, 2.0, 2.0]), speed=1.0, policies=1)

    def reach(people):
        record, _ = whole(simulate(replace(people, policies=POLICIES), 400))
        return np.hypot(record["x"] - 1.5, record["z"] - 1.5).max()

    assert reach(kept) < 4.5
    assert reach(kept) < reach(far)


@pytest.mark.parametrize("count", [12, 500])
def test_scopes_add_up_to_the_whole(count):
    chunks = list(simulate(replace(crowd(count), policies=POLICIES), 20, profiled=True))
    timings = np.concatenate([chunk.timings for chunk in chunks])
    assert timings.shape == (20, len(simulation.STAGES))
    assert (timings >= 0).all()
    assert timings[:, 1:].sum() > 0
    assert all(chunk.timings is None for chunk in simulate(replace(crowd(count), policies=POLICIES), 2))


def test_an_unknown_index_is_refused_with_those_there_are():
    with pytest.raises(RunError, match="expected one of auto, kd_tree, scipy"):
        Simulation(replace(crowd(), policies=POLICIES), search="kd_tre")


def test_policies_of_different_rates_are_refused():
    other = policy(3)
    other = dataclasses.replace(other, database=dataclasses.replace(other.database, control_rate=30.0))
    with pytest.raises(RunError, match="one control rate"):
        build_model([POLICIES[0], other])


def test_some_rows_of_a_record_are_of_the_same_kind_as_all():
    from numba import typeof

    record = empty_record(5, 3)
    assert {values.shape for values in record} == {(5, 3)}
    for rows in (record.rows(0, 5), record.rows(0, 1), record.rows(2, 4), empty_record(1, 3).rows(0, 1)):
        assert typeof(rows) == typeof(record)


def test_events_happen_in_the_same_frame_when_a_run_is_stepped():
    late, first = np.arange(30) > 19, np.arange(30) == 0
    changes = Change(Near(0, 1, 1000.0), who=first, present=False), Change(AtFrame(10), who=late, present=True)
    people = replace(crowd(30, present=~late, group=late.astype(np.int64)), policies=POLICIES, changes=changes)
    record, _ = whole(simulate(people, 20))
    with Simulation(people) as one:
        stepped = np.stack([one.step().action for _ in range(20)])
    np.testing.assert_array_equal(stepped, record["action"])
    assert np.argmax(record["action"][:, 0] < 0) == 11
