from dataclasses import replace

import numpy as np
import pytest
from avatar_fields import fields, set_fields
from synthetic_policy import policy

from crowdsim.crowd.crowd import Crowding, build_avatars, build_crowd
from crowdsim.crowd.draw import _crowding
from crowdsim.crowd.kernels.layout import BLOCKED, LANDED, MISSED
from crowdsim.crowd.kernels.records import STRIKE
from crowdsim.crowd.kernels.resolve import FOOT, GUARDED, note_hits
from crowdsim.crowd.kernels.shown_motion import LATEST
from crowdsim.crowd.kernels.terms.collision_avoidance import FURTHEST, LIGHT, PUSHED, STEP, push_left
from crowdsim.crowd.kernels.terms.stunned import STUNS
from crowdsim.crowd.model import build_model, strong_speed
from crowdsim.crowd.simulate import simulate
from crowdsim.crowd.simulation import Simulation
from crowdsim.scenario.scenario import load_scenario

POLICIES = [policy(0, frames=240)]


def run(frames=300, apart=1.0, **fields):
    """Nine avatars on a lattice, who strike at those who look away too; their chunk."""
    z, x = np.divmod(np.arange(9), 3)
    fields = {
        "crowding": Crowding(unseen=0.0, wasted=0.0, back=0.0, stunned=0.0),
        "temperature": 0.3,
        "margin": 1.0,
        **fields,
    }
    people = build_crowd(apart * x, apart * z, x - z, seed=1, **fields)
    (chunk,) = simulate(replace(people, policies=POLICIES), frames, chunk=frames)
    return chunk


def ends(chunk):
    """For each decision from the second on: frame, avatar, and the state in which its action ends."""
    new = chunk.action_frame[1:] <= chunk.action_frame[:-1]
    frame, avatar = np.nonzero(new)
    return frame + 1, avatar, POLICIES[0].actions.next[chunk.action[frame + 1, avatar]]


def shown_by_others(chunk, lately=30):
    """Share of decisions for motion that another avatar started less than so many frames before."""
    frame, avatar, state = ends(chunk)
    again = [
        (avatar[(frame < f) & (frame > f - lately) & (state == s)] != a).any()
        for f, a, s in zip(frame, avatar, state, strict=True)
    ]
    return float(np.mean(again))


def test_variety_lets_avatars_avoid_the_motion_of_others():
    # Avatars in cells of their own are alone with their taste.
    assert shown_by_others(run(variety=5.0)) < shown_by_others(run(variety=0.0)) - 0.02
    assert shown_by_others(run(variety=5.0)) < shown_by_others(run(variety=5.0, apart=40.0))


def test_variety_lets_avatars_avoid_their_own_motion():
    def again(chunk):
        _, avatar, state = ends(chunk)
        own = [state[avatar == i] for i in range(9)]
        return np.mean([one[k] in one[max(0, k - LATEST) : k] for one in own for k in range(len(one))])

    assert again(run(variety=5.0)) < again(run(variety=0.0)) - 0.02


def test_opponents_throw_no_strike_at_the_same_time():
    def together(variety):
        chunk = run(900, variety=variety)
        rows = np.arange(len(chunk.action))[:, None]
        other = np.maximum(chunk.opponent, 0)
        mutual = (chunk.opponent >= 0) & (chunk.opponent[rows, other] == np.arange(9))
        actions = POLICIES[0].actions
        strikes = np.diff(actions.strike_offsets)[chunk.action] > 0
        same = actions.next[chunk.action] == actions.next[chunk.action[rows, other]]
        remaining = actions.lengths[chunk.action] - chunk.action_frame
        near = np.abs(remaining - remaining[rows, other]) < 5
        return np.count_nonzero(mutual & strikes & strikes[rows, other] & same & near)

    assert together(1.0) < 0.2 * together(0.0)


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 2, 0)])
def test_of_several_hits_in_a_frame_the_strongest_counts(order):
    people = build_crowd([0.0, 1.0, 0.0, 3.0], [0.0, 0.0, 2.0, 3.0])
    model = build_model(POLICIES)
    avatars = build_avatars(people, model)
    strong = strong_speed(POLICIES[0])
    strikes = np.zeros(3, STRIKE)
    strikes["attacker"], strikes["limb"], strikes["outcome"] = (1, 2, 3), (0, 1, 1), (LANDED, LANDED, MISSED)
    strikes["speed"] = 0.8 * strong, 1.2 * strong, 9.0 * strong
    note_hits(model, avatars, 7, strikes[list(order)], 0, 3)
    assert avatars.fight["hit_by"].tolist() == [2, -1, -1, -1]
    assert avatars.fight["hit_frame"][0] == 7
    np.testing.assert_allclose(fields(avatars, "hit_x hit_z", 0), [0.0, -1.2], atol=1e-12)


@pytest.mark.parametrize(
    ("limb", "outcome", "scale", "strength"),
    [(0, LANDED, 1.0, 1.0), (2, LANDED, 1.0, FOOT), (0, BLOCKED, 1.0, GUARDED), (1, LANDED, 1.1, 1.1**3)],
)
def test_a_hit_is_as_strong_as_its_impulse(limb, outcome, scale, strength):
    people = build_crowd([0.0, 1.0], [0.0, 0.0])
    cast = replace(people.cast, scales=np.array([1.0, scale]))
    model = build_model(POLICIES)
    avatars = build_avatars(replace(people, cast=cast), model)
    strikes = np.zeros(1, STRIKE)
    strikes["attacker"], strikes["limb"], strikes["outcome"] = 1, limb, outcome
    strikes["speed"] = strong_speed(POLICIES[0])
    note_hits(model, avatars, 7, strikes, 0, 1)
    np.testing.assert_allclose(fields(avatars, "hit_x hit_z", 0), [-strength, 0.0], atol=1e-12)


def test_a_hit_stuns_for_longer_the_stronger_it_is():
    rng = np.random.default_rng(1)
    count = 300
    # Pairs that fight at arm's length: without a hit some of them strike.
    x, z = 10.0 * np.repeat(np.arange(count // 2), 2), np.tile([0.0, 0.9], count // 2)
    people = build_crowd(x, z, np.tile([0.0, np.pi], count // 2) + rng.uniform(-0.2, 0.2, count), temperature=0.3,
                         margin=1.0, crowding=replace(Crowding.none(), stunned=4.0))  # fmt: skip

    def thrown(strength, ago, stunned=4.0):
        one = Simulation(replace(people, policies=POLICIES, crowding=replace(people.crowding, stunned=stunned)))
        set_fields(one.avatars, "hit_x hit_z hit_frame", slice(None), [[strength], [0.0], [-1 - ago]])
        chunk = one.run(1)
        return np.diff(POLICIES[0].actions.strike_offsets)[chunk.action[0]].sum()

    usual = thrown(0.0, 0)
    assert usual > 20
    assert thrown(1.0, 0) < 0.2 * usual
    assert thrown(0.4, 8) == thrown(1.0, STUNS) == thrown(1.5, 0, stunned=0.0) == usual
    assert thrown(1.0, 8) < usual


def test_a_strong_hit_costs_a_step():
    rng = np.random.default_rng(0)
    x, z = rng.uniform(-90, 90, (2, 300))
    people = build_crowd(x, z, rng.uniform(-3, 3, 300), temperature=0.0,
                         crowding=Crowding(wasted=0.0, stunned=0.0))  # fmt: skip

    def moved(strength, frame):
        simulation = Simulation(replace(people, policies=POLICIES))
        avatars = simulation.avatars
        set_fields(avatars, "hit_x hit_z hit_frame", slice(None), [[strength * 0.6], [strength * 0.8], [frame]])
        simulation.run(1)
        ways = fields(avatars, "end_x end_z") - fields(avatars, "x z")
        return 0.6 * ways[0] + 0.8 * ways[1]

    weak, strong = moved(0.5 * LIGHT, -1), moved(0.8, -1)
    assert np.mean(strong - weak) > 0.01
    assert np.array_equal(weak, moved(2.0, -1 - PUSHED))


def test_a_hit_pushes_further_the_stronger_it_is_and_less_as_time_passes():
    avatars = build_avatars(build_crowd([0.0], [0.0]), build_model(POLICIES))

    def left(strength, since):
        set_fields(avatars, "hit_x hit_z hit_frame", slice(None), [[0.6 * strength], [0.8 * strength], [10.0]])
        return push_left(avatars, 10 + since, 0)

    assert left(1.0, 0) == pytest.approx(STEP)
    assert left(1.2, 0) == pytest.approx(1.44 * STEP)
    assert left(9.0, 0) == FURTHEST
    assert left(1.0, 4) == pytest.approx((1.0 - 4.0 / (PUSHED + 1.0)) * STEP)
    assert left(0.99 * LIGHT, 0) == left(1.0, PUSHED + 1) == 0.0


def test_a_policy_without_strikes_has_no_strong_ones():
    still = replace(POLICIES[0].database, strike_speeds=np.zeros(0, np.float32))
    assert strong_speed(replace(POLICIES[0], database=still)) == np.inf


@pytest.mark.parametrize("looks_away", [True, False])
def test_few_strike_from_behind(looks_away):
    # Pairs far from one another; the second of each looks away from the first, or at it.
    x = 10.0 * np.repeat(np.arange(100.0), 2)
    z = np.tile([0.0, 0.9], 100)
    heading = np.tile([0.0, 0.0 if looks_away else np.pi], 100)

    def strikes(unseen):
        crowding = replace(Crowding.none(), unseen=unseen)
        people = build_crowd(x, z, heading, temperature=0.3, margin=1.0, crowding=crowding)
        (chunk,) = simulate(replace(people, policies=POLICIES), 1, chunk=1)
        return np.diff(POLICIES[0].actions.strike_offsets)[chunk.action[0, ::2]].sum()

    assert strikes(0.0) > 20
    assert strikes(2.0) < 0.5 * strikes(0.0) if looks_away else strikes(2.0) == strikes(0.0)


def test_scenarios_without_reactions_neither_push_nor_stun():
    on, off = (_crowding(load_scenario("duel", [f"reactions={value}"])) for value in ("true", "false"))
    assert (off.back, off.stunned) == (0.0, 0.0)
    assert on == Crowding()
    assert replace(off, back=on.back, stunned=on.stunned) == on
