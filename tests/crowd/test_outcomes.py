"""What becomes of strikes: landed, blocked, evaded, missed."""

import math
from dataclasses import replace

import naive_strikes
import numpy as np
import pytest
from avatar_fields import set_fields
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_policy import policy

from crowdsim.crowd.crowd import build_avatars, build_crowd
from crowdsim.crowd.events import OUTCOMES
from crowdsim.crowd.kernels.layout import BLOCKED, EVADED, LANDED, MISSED, Now
from crowdsim.crowd.kernels.outcomes import Strike, judge, note_seen
from crowdsim.crowd.model import build_model
from crowdsim.crowd.model_arms import arm_rows, way_rows
from crowdsim.crowd.script import CirclePath
from crowdsim.crowd.simulation import Simulation
from crowdsim.motion import ground
from crowdsim.motion.strikes import LIMBS

POLICY = policy(0)
HEAD, REACH = np.array([0.0, 1.6, 0.0]), 0.8
AWAY = np.array([0.0, 0.2, -3.0])
WORLD = st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(-3, 3))


def at(*point):
    return np.array(point, float)


def pair(glove=AWAY, elbow=AWAY, seen=HEAD, head=HEAD, place=(0.0, 0.0, 0.0), target=None, shield=None):
    """Two avatars face to face, 0.8 m apart; the first strikes straight at where a head of a standing body is.

    ``place`` is the attacker's ground frame, all else is seen from the victim's. Returns the outcome.
    """
    trunk = np.stack([head, head - [0, 0.15, 0], [0, 0.95, 0]])
    model = build_model([POLICY])
    frames = len(model.ground)
    way = [[0.0, 1.6, REACH - 0.6], [0.0, 1.6, REACH - 0.4]]
    model = model._replace(
        ground=np.zeros_like(model.ground),
        starts=np.zeros_like(model.starts),
        bodies=np.tile(trunk, (frames, 1, 1)).astype(np.float32),
        arms=np.tile(np.stack([elbow, AWAY, glove, AWAY]), (frames, 1, 1)).astype(np.float32),
        ways=np.tile(np.array(way, np.float32), (len(model.ways), 1, 1)),
    )
    if shield is not None:
        model = model._replace(shields=np.array([[0, 0, 0, 0], shield], np.float32))
    x, z, turn = place
    avatars = build_avatars(build_crowd(np.zeros(2), np.zeros(2)), model)
    victim = x + REACH * math.sin(turn), z + REACH * math.cos(turn), turn + math.pi
    for i, (px, pz, heading) in enumerate((place, victim)):
        set_fields(avatars, "x z heading end_x end_z base_turn", i, (px, pz, heading) * 2)
    avatars.playback["action_before"] = -1
    opponent, now, then, targets = 1, Now(1, 1, 2), np.zeros((2, 0, 3)), np.zeros((2, 0, 3))
    if target is not None:
        opponent, then, targets = -2, np.tile(seen, (2, 1, 1)), np.tile(target, (2, 1, 1))
    avatars.fight["next_opponent"][0] = opponent
    action = int(np.flatnonzero(np.diff(model.actions["strikes"]))[0])
    first = int(model.actions["strikes"][action])
    for name, value in (("x", 0.0), ("y", 1.6), ("z", REACH - 0.05), ("from_x", 0.0), ("from_z", REACH - 0.05)):
        model.strikes[name][first] = value
    looked = np.stack([seen, seen - [0, 0.15, 0], [0, 0.95, 0]])
    looked = model._replace(bodies=np.tile(looked, (frames, 1, 1)).astype(np.float32))
    note_seen(looked, avatars, then, now, 0, action)
    avatars.fight["decisions"][0] += 1
    avatars.motion["action"][0] = action
    end = x + (REACH - 0.05) * math.sin(turn), 1.6, z + (REACH - 0.05) * math.cos(turn)
    thrown = Strike(first, action, opponent, end, (end[0], end[2]), 1.0, False)
    outcome, point = judge(model, avatars, targets, now, 0, thrown)
    if outcome == BLOCKED and shield is None:
        assert_on_arm(np.array(point), glove, elbow, victim)
    elif outcome != BLOCKED:
        assert tuple(point) == end
    return outcome


def assert_on_arm(point, glove, elbow, victim):
    """A strike is blocked where it is in forearm or glove, which are large in these bodies."""
    glove, elbow = ground.to_world(victim, glove), ground.to_world(victim, elbow)
    assert min(naive_strikes.from_line(point, glove, elbow) - 0.07, np.linalg.norm(point - glove) - 0.12) < 1e-4


@settings(max_examples=40, deadline=None)
@given(place=WORLD, ahead=st.floats(0.2, 0.4), aside=st.floats(-0.08, 0.08))
def test_a_fist_that_comes_straight_at_a_raised_glove_is_blocked_and_without_the_glove_it_lands(place, ahead, aside):
    glove = HEAD + at(aside, 0.0, ahead)
    assert pair(place=place) == LANDED
    assert pair(glove=glove, elbow=glove - [0, 0.3, 0], place=place) == BLOCKED
    assert pair(glove=glove, elbow=glove + at(0, 0.3, 0), place=place) == BLOCKED


@settings(max_examples=40, deadline=None)
@given(place=WORLD, ahead=st.floats(0.2, 0.4), height=st.floats(-0.08, 0.08))
def test_a_forearm_across_the_way_blocks(place, ahead, height):
    middle = HEAD + at(0.0, height * 0.4, ahead)
    assert pair(glove=middle + at(0.2, 0, 0), elbow=middle - [0.2, 0, 0], place=place) == BLOCKED


@pytest.mark.parametrize(
    ("glove", "elbow"),
    [
        (HEAD + at(0.3, 0.0, 0.3), HEAD + at(0.3, -0.3, 0.2)),  # beside the way
        (HEAD + at(0.0, 0.0, -0.3), HEAD + at(0.1, -0.3, -0.3)),  # behind the head
        (HEAD + at(0.0, -0.3, 0.3), HEAD + at(0.1, -0.4, 0.1)),  # under it
        (HEAD + at(0.0, 0.0, 1.0), HEAD + at(0.0, -0.3, 1.0)),  # behind the fist
    ],
)
def test_a_guard_elsewhere_lets_a_fist_through(glove, elbow):
    assert pair(glove=glove, elbow=elbow) == LANDED


@settings(max_examples=40, deadline=None)
@given(place=WORLD, down=st.floats(0.45, 0.6), aside=st.floats(-0.1, 0.1))
def test_a_head_that_has_ducked_since_the_decision_evades(place, down, aside):
    ducked = HEAD - [aside, down, 0.0]
    assert pair(head=ducked, place=place) == EVADED
    assert pair(head=ducked, seen=ducked, place=place) == MISSED
    assert pair(head=ducked, glove=HEAD + at(0, 0, 0.3), elbow=HEAD + at(0, -0.3, 0.3), place=place) == EVADED


def test_scripted_targets_never_block_and_evade_when_they_have_moved():
    here = np.array([0.0, 1.6, REACH])
    assert pair(target=here) == LANDED
    assert pair(target=here + at(1, 0, 0), seen=here) == EVADED
    assert pair(target=here + at(1, 0, 0), seen=here + at(1, 0, 0)) == MISSED


def offsets_of(body):
    return [*body.fist_offsets, *body.foot_offsets]


def test_elbows_and_fists_are_where_the_motion_has_them():
    database, rows = POLICY.database, arm_rows(POLICY.database)
    for frame in (0, 17, len(rows) - 1):
        for number, side in enumerate(("left", "right")):
            elbow = naive_strikes.limb_at(POLICY, frame, f"{side}_elbow", np.zeros(3))
            expected = ground.to_local(database.ground[frame], elbow)
            np.testing.assert_allclose(rows[frame, number], expected, atol=1e-5)
            np.testing.assert_array_equal(rows[frame, 2 + number], database.fists[frame, number])


def test_ways_begin_no_earlier_than_their_clip():
    early = replace(POLICY, database=replace(POLICY.database, clip_starts=np.array([0, 20, 40], np.int32)))
    first = early.database.stride * 20
    strikes = np.array(POLICY.database.strike_frames)
    strikes[:] = first + 1
    early = replace(early, database=replace(early.database, strike_frames=strikes))
    starts = np.zeros((early.actions.action_count, 3))
    ways = way_rows([early], [starts])
    limbs = early.database.strike_limbs[early.actions.strike_ids]
    for limb, (role, offset) in enumerate(zip(LIMBS[:4], offsets_of(early.database.body), strict=True)):
        expected = naive_strikes.limb_at(early, first, role, offset)
        mine = ways[limbs == limb]
        np.testing.assert_allclose(mine, np.broadcast_to(expected, mine.shape), atol=1e-5)


def test_a_crowd_sees_all_outcomes_and_targets_do_not_block():
    people = build_crowd(np.arange(12) % 4 * 0.8, np.arange(12) // 4 * 0.8, np.arange(12.0), seed=3)
    events = Simulation(replace(people, policies=[POLICY])).run(300).events
    counts = np.bincount(events.outcome, minlength=len(OUTCOMES))
    assert (counts > 5).all(), dict(zip(OUTCOMES, counts, strict=True))
    assert np.array_equal(events.landed, events.outcome == LANDED)
    people = build_crowd(np.arange(6.0), np.zeros(6), skip=np.full(6, -2), fixed=np.full(6, -2))
    events = (
        Simulation(replace(people, policies=[POLICY], targets=(CirclePath(2.0, 1.0, (1.0, 1.0), 1.5),))).run(300).events
    )
    assert set(np.unique(events.outcome)) <= {MISSED, LANDED, EVADED}


def test_the_outcome_does_not_depend_on_storage_or_stages():
    people = build_crowd(np.arange(12) % 4 * 0.8, np.arange(12) // 4 * 0.8, np.arange(12.0), seed=3)
    runs = [
        Simulation(replace(people, policies=[POLICY]), search=search, order=order).run(120).events
        for search, order in (("auto", None), ("kd_tree", None), ("auto", np.arange(12)[::-1]))
    ]
    assert runs[0].outcome.tobytes() == runs[1].outcome.tobytes() == runs[2].outcome.tobytes()


def test_a_shield_blocks_what_the_glove_beside_it_lets_through():
    beside = at(0.2, 1.6, 0.3)
    assert pair(glove=beside, elbow=at(0.4, 1.2, 0.3)) == LANDED
    assert pair(glove=beside, elbow=at(0.4, 1.2, 0.3), shield=(0, 0, 0.25, 0)) == BLOCKED
    assert pair(glove=beside, elbow=at(0.4, 1.2, 0.3), shield=(0, 0, 0, 0.25)) == LANDED
    # On the forearm, which is further away.
    assert pair(glove=at(0.4, 1.4, 0.3), elbow=at(0.4, 1.8, 0.3), shield=(0.3, 0, 0, 0)) == LANDED
    assert pair(glove=at(0.25, 1.4, 0.3), elbow=at(0.25, 1.8, 0.3), shield=(0.3, 0, 0, 0)) == BLOCKED
