import naive_crowd
import naive_opponents
import numpy as np
import pytest
from synthetic_policy import policy

from crowdsim.crowd.crowd import build_avatars, build_crowd
from crowdsim.crowd.kernels.layout import HEADING, OPPONENT, Observed
from crowdsim.crowd.kernels.opponents import BEHIND, change_opponent
from crowdsim.crowd.model import build_model
from crowdsim.crowd.opponents import build_index, store_in_order
from crowdsim.crowd.workers import Workers

MODEL = build_model([policy(0)])


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
        new = avatars._replace(whole=avatars.whole.copy(), real=avatars.real.copy(), slot_of=avatars.slot_of.copy())
        again, near = observed(build_index("kd_tree", Workers(1)), new, 900)
        assert np.array_equal(who, again)
        assert around == near


def test_absent_avatars_are_no_opponents():
    present = np.arange(300) % 3 > 0
    avatars = avatars_of(300, np.arange(300) % 2, present=present)
    who, around = observed(build_index("kd_tree", Workers(1)), avatars, int(present.sum()))
    assert present[who[present]].all()
    assert all(present[list(near)].all() for near in around.values())


def kept(positions, old, near, heading=0.0, hysteresis=0.3):
    """Whom avatar 0, at the origin, fights next: ``old`` until now, while ``near`` is nearest."""
    people = build_crowd(*np.array([[0.0, 0.0], *positions]).T, heading=heading, hysteresis=hysteresis)
    avatars = build_avatars(people, MODEL)
    avatars.real[HEADING] = heading
    avatars.whole[OPPONENT, 0] = old
    cohorts = np.array([[0.1, 4.0, 0.0, hysteresis, 0.0]])
    return change_opponent(avatars, cohorts, people.count, 0, avatars.slot_of[near])


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
            positions = [turned(2.0, old), turned(2.0 - much_nearer - more, new)]
            assert kept(positions, 1, 2, heading) == expected


def test_opponents_seem_as_far_as_the_naive_twin_says():
    rng = np.random.default_rng(5)
    changed = 0
    for _ in range(300):
        positions, heading, hysteresis = rng.uniform(-2, 2, (2, 2)), rng.uniform(-3, 3), rng.uniform(0, 0.5)
        far = [naive_crowd.seems_far(np.array([0.0, 0.0, heading]), *place) for place in positions]
        expected = 1 if far[1] >= far[0] - hysteresis else 2
        assert kept(positions, 1, 2, heading, hysteresis) == expected
        changed += expected == 2
    assert 50 < changed < 250


def test_storing_in_another_order_moves_all_that_an_avatar_is():
    avatars = avatars_of(100, np.arange(100) % 3)
    before = {int(n): (avatars.whole[:, i].copy(), avatars.real[:, i].copy()) for i, n in enumerate(avatars.number)}
    store_in_order(avatars, np.random.default_rng(0).permutation(100))
    for number, (whole, real) in before.items():
        slot = avatars.slot_of[number]
        assert np.array_equal(avatars.whole[:, slot], whole)
        assert np.array_equal(avatars.real[:, slot], real)


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
