"""Measures of fights on takes made by hand, whose figures are known."""

from __future__ import annotations

from dataclasses import asdict, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from crowdsim.motion.strikers import GROUPS, HANDS
from crowdsim.take import measures
from crowdsim.take.measures import FightCounter, FightMeasures, chunks_of, measure_fights
from crowdsim.take.take import Cast, Events, Take

RATE = 15.0
SECOND = 15
FACING, AWAY = 0.0, np.pi


def strikes(*result: tuple[float, int, int, bool]) -> Events:
    """Strikes of (frame, attacker, victim, landed) each."""
    frame, attacker, victim, landed = (np.array(column) for column in zip(*result, strict=True)) if result else [[]] * 4
    return Events(
        frame=np.asarray(frame, np.float32),
        attacker=np.asarray(attacker, np.int32),
        victim=np.asarray(victim, np.int32),
        hand=np.zeros(len(result), np.uint8),
        point=np.zeros((len(result), 3), np.float32),
        speed=np.full(len(result), 6.0, np.float32),
        landed=np.asarray(landed, bool),
    )


def make_take(
    x: Any,
    z: Any,
    heading: Any,
    opponent: Any,
    frames: int,
    events: Events | None = None,
    present: Any = True,
    targets: Any = None,
    scales: float = 1.0,
) -> Take:
    """Return a take of arrays that broadcast to (frames, avatars)."""
    count = np.shape(x)[-1]
    shape = (frames, count)
    there = np.broadcast_to(present, shape)

    def fill(values: Any) -> np.ndarray:
        return np.where(there, np.broadcast_to(np.asarray(values, np.float32), shape), np.nan).astype(np.float32)

    targets = np.zeros((frames, 0, 3)) if targets is None else targets
    none = np.zeros(count, np.int16)
    cast = Cast(
        np.array([f"a{n}" for n in range(count)]), none, none, none, np.full(count, scales, np.float32),
        np.ones(count, np.float32), ("boxer",), ("one",), ("policy",), np.full((1, 3), np.nan),
    )  # fmt: skip
    return Take(
        action=np.where(there, 0, -1).astype(np.int32),
        action_frame=np.zeros(shape, np.float32),
        x=fill(x),
        z=fill(z),
        heading=fill(heading),
        opponent=np.where(there, np.broadcast_to(opponent, shape), -1).astype(np.int32),
        cast=cast,
        targets=np.asarray(targets, np.float32),
        target_names=tuple(f"t{k}" for k in range(np.shape(targets)[1])),
        events=strikes() if events is None else events,
        control_rate=RATE,
        scenario="by hand",
        seed=0,
        fingerprints=("",),
        status="done",
        policies=(striker(HANDS[0], 0.9),),
    )


def striker(limb: int, reach: float) -> Any:
    """What is read of a policy whose strikes reach that far over the ground [m]."""
    database = SimpleNamespace(strike_positions=np.array([[0.0, 1.5, reach]]), strike_limbs=np.array([limb], np.uint8))
    return SimpleNamespace(database=database)


def measured(take: Take, **more: float) -> FightMeasures:
    """Return the measures of a take that knows its policies."""
    return measure_fights(take, take.policies, **more)


def pair(distance: Any, frames: int = 600, **more: Any) -> Take:
    """Two avatars that face each other along z, ``distance`` apart [m]."""
    z = np.stack(np.broadcast_arrays(np.zeros(1), distance), axis=-1)
    heading = more.pop("heading", [FACING, AWAY])
    return make_take([[0.0, 0.0]], z, heading, [1, 0], frames, **more)


def test_positions_are_counted_from_ten_seconds_on_unless_another_time_is_given() -> None:
    distance = np.full(600, 2.0)
    distance[: 10 * SECOND] = 1.0
    distance[20 * SECOND : 30 * SECOND] = 1.2
    result = measured(pair(distance))
    assert result.out_of_reach_share == pytest.approx(2 / 3)
    assert result.distance_median == pytest.approx(2.0)
    assert measured(pair(distance), after=0.0).out_of_reach_share == pytest.approx(0.5)
    assert measured(pair(distance), after=30.0).out_of_reach_share == 1.0
    early = measured(pair(1.0, frames=100))
    assert (early.out_of_reach_share, early.turned_away_share, early.distance_median) == (None, None, None)


def test_reach_is_in_metres_whatever_the_scale() -> None:
    for distance, share in ((1.49, 0.0), (1.51, 1.0)):
        assert measured(pair(distance, scales=0.8)).out_of_reach_share == share


def test_an_avatar_faces_away_when_its_opponent_is_behind_it() -> None:
    heading = np.zeros((600, 2))
    heading[:, 1] = np.pi
    heading[300:450, 0] = np.radians(91.0)
    heading[450:, 0] = np.radians(89.0)
    result = measured(pair(2.0, heading=heading))
    assert result.turned_away_share == pytest.approx(150 / 450 / 2)
    assert measured(pair(2.0, heading=[AWAY, FACING])).turned_away_share == 1.0
    assert measured(pair(2.0, heading=[2 * np.pi, -np.pi])).turned_away_share == 0.0


@pytest.mark.parametrize(("frames_out", "stuck"), [(150, 0), (151, 2)])
def test_an_avatar_is_stuck_that_is_out_of_reach_for_more_than_ten_seconds(frames_out: int, stuck: int) -> None:
    distance = np.full(600, 1.0)
    distance[200 : 200 + frames_out] = 1.6
    result = measured(pair(distance))
    assert result.stuck_avatars == stuck
    assert result.stuck_share == stuck / 2


def test_a_moment_in_reach_ends_a_stretch_and_the_first_seconds_do_not_count() -> None:
    distance = np.full(600, 2.0)
    distance[290::100] = 1.0
    distance[:290] = 2.0
    assert measured(pair(distance)).stuck_avatars == 0
    assert measured(pair(distance), after=5.0).stuck_avatars == 2


def test_another_opponent_out_of_reach_does_not_end_a_stretch() -> None:
    opponent = np.tile([1, 0, 1], (600, 1))
    opponent[::2, 0] = 2
    take = make_take([[0.0, 2.0, 3.0]], [[0.0] * 3], [0.0] * 3, opponent, 600)
    result = measured(take)
    assert result.stuck_avatars == 2
    assert result.stuck_share == pytest.approx(2 / 3)
    assert result.distance_median == pytest.approx(2.0)


def test_no_avatar_is_stuck_in_a_take_that_is_too_short() -> None:
    assert measured(pair(9.0, frames=300)).stuck_avatars is None
    assert measured(pair(9.0, frames=301)).stuck_avatars == 2


def test_strikes_are_counted_per_avatar_and_minute() -> None:
    events = strikes((90.0, 0, 1, False), (97.5, 0, 1, True), (300.0, 1, 0, False), (400.5, 0, 1, True))
    result = measured(pair(1.0, frames=450, events=events))
    assert result.first_landed_seconds == pytest.approx(6.5)
    assert result.thrown_per_minute == pytest.approx(4.0)
    assert result.landed_per_minute == pytest.approx(2.0)
    assert result.least_landed_per_minute == 0.0
    assert result.landed_share == 0.5
    both = strikes((90.0, 0, 1, True), (97.5, 1, 0, True), (300.0, 1, 0, True))
    assert measured(pair(1.0, frames=450, events=both)).least_landed_per_minute == pytest.approx(2.0)


def test_a_fight_without_strikes_has_no_shares_of_them() -> None:
    result = measured(pair(1.0))
    assert (result.first_landed_seconds, result.landed_share, result.air_share) == (None, None, None)
    assert (result.thrown_per_minute, result.least_landed_per_minute) == (0.0, 0.0)


def test_avatars_that_are_absent_do_not_count() -> None:
    present = np.ones((900, 2), bool)
    present[:450, 1] = False
    events = strikes((500.0, 1, 0, True), (600.0, 0, 1, True), (700.0, 0, 1, True))
    take = pair(2.0, frames=900, present=present, events=events)
    take = replace(take, opponent=np.where(present, [1, 0], -1).astype(np.int32))
    # The one who is there alone looks for somebody who is not.
    take.opponent[:450, 0] = 1
    take.heading[:450, 0] = AWAY
    result = measured(take)
    assert result.turned_away_share == 0.0
    assert result.out_of_reach_share == 1.0
    assert result.distance_median == pytest.approx(2.0)
    assert result.landed_per_minute == pytest.approx(3 / 1.5)
    assert result.least_landed_per_minute == pytest.approx(2.0)


def test_without_opponents_nothing_is_measured() -> None:
    result = measured(make_take([[0.0]], [[0.0]], [0.0], [-1], 600, events=strikes((9.0, 0, -1, False))))
    assert result.thrown_per_minute == pytest.approx(1.5)
    for key in ("out_of_reach_share", "stuck_avatars", "air_share", "turned_away_share", "distance_median"):
        assert getattr(result, key) is None


def test_a_strike_at_the_air_is_thrown_from_too_far_away() -> None:
    for distance, share in ((1.5, 1.0), (1.39, 0.0)):
        take = pair(distance, events=strikes((20.0, 0, 1, False), (0.0, 1, 0, False)))
        assert measured(take).air_share == share


def test_strikes_of_what_reaches_farther_than_hands_are_thrown_at_the_air_from_as_much_farther_away() -> None:
    stick = GROUPS["props"][1]
    for limb, reach, distance, share in (
        (stick, 1.5, 1.89, 0.0), (stick, 1.5, 1.91, 1.0), (stick, 0.8, 1.41, 1.0), (stick, 0.8, 1.39, 0.0),
        (HANDS[0], 1.5, 1.41, 1.0),
    ):  # fmt: skip
        events = replace(strikes((20.0, 0, 1, False)), limb=np.array([stick], np.uint8))
        take = replace(pair(distance, events=events), policies=(striker(limb, reach),))
        assert measured(take).air_share == share


def test_the_distance_of_a_strike_is_that_between_two_frames() -> None:
    distance = np.full(600, 1.0)
    distance[100:] = 2.0
    # 1.4 m are passed at 99.4.
    take = pair(distance, events=strikes(*((99.0 + part, 0, 1, False) for part in (0.0, 0.35, 0.45, 0.9, 1.0))))
    assert measured(take).air_share == pytest.approx(3 / 5)


def test_scripted_targets_are_opponents_where_they_are_then() -> None:
    targets = np.zeros((600, 2, 3))
    targets[:, 1, 1] = 1.6
    targets[:, 1, 2] = np.where(np.arange(600) < 300, 1.0, -2.0)
    events = strikes((10.0, 0, -3, True), (299.5, 0, -3, False), (400.0, 0, -3, False), (401.0, 0, -2, False))
    take = make_take([[0.0]], [[0.0]], [FACING], [-3], 600, events, targets=targets)
    result = measured(take)
    assert result.out_of_reach_share == result.turned_away_share == pytest.approx(300 / 450)
    assert result.distance_median == pytest.approx(2.0)
    assert result.stuck_avatars == 1
    # Half way from 1 m ahead to 2 m behind it is near.
    assert result.air_share == pytest.approx(1 / 4)


def test_bodies_overlap_by_their_size() -> None:
    for scale, share in ((1.0, 0.0), (1.1, 1.0)):
        assert measured(pair(0.41, scales=scale)).overlap_share == share
    assert measured(make_take([[0.0]], [[0.0]], [0.0], [-1], 600)).overlap_share == 0.0


def random_take(seed: int) -> Take:
    rng = np.random.default_rng(seed)
    frames, count = 500, 6
    present = np.repeat(rng.random((10, count)) < 0.8, 50, axis=0)
    opponent = np.repeat(rng.integers(-3, count, (20, count)), 25, axis=0)
    x, z = rng.uniform(-1.5, 1.5, (2, frames, count)).cumsum(axis=1) * 0.1
    events = strikes(
        *(
            (float(f), int(rng.integers(count)), int(rng.integers(-3, count)), bool(rng.random() < 0.3))
            for f in np.sort(rng.uniform(0, frames - 1, 200)).round(2)
        )
    )
    targets = rng.uniform(-2, 2, (frames, 2, 3))
    return make_take(x, z, rng.uniform(-7, 7, (frames, count)), opponent, frames, events, present, targets)


def naive_shares(take: Take, after: float) -> tuple[float, float, float, float, int]:
    """Out of reach, turned away, median distance, air and stuck, one avatar and frame after another."""
    out, away, distances, air, stuck = [], [], [], [], set()

    def place(who: int, frame: int) -> np.ndarray:
        if who <= -2:
            return take.targets[frame, -2 - who, [0, 2]].astype(float)
        return np.array([take.x[frame, who], take.z[frame, who]], float)

    for n in range(take.avatar_count):
        stretch = 0
        for f in range(round(after * RATE), take.frame_count):
            other = int(take.opponent[f, n])
            there = take.action[f, n] >= 0 and other != -1
            # An avatar without an opponent is down.
            there = there and (other < 0 or (take.action[f, other] >= 0 and take.opponent[f, other] != -1))
            if not there:
                stretch = 0
                continue
            offset = place(other, f) - place(n, f)
            distances.append(np.hypot(*offset))
            out.append(distances[-1] > 1.5)
            away.append(offset @ [np.sin(take.heading[f, n]), np.cos(take.heading[f, n])] < 0)
            stretch = stretch + 1 if out[-1] else 0
            if stretch / RATE > 10.0:
                stuck.add(n)
    for frame, n, other in zip(take.events.frame, take.events.attacker, take.events.victim, strict=True):
        low, high, share = int(np.floor(frame)), int(np.ceil(frame)), frame - np.floor(frame)
        if other == -1 or (other >= 0 and take.opponent[high, other] == -1):
            continue
        offset = (place(other, low) - place(n, low)) * (1 - share) + (place(other, high) - place(n, high)) * share
        if np.isfinite(offset).all():
            air.append(np.hypot(*offset) > 1.4)
    return np.mean(out), np.mean(away), np.median(distances), np.mean(air), len(stuck)


@pytest.mark.parametrize("seed", range(4))
def test_measures_match_naive_ones_whatever_the_chunks(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    take = random_take(seed)
    result = measured(take, after=3.0)
    keys = ("out_of_reach_share", "turned_away_share", "distance_median", "air_share", "stuck_avatars")
    np.testing.assert_allclose([getattr(result, key) for key in keys], naive_shares(take, 3.0), rtol=1e-5)
    for read, block in ((6, 6), (100, 18), (1300, 7), (3000, 10_000)):
        monkeypatch.setattr(measures, "_READ_AVATAR_FRAMES", read)
        monkeypatch.setattr(measures, "_BLOCK_AVATAR_FRAMES", block)
        assert measured(take, after=3.0) == result


def test_large_crowds_are_sampled_evenly(monkeypatch: pytest.MonkeyPatch) -> None:
    take = random_take(9)
    exact = asdict(measured(take))
    monkeypatch.setattr(measures, "_SAMPLED_AVATAR_FRAMES", 600)
    counter = FightCounter(take.cast, take.policies, RATE, take.frame_count)
    for chunk in chunks_of(take):
        counter.add(chunk)
    sampled = asdict(counter.finish())
    assert sampled.pop("distance_median") == pytest.approx(exact.pop("distance_median"), rel=0.3)
    assert sampled.pop("overlap_share") == pytest.approx(exact.pop("overlap_share"), abs=0.2)
    assert sampled == exact
