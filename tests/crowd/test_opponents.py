from dataclasses import replace

import naive_crowd
import naive_opponents
import numpy as np
import pytest
from synthetic_policy import policy

from crowdsim.crowd.arrays import BY_SLOT, Avatars
from crowdsim.crowd.crowd import build_avatars, build_crowd
from crowdsim.crowd.kernels.layout import Now, Observed
from crowdsim.crowd.kernels.opponents import AVERTED, BEHIND, REMEMBERED, change_opponent, observe_all
from crowdsim.crowd.kernels.records import COHORT
from crowdsim.crowd.model import build_model
from crowdsim.crowd.opponents import build_index, store_in_order
from crowdsim.crowd.workers import Workers

POLICY = policy(0)
MODEL = build_model([POLICY])


def avatars_of(count, team, seed=0, **other):
    rng = np.random.default_rng(seed)
    # On a lattice, so that many are equally far away.
    x, z = np.divmod(rng.permutation(count), int(np.sqrt(count)))
    return build_avatars(build_crowd(x, z, team=team, **other), MODEL)


def observed(index, avatars, present):
    """Number of the opponent of each avatar, and its neighbours' numbers, by number."""
    index.update(avatars, present)
    due = np.arange(present, dtype=np.int32)
    found, counts = np.empty(present, np.int32), np.empty(present, np.int32)
    near = np.empty((present, 12), np.int32)
    index.observe(avatars, due, 1.5, Observed(found, counts, near))
    who = np.full(len(avatars.number), -1)
    who[avatars.number[:present]] = np.where(found >= 0, avatars.number[found], -1)
    around = {int(avatars.number[i]): set(avatars.number[near[i, : counts[i]]].tolist()) for i in range(present)}
    return who, around


@pytest.mark.parametrize("search", ["kd_tree", "scipy"])
@pytest.mark.parametrize("teams", [0, 2, 5, 20])
def test_every_index_finds_what_a_direct_comparison_finds(search, teams):
    count = 400
    team = None if teams == 0 else np.random.default_rng(1).integers(0, teams, count)
    avatars = avatars_of(count, team)
    who, around = observed(build_index(search, Workers(1)), avatars, count)
    slots = avatars.slot_of
    x, z, sides = avatars.x[slots], avatars.z[slots], avatars.team[slots]
    for i in range(count):
        own = -1 if team is None else sides[i]
        assert who[i] == naive_opponents.nearest(x, z, sides, x[i], z[i], i, own)
        assert around[i] == set(naive_opponents.neighbours(x, z, x[i], z[i], i, 1.5, 12))


def test_a_tree_that_is_only_refitted_finds_what_a_new_one_finds():
    avatars = avatars_of(900, np.arange(900) % 2)
    old = build_index("kd_tree", Workers(1), sort_every=1000)
    observed(old, avatars, 900)
    rng = np.random.default_rng(2)
    for _ in range(5):
        # By number, since the other index stores the avatars in another order.
        slots = avatars.slot_of
        moves = rng.normal(0, 2, (2, 900))
        avatars.x[slots] += moves[0]
        avatars.z[slots] += moves[1]
        who, around = observed(old, avatars, 900)
        new = Avatars(*(values.copy() for values in avatars))
        again, near = observed(build_index("kd_tree", Workers(1)), new, 900)
        assert np.array_equal(who, again)
        assert around == near


def test_absent_avatars_are_no_opponents():
    present = np.arange(300) % 3 > 0
    avatars = avatars_of(300, np.arange(300) % 2, present=present)
    who, around = observed(build_index("kd_tree", Workers(1)), avatars, int(present.sum()))
    assert present[who[present]].all()
    assert all(present[list(near)].all() for near in around.values())


def chosen(old, headings, positions, opponents=(), hit=(-1, 0.0), hysteresis=0.3, sight=1.5):
    """Whom avatar 0 fights next, as the kernel says and as the naive twin says; the frame is 100."""
    people = build_crowd(*np.array(positions).T, heading=headings, hysteresis=hysteresis)
    avatars = build_avatars(people, MODEL)
    avatars.opponent[: len(opponents)] = opponents
    avatars.opponent[0] = old
    avatars.fight["hit_by"][0], avatars.fight["hit_frame"][0] = hit
    found, near = Observed(*(np.empty(shape, np.int32) for shape in (1, 1, (1, 12)))), np.empty(people.count)
    observe_all(avatars, people.count, np.zeros(1, np.int32), 1, sight, found, near, np.empty(people.count, np.int64))
    cohorts = np.zeros(1, COHORT)
    cohorts["hysteresis"] = hysteresis
    opponent = change_opponent(avatars, cohorts, Now(100, 1, people.count), 0, found, 0)
    twins = [naive_crowd.Avatar(i, people, [POLICY]) for i in range(people.count)]
    for i, twin in enumerate(twins):
        twin.opponent = int(avatars.opponent[i])
    twins[0].hit_by, twins[0].hit_frame = hit
    crowd = replace(people, crowding=replace(people.crowding, reach=sight))
    return opponent, naive_crowd.decide(twins[0], twins, crowd, np.zeros((2, 0, 3)), 100, {})[0]


@pytest.mark.parametrize("heading", [0.0, 1.0, -2.5])
def test_an_opponent_behind_must_be_so_much_nearer(heading):
    def turned(distance, bearing):
        return distance * np.sin(heading + bearing), distance * np.cos(heading + bearing)

    for old, new, much_nearer in [
        (0.0, 0.0, 0.3),  # straight ahead, both of them
        (0.0, np.pi, 0.3 + BEHIND),  # behind instead of ahead
        (0.0, np.pi / 2, 0.3 + BEHIND / 2),  # to the side
        (np.pi, np.pi, 0.3),
        (np.pi, np.pi / 2, 0.3 - BEHIND / 2),  # from behind to the side: sooner
    ]:
        for more, expected in ((-0.01, 1), (0.01, 2)):
            positions = [(0.0, 0.0), turned(2.0, old), turned(2.0 - much_nearer - more, new)]
            # Both look the other way, and both fight avatar 0.
            headings = [heading, heading + old, heading + new]
            assert chosen(1, headings, positions, (-1, 0, 0), sight=3.0) == (expected, expected)


def test_whoever_looks_at_an_avatar_fights_it_or_has_hit_it_seems_nearer():
    aside = [(0.0, 0.0), (1.2, 0.0), (-1.2, 0.0)]
    looking, away = [0.0, -np.pi / 2, np.pi / 2], [0.0, np.pi / 2, np.pi / 2]
    assert chosen(1, looking, aside, (-1, 0, 0)) == (1, 1)
    assert chosen(1, away, aside, (-1, 0, 0)) == (2, 2)
    assert chosen(1, looking, aside, (-1, 2, 0)) == (2, 2)
    assert chosen(1, looking, aside, (-1, 0, 0), hit=(2, 90.0)) == (2, 2)
    assert chosen(1, looking, aside, (-1, 0, 0), hit=(2, 100.0 - REMEMBERED)) == (1, 1)
    assert chosen(1, away, aside, (-1, 0, 0), hysteresis=AVERTED + 0.1) == (1, 1)


def test_opponents_are_those_of_the_naive_twin():
    rng = np.random.default_rng(5)
    found = []
    for _ in range(400):
        count = int(rng.integers(3, 7))
        positions, headings = rng.uniform(-1.5, 1.5, (count, 2)), rng.uniform(-3, 3, count)
        opponents, hit = rng.integers(-1, count, count), (int(rng.integers(1, count)), 100.0 - rng.integers(1, 60))
        kernel, naive = chosen(1, headings, positions, opponents, hit, rng.uniform(0, 0.5), rng.choice([0.5, 1.5]))
        assert kernel == naive
        found.append(kernel)
    assert 50 < np.count_nonzero(np.array(found) > 1) < 350


def test_storing_in_another_order_moves_all_that_an_avatar_is():
    avatars = avatars_of(100, np.arange(100) % 3)
    moving = [values for values in (getattr(avatars, name) for name in BY_SLOT) if len(values)]
    before = {int(n): [values[i].copy() for values in moving] for i, n in enumerate(avatars.number)}
    store_in_order(avatars, np.random.default_rng(0).permutation(100))
    for number, expected in before.items():
        slot = avatars.slot_of[number]
        assert [values[slot] for values in moving] == expected


def test_storage_is_sorted_again_when_avatars_have_moved_far_and_not_before():
    avatars = avatars_of(900, None)
    index = build_index("kd_tree", Workers(1), sort_every=2)
    index.update(avatars, 900)
    sorted_once = avatars.number.copy()
    for _ in range(6):
        avatars.x[:] += 0.01
        index.update(avatars, 900)
    assert np.array_equal(avatars.number, sorted_once)
    avatars.x[:] = np.random.default_rng(0).permutation(avatars.x)
    for _ in range(2):
        index.update(avatars, 900)
    assert not np.array_equal(avatars.number, sorted_once)
