"""Avatars whose opponents stay down celebrate once, and not while somebody fights them."""

from dataclasses import replace

import numpy as np
from test_damage import POLICIES, column, falling, fighters, rules

from crowdsim.crowd.kernels import layout
from crowdsim.crowd.model import build_model
from crowdsim.crowd.simulation import Simulation

CHEER = 9


TEAMS = (0, 1, 0)


def won() -> Simulation:
    """A fight of two teams, of which the first blow that lands knocks out."""
    rows = [(0.0, 0, kind, kind, 0) for kind in (layout.FALLS, layout.LIES, layout.STANDS_UP)]
    model = falling(build_model(POLICIES), [*rows, (0.0, 0, layout.CHEERS, CHEER, 3)])
    hurting = rules()
    hurting[:, column("most_downs")], hurting[:, column("down_from")] = 1.0, 1e-3
    people = replace(fighters(len(TEAMS), rules=hurting), policies=POLICIES)
    cast = replace(people.cast, teams=np.array(TEAMS, np.int16), team_names=("red", "blue"))
    return Simulation(replace(people, cast=cast, skip=np.array(TEAMS, np.int32)), model=model)


def cheers(one: Simulation, frames: int) -> list[tuple[int, int, set[int]]]:
    """Frame and avatar of each celebration, as it begins, and those who are not down then."""
    found = []
    for _ in range(frames):
        decided = one.avatars.fight["decisions"].copy()
        one.run(1)
        begun = (one.avatars.fight["decisions"] != decided) & (one.avatars.motion["action"] == CHEER)
        forced = one.avatars.conditions["cheered"][one.avatars.number] > 0.0
        up = {int(n) for n, team in zip(one.avatars.number, one.avatars.team, strict=True) if team >= 0}
        found += [(one.frame, int(one.avatars.number[slot]), up) for slot in np.flatnonzero(begun & forced)]
    return found


def test_the_winners_celebrate_once_after_the_last_opponent_is_out() -> None:
    one = won()
    found = cheers(one, 600)
    avatars = [number for _, number, _ in found]
    assert avatars
    assert len(avatars) == len(set(avatars))
    for _, number, up in found:
        assert {TEAMS[other] for other in up} == {TEAMS[number]}


def test_team_mates_celebrate_while_the_last_opponent_falls() -> None:
    one = won()
    while not (one.avatars.conditions["standing"] == layout.FALLING).any():
        one.run(1)
    rows, (last,) = one.avatars.conditions, np.flatnonzero(one.avatars.conditions["standing"] == layout.FALLING)
    assert np.isinf(rows["rises"][last])
    winners = np.flatnonzero(np.array(TEAMS) != TEAMS[last])
    while rows["standing"][last] == layout.FALLING:
        assert len(winners) == 2
        one.run(1)
    assert (rows["cheered"][winners] > 0.0).any()


def test_nobody_celebrates_while_somebody_fights_it() -> None:
    one = won()
    while not (one.avatars.team < 0).any():
        one.run(1)
    # A bystander of the own team fights each of them.
    one.avatars.opponent[:] = one.avatars.number[one.avatars.slot_of[0]]
    fought = int(one.avatars.number[one.avatars.slot_of[0]])
    for _ in range(150):
        one.avatars.opponent[:] = fought
        assert one.avatars.conditions["cheered"][fought] == 0.0
        one.run(1)
