"""The benchmark of fights: bouts are counted by fighter, and the time to react is read from takes."""

import importlib
import json
import math
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import write_scene

from crowdsim import load_scenario, run
from crowdsim.crowd.events import OUTCOMES, Events
from crowdsim.take.take import Cast, Take

ROOT = Path(__file__).parents[1]
RATE = 15.0


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """The modules of the benchmark."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    names = ("_fights.bouts", "_fights.knock_downs", "_fights.reaction_time")
    for name in names:
        monkeypatch.delitem(sys.modules, name, raising=False)
    return SimpleNamespace(**{name.rpartition(".")[2]: importlib.import_module(name) for name in names})


def events_of(*strikes: tuple[float, int, int, int, bool]) -> Events:
    """Strikes of (frame, attacker, victim, outcome, whether it knocks down) each."""
    frame, attacker, victim, outcome, down = (np.array(column) for column in zip(*strikes, strict=True))
    return Events(
        frame=frame.astype(np.float32),
        attacker=attacker.astype(np.int32),
        victim=victim.astype(np.int32),
        hand=np.zeros(len(strikes), np.uint8),
        point=np.zeros((len(strikes), 3), np.float32),
        speed=np.full(len(strikes), 6.0, np.float32),
        landed=outcome == OUTCOMES.index("landed"),
        outcome=outcome.astype(np.uint8),
        down=down.astype(bool),
    )


def take_of(actions: list[list[int]], phases: list[list[float]], events: Events, speeds: tuple[float, float]) -> Take:
    """Return a take of two avatars; actions and phases of each avatar, by frame."""
    action = np.array(actions, np.int32).T
    place, none = np.zeros(action.shape, np.float32), np.zeros(2, np.int16)
    cast = Cast(
        np.array(["one", "other"]), none, none, none, np.ones(2, np.float32), np.array(speeds, np.float32), ("boxer",),
        ("one",), ("policy",), np.full((1, 3), np.nan),
    )  # fmt: skip
    return Take(
        action, np.array(phases, np.float32).T, place, place, place, np.tile(np.int32([1, 0]), (len(action), 1)), cast,
        np.zeros((len(action), 0, 3), np.float32), (), events, RATE, "two", 1, ("none",), "done",
    )  # fmt: skip


def naive_reactions(take: Take, reaction: float) -> tuple[list[float], list[bool]]:
    """Return leads, and whether victims could react, strike by strike and frame by frame."""
    leads, reactable = [], []
    for frame, attacker, victim in zip(take.events.frame, take.events.attacker, take.events.victim, strict=True):
        if victim < 0:
            continue
        impact = float(frame) - 1e-3
        decided = 0
        answers = []
        for now in range(take.frame_count):
            starts = [
                now == 0
                or take.action[now, who] != take.action[now - 1, who]
                or take.action_frame[now, who] <= take.action_frame[now - 1, who]
                for who in (attacker, victim)
            ]
            began = now - float(take.action_frame[now, attacker]) / float(take.cast.speeds[attacker])
            if starts[0] and (began < impact or now == 0):
                decided = now
            if starts[1] and now < impact:
                answers.append(now)
        leads.append(max(float(frame) - decided, 0.0) / take.control_rate)
        reactable.append(any(now - decided >= reaction * take.control_rate - 1e-3 for now in answers))
    return leads, reactable


def test_bouts_are_counted_for_the_first_fighter_whichever_corner_it_had(bench: SimpleNamespace) -> None:
    missed, landed, blocked, evaded = (OUTCOMES.index(name) for name in ("missed", "landed", "blocked", "evaded"))
    red, blue = np.zeros(4, np.int64), np.zeros(4, np.int64)
    red[[missed, landed, blocked]] = 2, 5, 1
    blue[[landed, evaded]] = 1, 3
    one = bench.bouts.Bout(0, 30.0, np.stack([red, blue]), np.array([2, 1]))
    turned = bench.bouts.Bout(1, 30.0, np.stack([blue, red]), np.array([1, 2]))
    figures = bench.bouts.summarise([one, turned], [0, 1])
    assert (figures["won"]["share"], figures["lost"], figures["drawn"]) == (1.0, 0.0, 0.0)
    assert figures["won_of_decided"]["share"] == 1.0
    assert figures["red_of_decided"]["share"] == 0.5
    assert figures["seconds"] == 30.0
    assert figures["thrown_per_minute"] == [16.0, 8.0]
    assert figures["landed_per_minute"] == [10.0, 2.0]
    assert figures["landed_share"] == [5 / 8, 1 / 4]
    assert figures["blocked_share"] == [1 / 8, 0.0]
    assert figures["evaded_share"] == [0.0, 3 / 4]
    assert figures["knock_downs"] == [2.0, 1.0]


def test_draws_are_neither_won_nor_lost(bench: SimpleNamespace) -> None:
    drawn = bench.bouts.Bout(-1, 60.0, np.zeros((2, 4), np.int64), np.zeros(2, np.int64))
    figures = bench.bouts.summarise([drawn, drawn], [0, 1])
    assert (figures["won"]["share"], figures["lost"], figures["drawn"]) == (0.0, 0.0, 1.0)
    assert figures["won_of_decided"] == {"share": None, "interval": None}
    assert figures["landed_share"] == [0.0, 0.0]


@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_falls_are_found_after_knock_downs(bench: SimpleNamespace, way: float) -> None:
    landed = OUTCOMES.index("landed")
    events = events_of((3.5, 0, 1, landed, True), (4.5, 1, 0, landed, False), (11.5, 1, 0, landed, True))
    victim = [1, 1, 1, 2, 2, 2, 7, 7, 7, 8, 8, 8]
    take = take_of([[1] * 12, victim], [[0.0] * 12] * 2, events, (1.0, 1.0))
    take.x[:, 1], take.x[6:, 1] = 1.0, 1.0 + way * 0.5 * np.arange(6)
    found = bench.knock_downs.measure_knock_downs([take], np.array([7]))
    assert (found["knock_downs"], found["seen"], found["away_share"]) == (2, 1, float(way > 0.0))
    assert found["delay_median"] == found["delay_most"] == pytest.approx(2.5 / RATE)


@pytest.mark.parametrize(("count", "of"), [(0, 4), (3, 7), (98, 200), (200, 200)])
def test_intervals_are_those_of_wilson(bench: SimpleNamespace, count: int, of: int) -> None:
    z, p = 1.959963984540054, count / of
    middle = (p + z * z / (2 * of)) / (1 + z * z / of)
    half = z / (1 + z * z / of) * math.sqrt(p * (1 - p) / of + z * z / (4 * of * of))
    found = bench.bouts.share(count, of)
    assert found["share"] == p
    assert found["interval"] == pytest.approx([middle - half, middle + half], abs=1e-9)


def test_strikes_count_until_a_bout_is_decided_and_by_corner(bench: SimpleNamespace) -> None:
    events = events_of((3.0, 0, 1, 1, False), (5.5, 1, 0, 2, False), (9.0, 0, 1, 1, True), (9.5, 0, 1, 1, True))
    strikes, downs = bench.bouts.count_strikes(events, 9)
    assert strikes.tolist() == [[0, 2, 0, 0], [0, 0, 1, 0]]
    assert downs.tolist() == [1, 0]


def test_fighters_begin_alike_in_both_corners(bench: SimpleNamespace) -> None:
    scenario = bench.bouts.bout_scenario("boxer", "random")
    assert {name: (kind.policy, kind.temperature) for name, kind in scenario.types.items()} == {
        "boxer": ("boxer", scenario.types["boxer"].temperature),
        "random": ("boxer", 100.0),
    }
    turned = bench.bouts.bout_scenario("random", "boxer")
    assert [group.type for group in scenario.groups] == [group.type for group in turned.groups][::-1]
    assert [group.placement for group in scenario.groups] == [group.placement for group in turned.groups]
    for kind in scenario.types.values():
        assert kind.damage == scenario.types["boxer"].damage


def test_bouts_of_small_fighters_end_by_knock_out_and_repeat_themselves(
    bench: SimpleNamespace, workplace: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fighters = {"tiny": {"policy": "tiny"}, "drawn": {"policy": "tiny", **bench.bouts.RANDOM}}
    monkeypatch.setattr(bench.bouts, "FIGHTERS", fighters)
    monkeypatch.setitem(bench.bouts.DAMAGE, "health", 1)
    found = bench.bouts.measure_bouts(list(fighters), None, count=6, seconds=30.0)
    assert [(one, list(pairs)) for one, pairs in found.items()] == [("tiny", ["tiny", "drawn"]), ("drawn", ["drawn"])]
    figures = found["tiny"]["drawn"]
    assert figures["bouts"] == 6
    assert figures["won"]["share"] + figures["lost"] > 0.0
    assert figures["seconds"] < 30.0
    for pairs in found.values():
        for each in pairs.values():
            assert each["won"]["share"] + each["lost"] + each["drawn"] == pytest.approx(1.0)
    again = bench.bouts.measure_bouts(list(fighters), None, count=6, seconds=30.0)
    assert json.dumps(again) == json.dumps(found)
    assert len(list(bench.bouts.lines(found))) == 4


def test_leads_and_answers_of_a_take_made_by_hand(bench: SimpleNamespace) -> None:
    # The attacker decides in frames 0 and 4, the victim in 0, 3, 6 and, with the same action again, 8.
    actions = [[1] * 4 + [2] * 8, [5] * 3 + [6] * 3 + [7] * 6]
    phases = [[0, 1, 2, 3, *range(8)], [0, 1, 2, 0, 1, 2, 0, 1, 0, 1, 2, 3]]
    strikes = events_of(
        (2.5, 0, 1, 0, False),  # in the first action
        (4.0, 0, 1, 1, False),  # at its very end: the victim has decided in frame 3
        (6.5, 0, 1, 1, False),  # two frames after the decision in 4 the victim decides, too early
        (8.0, 0, 1, 1, False),  # it decides in the very frame of the impact, too late
        (8.5, 0, 1, 1, False),
        (9.0, 0, -1, 0, False),  # at nobody
    )
    take = take_of(actions, phases, strikes, (1.0, 1.0))
    leads, reactable = bench.reaction_time.reaction_times(take)
    assert leads * RATE == pytest.approx([2.5, 4.0, 2.5, 4.0, 4.5])
    assert reactable.tolist() == [False, True, False, False, True]
    figures = bench.reaction_time.measure_reactions([take, take])
    assert figures["strikes"] == 10
    assert figures["lead_seconds"][1] == pytest.approx(4.0 / RATE)
    assert figures["reactable_share"] == pytest.approx(0.4)


def test_actions_begin_between_frames(bench: SimpleNamespace) -> None:
    # Half as fast: in frame 4 a quarter of a motion frame of the new action is over, so it began in 3.5.
    phases = [[0.0, 0.5, 1.0, 1.5, 0.25, 0.75], [0, 1, 2, 3, 4, 5]]
    strikes = events_of((3.4, 0, 1, 1, False), (3.75, 0, 1, 1, False), (5.0, 0, 1, 1, False))
    take = take_of([[1] * 4 + [2] * 2, [5] * 6], phases, strikes, (0.5, 1.0))
    leads, _ = bench.reaction_time.reaction_times(take)
    assert leads * RATE == pytest.approx([3.4, 0.0, 1.0])


def test_reactions_match_naive(bench: SimpleNamespace, workplace: Path) -> None:
    spread = {"kind": "uniform", "minimum": 0.8, "maximum": 1.25}
    types = {"boxer": {"policy": "tiny", "speed": spread}}
    take = run(load_scenario(write_scene(workplace / "four.yaml", duration=400, types=types)))
    leads, reactable = bench.reaction_time.reaction_times(take)
    expected = naive_reactions(take, bench.reaction_time.REACTION)
    assert len(leads) > 20
    np.testing.assert_allclose(leads, expected[0])
    assert reactable.tolist() == expected[1]
    assert 0 < reactable.sum() < len(reactable)


def test_scenes_without_strikes_have_no_reactions(bench: SimpleNamespace) -> None:
    take = take_of([[1], [1]], [[0.0], [0.0]], events_of((0.0, 0, -1, 0, False)), (1.0, 1.0))
    figures = bench.reaction_time.measure_reactions([take])
    assert figures == {"strikes": 0, "lead_seconds": [None, None, None], "reactable_share": None}
    assert len(list(bench.reaction_time.lines({"none": figures}))) == 1
