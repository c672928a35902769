"""Measures of exported motion on hand-made bodies with known answers."""

import importlib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

FPS = 60
PELVIS, NECK, HEAD, HAND, FOOT = 0, 2, 3, 6, 9


def benchmark_modules(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """The modules of the benchmark."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[1] / "benchmarks"))
    names = ("run", "capsules", "bodies", "arms", "accelerations", "jumps", "gaze", "reactions", "blows", "variety",
             "goals", "calm", "witness", "witness_source", "table")  # fmt: skip
    return SimpleNamespace(**{name: importlib.import_module(f"_exported.{name}") for name in names})


@pytest.fixture
def modules(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    return benchmark_modules(monkeypatch)


def figure(modules: SimpleNamespace, position: tuple[float, float], heading: float = 0.0, frames: int = 240) -> Any:
    """A body that stands still, faces ``heading`` from +z to +x, and has its joints one over the other but for hips."""
    side = np.array([np.cos(heading), 0.0, -np.sin(heading)])
    joints = np.zeros((frames, 16, 3))
    joints[..., [0, 2]] = position
    joints[..., 1] = 1.0
    joints[:, HEAD, 1] = 1.6
    joints[:, 7] += 0.1 * side
    joints[:, 13] -= 0.1 * side
    joints[:, [FOOT, 15], 1] = 0.0
    ahead = np.array([np.sin(heading), 0.0, np.cos(heading)])
    return modules.witness.Figure(
        joints=joints,
        fists=joints[:, [HAND, 12]].copy(),
        head=joints[:, HEAD] + [0.0, 0.1, 0.0],
        soles=np.zeros((frames, 2, 2, 3)),
        crosses=np.zeros((frames, 4, 3)),
        dots=np.ones((frames, 4)),
        turns=np.tile(np.eye(3), (frames, 16, 1, 1)),
        pelvises=np.tile(ahead, (frames, 1)),
        faces=np.tile(ahead, (frames, 1)),
    )


def sizes(modules: SimpleNamespace) -> Any:
    """A body of two capsules: a torso, and a left fist."""
    roles = {name: k for k, name in enumerate(modules.witness.JOINTS)}
    parents = [-1, 0, 1, 2, 1, 4, 5, 0, 7, 8, 1, 10, 11, 0, 13, 14]
    blank = {name: np.zeros(0) for name in ("offsets", "fists", "head", "soles", "roots", "first", "lengths")}
    return modules.witness.Sizes(
        names=tuple(roles), parents=np.array(parents), roles=roles, **blank, head_radius=0.1, torso_radius=0.15,
        height=1.75, stride=4, rate=60.0, clip_names=("one",), clip_starts=np.array([0, 60]),
        capsule_joints=np.array([PELVIS, HAND]), capsule_ends=np.zeros((2, 2, 3)),
        capsule_radii=np.array([[0.15, 0.15], [0.05, 0.05]]),
    )  # fmt: skip


def make_run(modules: SimpleNamespace, figures: list[Any], strikes: list[tuple[Any, ...]] = (), **changes: Any) -> Any:
    """A run of some figures over a source that stands still for as long."""
    count, frames = len(figures), len(figures[0].head)
    ends = np.tile(np.array([[0.0, 0.9, 0.0], [0.0, 1.4, 0.0]]), (frames, 2, 1, 1))
    capsules = []
    for one in figures:
        own = ends + one.joints[:, None, None, PELVIS] * [1.0, 0.0, 1.0]
        own[:, 1] = one.fists[:, None, 0]
        capsules.append(own.astype(np.float32))
    names = ("seconds", "attacker", "victim", "limb", "landed")
    columns = [np.array(column) for column in zip(*strikes, strict=True)] if strikes else [np.zeros(0)] * 4
    columns += [] if strikes else [np.zeros(0, bool)]
    source = modules.witness_source.Source(
        figure(modules, (0.0, 0.0), frames=frames), np.zeros(frames, int), np.array([0, frames]), 0.0, np.zeros(1), []
    )
    run = modules.run.ExportedRun(
        sizes=sizes(modules), source=source, names=[str(k) for k in range(count)], figures=figures, capsules=capsules,
        scales=np.ones(count), speeds=np.ones(count),
        girths=np.ones(count), sexes=["male"] * count, fps=FPS, frames=np.tile(np.arange(float(frames)), (count, 1)),
        decisions=[np.zeros((0, 3))] * count,
        opponents=np.tile(np.array([[1], [0]] + [[0]] * (count - 2))[:count], (1, frames)),
        events={
            **dict(zip(names, columns, strict=True)),
            "blocked": np.zeros(len(columns[0]), bool),
            "speed": np.full(len(columns[0]), 6.0),
        },
    )  # fmt: skip
    return replace(run, **changes)


def two(modules: SimpleNamespace, apart: float, **more: Any) -> Any:
    """Two bodies that face one another along z."""
    figures = [figure(modules, (0.0, 0.0)), figure(modules, (0.0, apart), np.pi)]
    for one, side in zip(figures, (-1.0, 1.0), strict=True):
        # Fists are out of the way unless a test moves them.
        one.fists[:] = [0.0, 3.0 + side, 0.0]
    return figures, lambda: make_run(modules, figures, **more)


@pytest.mark.parametrize(
    ("r", "s", "others", "expected"),
    [
        ([1.0, 0.5, 0.0], [1.0, 0.5, 1.0], [0.2, 0.2], -0.7),  # side by side, T-shaped
        ([0.25, 0.5, 0.0], [0.25, 0.5, 0.0], [0.2, 0.2], 0.05),  # a sphere
        ([0.0, 1.2, 0.0], [0.0, 2.0, 0.0], [0.3, 0.1], 0.2),  # end to end, the wide end near
        ([0.0, 2.0, 0.0], [0.0, 1.2, 0.0], [0.1, 0.3], 0.2),
    ],
)
def test_capsules_are_as_deep_as_their_radii_and_axes_say(
    modules: SimpleNamespace, r: list[float], s: list[float], others: list[float], expected: float
) -> None:
    rows = [np.array([one], float) for one in ([0, 0, 0], [0, 1, 0], [0.1, 0.1], r, s, others)]
    np.testing.assert_allclose(modules.capsules.capsule_depths(*rows), expected, atol=1e-9)


def test_axes_are_as_far_apart_as_their_nearest_of_many_points(modules: SimpleNamespace) -> None:
    p, q, r, s = np.random.default_rng(1).normal(size=(4, 50, 3))
    share = np.linspace(0.0, 1.0, 201)[:, None, None]
    one, other = p + share * (q - p), r + share * (s - r)
    least = np.linalg.norm(one[:, None] - other[None], axis=-1).min(axis=(0, 1))
    thin = np.zeros((50, 2))
    found = -modules.capsules.capsule_depths(p, q, thin, r, s, thin)
    assert np.all(found <= least + 1e-9)
    np.testing.assert_allclose(found, least, atol=0.02)


def test_bodies_at_a_known_depth_are_counted_with_their_parts(modules: SimpleNamespace) -> None:
    figures, build = two(modules, 0.2)  # torsos of 0.15 m: 10 cm deep
    for one in figures:
        one.joints[120:, :, 2] += np.where(one is figures[0], -0.5, 0.5)
    run = build()
    outcome = modules.bodies.measure_bodies(run, modules.capsules.find_contacts(run))
    bodies = outcome["without_arms"]
    assert bodies["share"] == pytest.approx(0.5)
    assert bodies["deepest"] == pytest.approx(0.1, abs=1e-6)
    assert bodies["episodes_per_minute"] == pytest.approx(2 / (2 * 4 / 60))
    assert bodies["moments"][0]["parts"] == "torso in torso"
    assert outcome["by_parts"]["torso-torso"]["share"] == pytest.approx(0.5)
    assert outcome["arm_in_trunk_or_head"]["share"] == 0.0


def test_arms_in_a_torso_count_for_whom_they_belong_to(modules: SimpleNamespace) -> None:
    figures, build = two(modules, 1.0)
    figures[0].fists[60:120, 0] = [0.0, 1.2, 0.9]  # 0.15 + 0.05 - 0.1: 10 cm deep
    run = build()
    outcome = modules.bodies.measure_bodies(run, modules.capsules.find_contacts(run))
    assert outcome["without_arms"]["share"] == 0.0
    assert outcome["with_arms"]["share"] == pytest.approx(0.25)
    arm = outcome["arm_in_trunk_or_head"]
    assert arm["share"] == pytest.approx(0.125)
    assert arm["moments"][0]["avatar"] == 0
    assert arm["moments"][0]["parts"] == "left_fist in torso"


def test_strikes_that_go_deep_are_buried_and_stay_as_long_as_they_are_inside(modules: SimpleNamespace) -> None:
    figures, build = two(modules, 1.0, strikes=[(1.0, 0, 1, 0, True), (3.0, 0, 1, 0, False)])
    figures[0].fists[55:91, 0] = [0.0, 1.2, 0.9]
    run = build()
    outcome = modules.arms.measure_strikes(run, modules.capsules.find_contacts(run))
    assert (outcome["landed_buried"], outcome["missed_buried"]) == (1.0, 0.0)
    assert outcome["landed_stay"]["longest"] == pytest.approx(36 / FPS)
    figures[0].fists[:, 0, 2] = 0.85  # 5 cm deep
    shallow = build()
    outcome = modules.arms.measure_strikes(shallow, modules.capsules.find_contacts(shallow))
    assert (outcome["landed_buried"], outcome["landed_stay"]["longest"]) == (0.0, 0.0)


def test_episodes_are_joined_over_short_pauses(modules: SimpleNamespace) -> None:
    deep = np.zeros((2, 40), bool)
    deep[0, [3, 4, 8, 30]] = True
    assert modules.bodies.count_episodes(deep, 6) == 2
    assert modules.bodies.count_episodes(deep, 2) == 3


def spin(frames: int, rate: float) -> Any:
    angles = rate * np.arange(frames) / FPS
    turns = np.tile(np.eye(3), (frames, 1, 1))
    turns[:, 0, 0] = turns[:, 2, 2] = np.cos(angles)
    turns[:, 0, 2] = np.sin(angles)
    turns[:, 2, 0] = -turns[:, 0, 2]
    return turns


def test_angular_velocity_of_an_even_spin_is_its_rate(modules: SimpleNamespace) -> None:
    found = modules.accelerations.angular_velocity(spin(10, 3.0), FPS)
    np.testing.assert_allclose(found, np.tile([0.0, 3.0, 0.0], (9, 1)), atol=1e-6)


def test_accelerations_are_those_of_a_parabola_and_of_a_spin_that_grows(modules: SimpleNamespace) -> None:
    body, seconds = figure(modules, (0.0, 0.0), frames=20), np.arange(20) / FPS
    body.joints[:, HAND, 0] += 0.5 * 7.0 * seconds**2
    for frame, second in enumerate(seconds):
        body.turns[frame, FOOT] = spin(2, 0.5 * 40.0 * second**2 * FPS)[1]
    linear, angular = modules.accelerations.accelerations(body, FPS)
    np.testing.assert_allclose(linear[1:-1, HAND], 7.0, rtol=1e-6)
    np.testing.assert_allclose(angular[1:-1, FOOT], 40.0, rtol=1e-4)
    assert linear[:, FOOT].max() == angular[:, HAND].max() == linear[0, HAND] == angular[-1, FOOT] == 0.0


def test_accelerations_count_only_near_the_events_at_which_they_are(modules: SimpleNamespace) -> None:
    figures, build = two(modules, 1.0, strikes=[(1.0, 0, 1, 0, True)])
    decisions = [np.array([[3.0, 10.0, 20.0]]), np.array([[3.0, 10.0, 10.0]])]
    # A kink of a foot at the transition, one of the left wrist at the strike; the source shakes a little at its start.
    figures[0].joints[180:, FOOT, 0] += np.arange(60) * 0.01
    figures[0].turns[60:, HAND] = spin(180, 20.0)
    run = replace(build(), decisions=decisions)
    run.source.figure.joints[6:30:2] += 1e-4
    run.source.figure.turns[6:30:2] = spin(2, 0.1)[1]
    outcome = modules.accelerations.measure_accelerations(run)
    feet, wrists = outcome["linear"]["foot"], outcome["angular"]["hand"]
    assert feet["near_transitions"]["files"] == pytest.approx(1000.0 / (2 * 13))
    assert feet["near_transitions"]["source_there"] == 0.0
    assert feet["everywhere"]["files"] == pytest.approx(1000.0 / (4 * 240))
    assert feet["moments"][0] | {"value": 0} == {"value": 0, "avatar": 0, "frame": 180, "parts": "left_foot"}
    assert feet["near_landed_strikes"]["files"] == 0.0
    assert wrists["near_landed_strikes"]["files"] == pytest.approx(1000.0 / 25)
    assert wrists["near_transitions"]["files"] == 0.0
    assert outcome["angular"]["foot"]["everywhere"]["files"] == 0.0
    worst = {kind: outcome[kind]["worst"]["everywhere"] for kind in ("linear", "angular")}
    assert (worst["linear"]["part"], worst["angular"]["part"]) == ("foot", "hand")
    assert worst["linear"]["files"] == feet["everywhere"]["files"]


def test_jumps_are_steps_that_stand_out_and_fast_motion_is_none(modules: SimpleNamespace) -> None:
    figures, build = two(modules, 1.0)
    figures[0].turns[:, HAND] = spin(240, np.radians(30.0) * FPS)  # 30 degrees a frame, evenly
    outcome = modules.jumps.measure_jumps(build())
    assert outcome["rotation_jumps_per_minute"] == 0.0
    figures[1].turns[100:, FOOT] = spin(240, np.radians(15.0) * FPS)[1]
    outcome = modules.jumps.measure_jumps(build())
    assert outcome["rotation_jumps_per_minute"] == pytest.approx(1 / (8 / 60))
    assert outcome["rotation_jumps_by_joint"]["left_foot"] > 0.0
    assert outcome["rotation_moments"][0]["avatar"] == 1
    assert outcome["rotation_jumps_per_minute_of_the_source"] == 0.0


def test_a_pelvis_that_sinks_within_two_frames_drops_and_one_that_crouches_does_not(modules: SimpleNamespace) -> None:
    figures, build = two(modules, 1.0)
    figures[0].joints[100:160, PELVIS, 1] -= np.arange(60) * 0.01  # 2 cm in two frames, on and on
    assert modules.jumps.measure_jumps(build())["pelvis_drops_per_minute"] == 0.0
    figures[1].joints[101:, PELVIS, 1] -= 0.0225
    figures[1].joints[102:, PELVIS, 1] -= 0.0225
    outcome = modules.jumps.measure_jumps(build())
    assert outcome["pelvis_drops_per_minute"] == pytest.approx(1 / (8 / 60))
    assert outcome["pelvis_moments"][0]["value"] == pytest.approx(0.045)


def test_heads_face_opponents_and_hits_come_from_behind(modules: SimpleNamespace) -> None:
    hits = [(1.0, 0, 1, 0, True), (1.0, 1, 0, 0, True), (2.0, 1, 0, 0, True)]
    figures, build = two(modules, 1.0, strikes=hits)
    outcome = modules.gaze.measure_gaze(build())
    assert (outcome["facing_share"], outcome["away_share"], outcome["hits_from_behind"]) == (1.0, 0.0, 0)
    figures[1].pelvises[:] *= -1.0
    figures[1].faces[:] *= -1.0
    outcome = modules.gaze.measure_gaze(build())
    assert (outcome["facing_share"], outcome["away_share"]) == (0.5, 0.5)
    assert outcome["hits_from_behind_share"] == pytest.approx(1 / 3)
    assert outcome["turned_to_attacker_share"] == 0.0
    figures[1].faces[100:110] *= -1.0
    assert modules.gaze.measure_gaze(build())["turned_to_attacker_share"] == 1.0


def test_gaze_counts_only_near_opponents(modules: SimpleNamespace) -> None:
    _, build = two(modules, 2.0)
    assert modules.gaze.measure_gaze(build())["facing_share"] is None


def reacting(modules: SimpleNamespace, moved: float, back: int = 240) -> tuple[Any, Any]:
    """A hit at 1 s along +z that moves the victim's head by ``moved`` within 0.1 s, until frame ``back``."""
    figures, build = two(modules, 1.0, strikes=[(1.0, 0, 1, 0, True)])
    figures[0].fists[:, 0] = [0.0, 4.0, 0.0]
    figures[0].fists[57:61, 0, 2] = [0.0, 0.1, 0.2, 0.3]
    figures[1].head[66:back, 2] += moved
    return figures, build


@pytest.mark.parametrize(("moved", "share"), [(0.031, 1.0), (0.029, 0.0), (-0.05, 0.0)])
def test_heads_that_move_along_the_strike_react(modules: SimpleNamespace, moved: float, share: float) -> None:
    _, build = reacting(modules, moved)
    outcome = modules.reactions.measure_reactions(build())
    assert outcome["raw"]["median"] == pytest.approx(moved)
    assert outcome["raw"]["share_of_3_cm"] == outcome["over_unhit"]["share_of_3_cm"] == share
    assert outcome["lean_after"]["0.2"] == outcome["lean_after"]["1"] == pytest.approx(moved)


def test_what_the_motion_does_by_itself_is_no_reaction(modules: SimpleNamespace) -> None:
    figures, build = reacting(modules, 0.0)
    run = build()
    # The source moves its head back as the victim does, who is turned by half a turn.
    figures[1].head[60:, 2] += np.arange(180) * 0.01
    run.source.figure.head[60:, 2] -= np.arange(180) * 0.01
    outcome = modules.reactions.measure_reactions(run)
    assert outcome["raw"]["median"] == pytest.approx(0.12)
    assert outcome["over_unhit"]["median"] == pytest.approx(0.0, abs=1e-9)
    assert outcome["lean_after"]["0.5"] == pytest.approx(0.0, abs=1e-9)


def test_leans_decay_and_feet_step(modules: SimpleNamespace) -> None:
    figures, build = reacting(modules, 0.08, back=85)
    outcome = modules.reactions.measure_reactions(build())
    assert outcome["lean_after"]["0.3"] == pytest.approx(0.08)
    assert outcome["lean_left_after_half_a_second"] == pytest.approx(0.0, abs=1e-9)
    assert outcome["step_share_after_strong_hits"] == 0.0
    figures[1].joints[90:, FOOT, 2] += 0.12
    outcome = modules.reactions.measure_reactions(build())
    assert outcome["step_median_after_strong_hits"] == pytest.approx(0.12)
    assert outcome["step_share_after_strong_hits"] == 1.0


def test_an_unhit_moment_is_none_near_a_hit(modules: SimpleNamespace) -> None:
    figures, build = two(modules, 1.0, strikes=[(1.0, 0, 1, 0, True)])
    figures[0].fists[57:61, 0, 2] = [0.0, 0.1, 0.2, 0.3]
    run = build()
    chosen, way = modules.reactions.unhit_moment(run, run.strikes()[0], np.array([1.0]))
    assert chosen > (1.0 + modules.reactions.CLEAR) * FPS - 1
    np.testing.assert_allclose(way, [0.0, 0.0, 1.0], atol=1e-9)
    assert modules.reactions.unhit_moment(run, run.strikes()[0], np.array([0.0, 1.0, 2.0, 3.0])) is None


def test_a_piece_that_is_played_thrice_is_the_most_repeated(modules: SimpleNamespace) -> None:
    seconds = np.tile(np.arange(60) / FPS, 3)[None]  # a second, three times, in three seconds
    found = modules.variety.most_repeated(np.zeros((1, 180), int), seconds, FPS)
    np.testing.assert_allclose(found, [3 / (3 / 60)])
    once = modules.variety.most_repeated(np.zeros((1, 180), int), np.arange(180)[None] / FPS, FPS)
    np.testing.assert_allclose(once, [1 / (3 / 60)])


def test_neighbours_at_the_same_source_are_near_in_time_source_and_space(modules: SimpleNamespace) -> None:
    frames, clips = np.arange(100) / 10.0, np.zeros((2, 100), int)
    pelvises = np.zeros((2, 100, 2))
    late = np.stack([frames, frames - 1.5])
    assert modules.variety.same_source(clips, late, pelvises, 10.0).mean() > 0.7
    assert not modules.variety.same_source(clips, np.stack([frames, frames - 2.5]), pelvises, 10.0).any()
    assert not modules.variety.same_source(np.array([[0], [1]]) + clips, late, pelvises, 10.0).any()
    pelvises[1, :, 0] = 3.0
    assert not modules.variety.same_source(clips, late, pelvises, 10.0).any()


@pytest.mark.parametrize(("later", "lag", "count"), [(0.1, 0.0, 1), (0.5, 0.0, 0), (0.1, 1.0, 0)])
def test_the_same_strike_at_once_is_near_in_time_and_source(
    modules: SimpleNamespace, later: float, lag: float, count: int
) -> None:
    _, build = two(modules, 1.0, strikes=[(1.0, 0, 1, 0, True), (1.0 + later, 1, 0, 1, False)])
    run = build()
    run.frames[1] = np.maximum(run.frames[1] - FPS * (later + lag), 0)
    outcome = modules.variety.measure_variety(run)
    assert outcome["same_strikes_at_once"] == count


def test_bodies_are_still_below_a_speed(modules: SimpleNamespace) -> None:
    figures, build = two(modules, 1.0)
    figures[0].joints[1:121, :, 0] += np.arange(120)[:, None] * 0.01  # 0.6 m/s for half the time
    figures[0].joints[121:, :, 0] += 1.19
    outcome = modules.variety.measure_variety(build())
    assert outcome["still_share"] == pytest.approx(0.75, abs=0.01)
    assert outcome["still_share_of_the_source"] == 1.0


def test_worst_moments_of_one_avatar_are_a_second_apart(modules: SimpleNamespace) -> None:
    values = np.array([5.0, 4.0, 3.0, 2.0])
    found = modules.run.worst_moments(values, np.array([0, 0, 1, 0]), np.array([100, 130, 130, 200]), FPS)
    assert [one["value"] for one in found] == [5.0, 3.0, 2.0]


def test_typical_moments_are_those_nearest_to_the_median(modules: SimpleNamespace) -> None:
    values = np.array([9.0, 1.0, 4.0, 5.0, 3.0])
    found = modules.run.typical_moments(values, np.arange(5), np.zeros(5, int), FPS, other=np.arange(5) + 10)
    assert [one["value"] for one in found] == [4.0, 5.0, 3.0, 1.0, 9.0]
    assert [one["other"] for one in found] == [12, 13, 14, 11, 10]


def test_goals_are_stated_in_the_unit_of_their_figure(modules: SimpleNamespace) -> None:
    by_keys = {measure.keys: measure for measure in modules.goals.MEASURES}
    assert by_keys["bodies", "without_arms", "share"].goal("brawl_30") == "at most 0.2 %"
    assert by_keys["variety", "same_source_share"].goal("brawl_30_cmu") == "at most 40 %"
    assert by_keys["gaze", "facing_share"].goal("brawl_30") == "at least 90 %"
    assert by_keys["jumps", "rotation_jumps_per_minute"].goal("brawl_30") == "at most the source's"
    assert len(by_keys) == len(modules.goals.MEASURES)


def test_goals_are_met_up_to_their_bound(modules: SimpleNamespace) -> None:
    by_keys = {measure.keys: measure for measure in modules.goals.MEASURES}
    same, still = by_keys["variety", "same_source_share"], by_keys["variety", "still_share"]
    jumps, facing = by_keys["jumps", "rotation_jumps_per_minute"], by_keys["gaze", "facing_share"]
    assert same.met("brawl_30", 0.1, None)
    assert not same.met("brawl_30", 0.2, None)
    assert same.met("brawl_30_cmu", 0.2, None)
    assert still.met("brawl_30", 0.05, 0.1)
    assert not still.met("brawl_30", 0.04, 0.1)
    assert jumps.met("brawl_30", 2.0, 2.0)
    assert not jumps.met("brawl_30", 2.1, 2.0)
    assert facing.met("brawl_30", None, None)
    assert not facing.met("brawl_30", 0.89, None)
