"""Damage, knock-downs, and ends of runs."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from synthetic_policy import policy
from test_simulation import bytes_of, crowd, whole

from crowdsim.crowd import simulation
from crowdsim.crowd.crowd import Crowding
from crowdsim.crowd.kernels import layout
from crowdsim.crowd.kernels.damage import GRAIN, LATELY, STRONGEST, _in_order
from crowdsim.crowd.kernels.interpolation import between
from crowdsim.crowd.kernels.records import CAPSULE, FALL, LINE, RULE, STRIKE
from crowdsim.crowd.kernels.resolve import resolve
from crowdsim.crowd.model import build_model
from crowdsim.crowd.script import Change, End
from crowdsim.crowd.simulate import simulate
from crowdsim.crowd.simulation import Simulation
from crowdsim.crowd.triggers import Downs, HealthBelow, Landed, LandedOn

POLICIES = [policy(0, "v", name="one")]
HEALTH, HIT, BODY, BLOCKED, STAGGER, DOWN, COUNT, MOST = 60.0, 6.0, 0.5, 0.1, 5.0, 9.0, 12, 3


def rules(count=1, attackers=0, **other):
    given = [HEALTH, HIT, BODY, BLOCKED, STAGGER, DOWN, COUNT, MOST, *other.pop("tires", (0.0, 0.0, 0.0)), attackers]
    return np.tile(np.array(given, float), (count, 1))


def fighters(count=12, **other):
    fields = {"policies": 1, "rules": rules(), "conditioned": True, "spacing": 0.8, **other}
    return crowd(count, **fields)


def with_falls(directions=(0.0, math.pi), kinds=(0, 1, 2)):
    """Return the model of the policy with falls that are made of its actions."""
    model = build_model(POLICIES)
    rows = [
        (turn, 0, kind, 4 * fall + kind, 3 * fall)
        for fall, turn in enumerate(np.asarray(directions, float))
        for kind in kinds
    ]
    return falling(model, rows)


def falling(model, rows):
    """Return a model with these falls, each of its own motion; bodies have no capsules to tread on."""
    count = len(rows)
    return model._replace(
        falls=np.array([(*row, row[4]) for row in rows], FALL),
        fall_axes=np.zeros((count, 2), LINE),
        fall_capsules=np.zeros((count, 0), CAPSULE),
        soles=np.zeros((len(model.ground), 2, 2, 3), np.float32),
    )


def column(name):
    """The column of a rule in ``Crowd.rules``."""
    return RULE.names.index(name)


def run(people, frames=200, model=None, **other):
    one = Simulation(replace(people, policies=POLICIES), model=model, **other)
    return one, whole([one.run(frames)])


def harm(one, events, k):
    """Return what a strike takes, in the frame that a simulation has just done."""
    avatars, model, point, speed = one.avatars, one.model, events.point[k], events.speed[k]
    j, i = (int(avatars.slot_of[number]) for number in (events.victim[k], events.attacker[k]))
    action = avatars.motion["action"][j]
    done = min(avatars.motion["phase"][j], model.actions["length"][action])
    frame = model.actions["origin"][action] + done * model.policies["stride"][0]
    share = 1.0 if point[1] >= between(model.bodies, frame, layout.NECK, 1) * avatars.playback["scale"][j] else BODY
    strength = min(speed / model.sizes["strong"][avatars.policy[i]], STRONGEST)
    share *= BLOCKED if events.outcome[k] == layout.BLOCKED else 1.0
    return math.floor(GRAIN * HIT * strength * share + 0.5) / GRAIN


def test_health_is_what_a_naive_count_of_strikes_leaves():
    one = Simulation(replace(fighters(), policies=POLICIES))
    health, hurt, since, downs = np.full(12, HEALTH), np.zeros(12), np.full(12, -np.inf), np.zeros(12)
    out = np.zeros(12, bool)
    for frame in range(250):
        events = one.run(1).events
        assert (events.damage[~np.isin(events.outcome, (layout.LANDED, layout.BLOCKED))] == 0.0).all()
        hits = np.flatnonzero(np.isin(events.outcome, (layout.LANDED, layout.BLOCKED)) & (events.victim >= 0))
        for k in hits[np.lexsort((events.attacker[hits], events.frame[hits]))]:
            victim = int(events.victim[k])
            if out[victim]:
                assert not events.down[k]
                continue
            taken = harm(one, events, k)
            assert abs(events.damage[k] - taken) <= 2 / GRAIN
            health[victim] = max(health[victim] - taken, 0.0)
            hurt[victim] = (hurt[victim] if frame - since[victim] <= LATELY else 0.0) + taken
            since[victim] = frame
            down = hurt[victim] >= DOWN or health[victim] <= 0.0
            assert events.down[k] == down
            if down:
                downs[victim], hurt[victim] = downs[victim] + 1, 0.0
            out[victim] = downs[victim] >= MOST or health[victim] <= 0.0
        np.testing.assert_allclose(one.avatars.conditions["health"], health, atol=8 / GRAIN)
        assert np.array_equal(one.avatars.conditions["downs"], downs)
    assert downs.sum() > 5


def test_whoever_is_out_leaves_where_its_policy_has_no_falls():
    one, (record, events) = run(fighters(), 400)
    out = np.flatnonzero(one.avatars.conditions["standing"] == layout.OUT)
    gone = np.flatnonzero((record["action"] == -1).any(axis=0))
    assert len(gone)
    assert set(gone) <= set(out)
    for number in gone:
        first = int(np.argmax(record["action"][:, number] == -1))
        assert (record["action"][first:, number] == -1).all()
        assert not (events["attacker"][events["frame"] > first] == number).any()


@pytest.mark.parametrize("search", ["auto", "kd_tree", "scipy"])
def test_nobody_fights_those_who_are_down(search):
    one = Simulation(replace(fighters(), policies=POLICIES), model=with_falls(), search=search)
    deepest = 0
    for _ in range(300):
        one.run(1)
        conditions = one.avatars.conditions
        down = conditions["standing"][one.avatars.number] >= layout.DROPS
        assert np.array_equal(one.avatars.team < 0, down)
        decided = (one.avatars.playback["action_before"] >= 0) & (one.avatars.opponent >= 0)
        decided &= conditions["does"][one.avatars.number] != layout.NOTICES
        # An avatar that has just decided saw which avatars were down a frame before.
        fought = one.avatars.slot_of[one.avatars.opponent[decided]]
        since = conditions["hurt_frame"][one.avatars.number[fought]]
        assert ((one.avatars.team[fought] >= 0) | (since >= one.frame - 1)).all()
        lies = down & (conditions["standing"][one.avatars.number] != layout.DROPS)
        assert (one.avatars.opponent[lies] == -1).all()
        deepest = max(deepest, int(down.sum()))
    assert deepest > 2


def test_whoever_is_knocked_down_falls_lies_and_rises_where_the_blow_came_to():
    model = with_falls()
    one = Simulation(replace(fighters(), policies=POLICIES), model=model)
    seen = [[] for _ in range(12)]
    chosen = []
    for _ in range(400):
        before = one.avatars.conditions["standing"].copy()
        one.run(1)
        hits = np.arctan2(one.avatars.fight["hit_x"], one.avatars.fight["hit_z"])
        for number in range(12):
            slot, now = one.avatars.slot_of[number], one.avatars.conditions[number]
            if now["standing"] == layout.FALLING and before[number] < layout.FALLING:
                chosen.append((math.cos(hits[slot] - one.avatars.heading[slot]), int(now["fall"])))
            seen[number].append(now["standing"])
    # The first direction is ahead, the second behind; blows from the side may lead to either, where most room is.
    clear = [(ahead > 0, fall == 0) for ahead, fall in chosen if abs(ahead) > 0.9]
    assert len(clear) > 3
    assert all(ahead == forward for ahead, forward in clear)
    order = {layout.FALLING: {layout.LYING}, layout.LYING: {layout.RISING}}
    order[layout.RISING] = {layout.UP, layout.FALLING}
    for states in seen:
        for one_state, next_state in itertools.pairwise([key for key, _ in itertools.groupby(states)]):
            if one_state in order:
                assert next_state in order[one_state]


def test_from_the_blow_on_an_avatar_that_is_knocked_down_falls_and_throws_nothing():
    model = with_falls()
    one = Simulation(replace(fighters(), policies=POLICIES), model=model)
    blows, cut, since = [], 0, np.full(12, np.inf)
    for frame in range(400):
        lengths = model.actions["length"]
        before = {int(n): (int(one.avatars.motion["action"][i]), float(one.avatars.motion["phase"][i]))
                  for i, n in enumerate(one.avatars.number)}  # fmt: skip
        events = one.run(1).events
        standing = one.avatars.conditions["standing"]
        for k in np.flatnonzero(events.down):
            victim, blow = int(events.victim[k]), float(events.frame[k])
            if standing[victim] != layout.FALLING:
                continue
            slot = int(one.avatars.slot_of[victim])
            since[victim] = blow
            speed, done = float(one.avatars.motion["speed"][slot]), float(one.avatars.motion["phase"][slot])
            # Motion since the blow, within a playback frame, unless an action began since the last frame.
            action, phase = before[victim]
            ends = phase + speed >= lengths[action]
            if not ends:
                assert abs((frame - blow) * speed - done) <= 1.0 / model.policies["stride"][0] + 1e-6
                cut += phase + speed < lengths[action] - 1.0
            blows.append(victim)
        # These falls are ordinary actions, which strike later.
        assert not (events.frame > since[events.attacker] + 1e-6).any()
        since[:] = np.inf
    assert len(blows) > 10
    assert cut > 3


def struck(*rows):
    """Bytes of what avatars are after strikes of one frame: attacker, victim, time and speed; and which are left."""
    given = rules()
    given[:, column("stagger_from")] = 1.0
    one = Simulation(replace(fighters(4, rules=given), policies=POLICIES), model=with_falls())
    one.run(5)
    one.avatars.conditions["health"][1] = GRAIN**-1
    one.avatars.conditions["health"][2] = 5.0
    strikes = np.zeros(len(rows), STRIKE)
    for row, (attacker, victim, time, share) in zip(strikes, rows, strict=True):
        row["attacker"], row["victim"], row["frame"] = attacker, victim, one.frame - 1.0 + time
        row["outcome"], row["y"], row["speed"] = layout.LANDED, 3.0, share * one.model.sizes["strong"][0]
    felled, left = resolve(one.model, one.avatars, one._world, one.frame, strikes, 0, len(strikes))
    fight = one.avatars.fight[one.avatars.slot_of]
    columns = ["hit_x", "hit_z", "hit_frame", "hit_by"]
    bodies = [[fight[columns][n].tolist(), one.avatars.conditions[n].tolist()] for n in range(4)]
    return felled, strikes["attacker"][:left].tolist(), bodies


@pytest.mark.parametrize("others", [(), ((3, 2, 0.9, 0.02),), ((3, 2, 0.6, 0.9),)])
@pytest.mark.parametrize("turned", [1, -1])
def test_what_one_throws_that_falls_already_does_nothing_to_its_victim(others, turned):
    blow, late, early = (0, 1, 0.5, 0.1), (1, 2, 0.7, 0.8), (1, 2, 0.3, 0.8)
    assert struck(*(blow, late, *others)[::turned]) == struck(*(blow, *others)[::turned])
    assert struck(*(blow, early, *others)[::turned]) != struck(*(blow, *others)[::turned])


@pytest.mark.parametrize("turned", [1, -1])
def test_of_two_that_knock_each_other_down_the_first_to_land_stays_up(turned):
    felled, left, bodies = struck(*((0, 1, 0.5, 0.1), (1, 0, 0.6, 2.0), (2, 1, 0.7, 0.1))[::turned])
    assert felled == 1
    assert sorted(left) == [0, 2]
    assert bodies == struck((0, 1, 0.5, 0.1), (2, 1, 0.7, 0.1))[2]


@pytest.mark.parametrize("turned", [1, -1])
def test_whoever_is_knocked_down_falls_by_that_blow_and_not_by_a_harder_one_after_it(turned):
    felling, harder = (0, 1, 0.5, 0.1), (2, 1, 0.7, 2.0)
    assert struck(*(felling, harder)[::turned])[2][1] == struck(felling)[2][1]


@pytest.mark.parametrize("falls", [False, True])
def test_knock_downs_depend_on_neither_threads_nor_storage_nor_calls(falls, monkeypatch):
    people = fighters(20)
    model = with_falls() if falls else build_model(POLICIES)
    script = dict(changes=(Change(Downs(2), who=np.arange(20) < 5, mode=layout.FLEES),), until=End("down", 6))

    def result(order=None, **other):
        one = Simulation(replace(people, policies=POLICIES, **script), order=order, model=model, **other)
        return bytes_of([one.run(n) for n in (1, 40, 159)])

    expected = result()
    assert result(order=np.random.default_rng(1).permutation(20)) == expected
    monkeypatch.setattr(simulation, "SMALL", 0)
    assert result(threads=2) == expected


@pytest.mark.parametrize("falls", [False, True])
@pytest.mark.parametrize("stop", [30, 77])
def test_a_fight_goes_on_from_its_state(stop, falls):
    model = with_falls() if falls else build_model(POLICIES)
    fearful = Change(HealthBelow(0, 30.0), who=np.arange(12) < 6, mode=layout.WATCHES, distance=2.0)
    script = dict(changes=(fearful,), until=End("down", 4))
    one, two, three = (Simulation(replace(fighters(), policies=POLICIES, **script), model=model) for _ in range(3))
    one.run(stop)
    rest = one.run(200 - stop)
    two.run(stop)
    three.restore(two.state())
    assert bytes_of([three.run(200 - stop)]) == bytes_of([rest])
    assert (three.outcome is None) == (one.outcome is None)
    assert three.frame == one.frame


@pytest.mark.parametrize("lingers", [0.0, 0.1, 20.0])
def test_a_run_goes_on_for_a_while_when_its_end_has_come(lingers):
    frail = rules()
    frail[:, column("full_health")] = 10.0
    people = fighters(6, team=np.arange(6) % 2, rules=frail, skip=np.full(6, -1), spacing=0.5, seed=4)
    one = Simulation(replace(people, policies=POLICIES, until=End("down", 2, lingers)))
    record, _ = whole([one.run(3000)])
    assert one.outcome is not None
    assert one.is_over
    assert one.frame == len(record["action"]) == one.outcome.frame + round(lingers * one.rate)
    assert one.run(5).frames == 0


@pytest.mark.parametrize("kind", ["last_standing", "last_team", "down", "landed"])
def test_a_run_ends_when_its_end_has_come(kind):
    frail = rules()
    frail[:, column("full_health")] = 10.0
    people = fighters(6, team=np.arange(6) % 2, rules=frail, skip=np.full(6, -1), spacing=0.5, seed=4)
    count = {"down": 2, "landed": 10}.get(kind, 0)
    one = Simulation(replace(people, policies=POLICIES, until=End(kind, count)))
    record, events = whole([one.run(3000)])
    ended = one.outcome
    assert ended is not None
    assert ended.kind == kind
    assert one.frame == len(record["action"]) == ended.frame + 45 < 3000
    here = record["action"][ended.frame] >= 0
    if kind == "last_standing":
        assert len(ended.standing) <= 1 < (record["action"][ended.frame - 1] >= 0).sum()
    if kind == "last_team":
        assert len(np.unique(people.cast.teams[ended.standing])) <= 1
    if kind == "down":
        assert len(ended.standing) <= 4
    if kind == "landed":
        landed = np.sort(events["frame"][events["landed"]])
        assert ended.frame - 1 < landed[count - 1] + 1 <= ended.frame + 1
    assert set(ended.standing) == set(np.flatnonzero(here)) or kind == "landed"
    assert one.run(5).frames == 0


def test_changes_wait_for_blows_and_knock_downs():
    group = np.arange(12) % 2
    nobody = {"who": np.ones(12, bool), "skip": np.full(12, -2), "fixed": np.full(12, -1)}
    for trigger in (LandedOn(1, 4), Downs(2, 0), HealthBelow(1, 45.0), Landed(5)):
        one = Simulation(replace(fighters(group=group), policies=POLICIES, changes=(Change(trigger, **nobody),)))
        progress = one._agenda.progress
        for _ in range(300):
            one.run(1)
            due = trigger.is_due(progress)
            if due:
                break
        assert due
        one.run(1)
        assert not one._agenda.pending


def test_no_more_attack_one_opponent_than_may():
    skip, fixed = np.full(9, -2), np.where(np.arange(9) == 0, -1, 0)
    given = rules(attackers=2)
    given[:, column("full_health")] = 0.0
    people = fighters(9, rules=given, skip=skip, fixed=fixed, crowding=Crowding(reach=3.0, most=24))
    one = Simulation(replace(people, policies=POLICIES))
    one.run(30)
    for _ in range(60):
        one.run(1)
        fights = (one.avatars.conditions["does"] == layout.FIGHTS) & (np.arange(9) > 0)
        assert 1 <= fights.sum() <= 4
    assert fights.sum() <= 3


def test_the_exhausted_strike_less():
    def thrown(tires):
        people = fighters(12, interval=3.0, rules=rules(tires=tires) * np.where(np.arange(12) == 0, 0.0, 1.0))
        calm = replace(people.crowding, back=0.0, stunned=0.0)
        _, events = whole(simulate(replace(people, policies=POLICIES, crowding=calm), 300))
        return len(events["frame"])

    assert thrown((0.5, 0.0, 0.0)) < 0.85 * thrown((0.0, 0.0, 0.0))


def test_a_crowd_that_nothing_hurts_has_no_conditions():
    one = Simulation(replace(crowd(), policies=[*POLICIES, policy(1, "q", frames=50, stride=2, name="two")]))
    assert one.avatars.conditions.shape == (0,)


@pytest.mark.parametrize("count", [0, 1, 2, 7, 64, 201])
def test_strikes_are_put_in_the_order_in_which_they_land_and_of_attackers(count):
    rng = np.random.default_rng(count)
    strikes = np.zeros(count + 3, STRIKE)
    strikes["frame"], strikes["attacker"] = rng.integers(0, 9, count + 3) / 8.0, rng.permutation(count + 3)
    some = strikes[2 : count + 2]
    expected = 2 + np.lexsort((some["attacker"], some["frame"]))
    assert _in_order(strikes, 2, count + 2).tolist() == expected.tolist()
