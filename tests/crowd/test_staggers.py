"""Avatars that a blow throws off their feet leave their action at the blow, and stagger as far as it pushes them."""

from dataclasses import replace

import numpy as np
import pytest
from falling import falling_policy
from test_damage import column, fighters, rules
from test_simulation import bytes_of

from crowdsim.crowd import simulation
from crowdsim.crowd.crowd import Crowding, build_crowd
from crowdsim.crowd.kernels import layout
from crowdsim.crowd.kernels.layout import Observed
from crowdsim.crowd.kernels.records import STRIKE, THROWN
from crowdsim.crowd.kernels.resolve import note_hits
from crowdsim.crowd.kernels.staggers import FURTHEST, NEIGHBOURS, PUSH, SEES, SPOILS, THROWS, list_thrown, stagger
from crowdsim.crowd.model import build_model
from crowdsim.crowd.simulation import Simulation


def brawl(count: int = 12, **other: object) -> Simulation:
    """Boxers without damage in the middle of a fight."""
    policy, angles = falling_policy(), 2.0 * np.pi * np.arange(count) / count
    people = build_crowd(1.5 * np.sin(angles), 1.5 * np.cos(angles), angles + np.pi, policies=[policy], **other)
    model = build_model([policy])
    # Few strikes of so small a policy are hard.
    return Simulation(people, model=model._replace(sizes=_with_strong(model.sizes, 0.6)))


def _with_strong(sizes: np.ndarray, share: float) -> np.ndarray:
    sizes = sizes.copy()
    sizes["strong"] *= share
    return sizes


def stumbles(one: Simulation) -> np.ndarray:
    """The actions that are staggers."""
    return one.model.falls["action"][one.model.falls["kind"] == layout.STUMBLES]


def begun(one: Simulation, frames: int) -> tuple[int, int]:
    """Run so many frames; return how many staggers begin, and how many of their avatars were struck just then."""
    staggers = struck = 0
    for _ in range(frames):
        before = one.avatars.motion["action"][one.avatars.slot_of].copy()
        events = one.run(1).events
        now = one.avatars.motion["action"][one.avatars.slot_of]
        fresh = np.flatnonzero(np.isin(now, stumbles(one)) & (now != before))
        staggers += len(fresh)
        hit = events.victim[(events.outcome == layout.LANDED) | (events.outcome == layout.BLOCKED)]
        struck += int(np.isin(fresh, hit).sum())
    return staggers, struck


def test_avatars_stagger_at_the_blow_without_damage_too() -> None:
    staggers, struck = begun(brawl(), 300)
    assert staggers > 3
    assert struck == staggers


def test_nobody_staggers_where_reactions_are_off() -> None:
    one = brawl(crowding=replace(Crowding(), back=0.0, stunned=0.0))
    assert begun(one, 300) == (0, 0)


@pytest.mark.parametrize(("strength", "push"), [(0.95 * THROWS, 0.0), (1.5, 2.25 * PUSH), (5.0, FURTHEST)])
def test_a_hit_throws_by_the_square_of_its_strength(strength: float, push: float) -> None:
    one = brawl(4)
    one.run(3)
    strikes = np.zeros(1, STRIKE)
    strikes["attacker"], strikes["victim"], strikes["outcome"] = 0, 1, layout.LANDED
    strikes["frame"], strikes["speed"] = one.frame - 0.5, strength * one.model.sizes["strong"][0]
    slot = int(one.avatars.slot_of[1])
    one.avatars.playback["pending"][slot] = layout.NO_STRIKE
    note_hits(one.model, one.avatars, one.frame, strikes, 0, 1)
    out = np.zeros(1, THROWN)
    count = list_thrown(one.model, one.avatars, one._world, one._now._replace(frame=one.frame), strikes, 0, 1, out)
    assert count == (push > 0.0)
    if count:
        assert out["slot"][0] == slot
        assert out["push"][0] == pytest.approx(push)
    # An avatar that has just thrown a strike itself keeps its feet.
    one.avatars.playback["pending"][slot] = -1
    assert list_thrown(one.model, one.avatars, one._world, one._now._replace(frame=one.frame), strikes, 0, 1, out) == 0


@pytest.mark.parametrize(("strength", "left", "thrown"), [(0.9, 5, 0), (1.1, 5, 1), (1.1, 40, 0)])
def test_an_avatar_that_is_about_to_strike_is_thrown_by_less(strength: float, left: int, thrown: int) -> None:
    one = brawl(4)
    one.run(3)
    slot = int(one.avatars.slot_of[1])
    motion, fight = one.avatars.motion, one.avatars.fight
    longest = int(np.argmax(one.model.actions["length"]))
    motion["action"][slot], motion["phase"][slot] = longest, 0.0
    one.avatars.playback["pending"][slot] = left
    strikes = np.zeros(1, STRIKE)
    strikes["attacker"], strikes["victim"], strikes["outcome"] = 0, 1, layout.LANDED
    fight["hit_by"][slot], fight["hit_frame"][slot] = 0, one.frame
    fight["hit_x"][slot], fight["hit_z"][slot] = strength * SPOILS, 0.0
    out = np.zeros(1, THROWN)
    now = one._now._replace(frame=one.frame)
    assert list_thrown(one.model, one.avatars, one._world, now, strikes, 0, 1, out) == thrown


def test_harder_blows_lead_to_longer_staggers() -> None:
    one = brawl()
    lengths: list[tuple[float, float]] = []
    for _ in range(400):
        before = one.avatars.motion["action"].copy()
        one.run(1)
        now, fight = one.avatars.motion["action"], one.avatars.fight
        for slot in np.flatnonzero(np.isin(now, stumbles(one)) & (now != before)):
            move = one.model.moves[now[slot]]
            lengths.append(
                (float(np.hypot(fight["hit_x"][slot], fight["hit_z"][slot])), float(np.hypot(move["x"], move["z"])))
            )
    strength, far = np.array(lengths).T
    assert len(strength) > 4
    assert far[strength > np.median(strength)].mean() > far[strength <= np.median(strength)].mean()


def test_an_avatar_that_is_hurt_much_staggers_at_the_blow() -> None:
    hurting = rules()
    hurting[:, column("down_from")], hurting[:, column("full_health")] = 1e4, 1e6
    policy = falling_policy()
    one = Simulation(replace(fighters(rules=hurting), policies=[policy]), model=build_model([policy]))
    staggers, struck = begun(one, 200)
    assert staggers > 3
    assert struck == staggers
    assert not (one.avatars.conditions["standing"] == layout.STAGGERS).any()


def test_a_weak_blow_throws_an_avatar_that_is_hurt_much_a_little() -> None:
    one = brawl(4, rules=rules(), conditioned=True)
    one.run(3)
    slot, strikes, out = int(one.avatars.slot_of[1]), np.zeros(1, STRIKE), np.zeros(1, THROWN)
    strikes["attacker"], strikes["victim"], strikes["outcome"] = 0, 1, layout.LANDED
    one.avatars.playback["pending"][slot] = layout.NO_STRIKE
    fight, now = one.avatars.fight, one._now._replace(frame=one.frame)
    fight["hit_by"][slot], fight["hit_frame"][slot] = 0, one.frame
    fight["hit_x"][slot], fight["hit_z"][slot] = 0.5 * THROWS, 0.0
    assert list_thrown(one.model, one.avatars, one._world, now, strikes, 0, 1, out) == 0
    one.avatars.conditions["standing"][1] = layout.STAGGERS
    assert list_thrown(one.model, one.avatars, one._world, now, strikes, 0, 1, out) == 1
    assert out["push"][0] == pytest.approx(PUSH * (0.5 * THROWS) ** 2)
    assert one.avatars.conditions["standing"][1] == layout.UP


@pytest.mark.parametrize("far", [SEES - 0.1, SEES + 0.1])
def test_neighbours_out_of_sight_are_in_nobodys_way(far: float) -> None:
    rows = []
    for listed in (False, True):
        one = brawl(2)
        one.run(3)
        avatars, (own, other) = one.avatars, one.avatars.slot_of[:2]
        avatars.x[own], avatars.z[own], avatars.heading[own] = 0.0, 0.0, 0.0
        avatars.x[other], avatars.z[other] = 0.0, -far
        # The other one is going to be where the blow leads.
        avatars.motion["end_x"][other], avatars.motion["end_z"][other] = 0.0, -0.9
        avatars.fight["hit_x"][own], avatars.fight["hit_z"][own] = 0.0, -1.8
        thrown = np.zeros(1, THROWN)
        thrown["slot"], thrown["hit"], thrown["push"] = own, one.frame - 0.5, 0.8
        seen = Observed(
            np.full(1, -1, np.int32), np.array([listed], np.int32), np.full((1, NEIGHBOURS), other, np.int32)
        )
        stagger(one.model, avatars, one._world_at(one.frame - 1, 2), one._now, thrown, seen)
        rows.append(int(thrown["row"][0]))
    assert (rows[0] == rows[1]) == (far > SEES)


def test_staggers_do_not_depend_on_how_a_frame_is_run(monkeypatch: pytest.MonkeyPatch) -> None:
    small = bytes_of([brawl().run(200)])
    monkeypatch.setattr(simulation, "SMALL", 0)
    assert bytes_of([brawl().run(200)]) == small
