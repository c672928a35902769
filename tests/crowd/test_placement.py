"""Placement: everyone fits, or the error says how many did."""

import re
from pathlib import Path
from types import SimpleNamespace

import naive_placement as naive
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from crowdsim import assets
from crowdsim.crowd.distributions import draw_numbers, draw_types, temperaments_of
from crowdsim.crowd.placement import groups_of_avatars, place_groups, teams_of_avatars
from crowdsim.errors import ScenarioError
from crowdsim.scenario.scenario import Scenario, load_scenario, resolve_scenario


def scenario_of(*groups, folder=".", seed=1, types=None, **more):
    data = {"version": 1, "name": "t", "seed": seed, "duration": 1, "types": types or {"b": {}}, **more}
    data["groups"] = [{"name": f"g{i}", **group} for i, group in enumerate(groups)]
    for group in data["groups"]:
        if "mix" not in group:
            group.setdefault("type", "b")
    return resolve_scenario(Scenario.model_validate(data), folder)


def placed(*groups, **more):
    x, z, heading = place_groups(scenario_of(*groups, **more))
    return SimpleNamespace(x=x, z=z, heading=heading, count=len(x))


def drawn(*groups, **more):
    scenario = scenario_of(*groups, **more)
    types = draw_types(scenario)
    return SimpleNamespace(type=types, **{key: draw_numbers(scenario, types, key) for key in ("scale", "speed")})


def tempered(scenario, types):
    return temperaments_of(
        scenario, types, *(draw_numbers(scenario, types, key) for key in ("tempo", "aggression", "range"))
    )


def refused(*groups, **more) -> str:
    with pytest.raises(ScenarioError) as caught:
        placed(*groups, **more)
    return str(caught.value)


def looks_at(result, x, z):
    towards = np.stack([x - result.x, z - result.z])
    towards = towards / np.hypot(*towards)
    return (np.sin(result.heading) * towards[0] + np.cos(result.heading) * towards[1]).round(6)


def disc(radius=5.0, distance=0.9, **more):
    return {"kind": "disc", "radius": radius, "distance": distance, **more}


def test_a_disc_keeps_its_distance_and_its_radius():
    result = placed({"count": 30, "placement": disc(centre=[3, -2])})
    assert naive.least_distance(result.x, result.z) >= 0.9
    assert np.hypot(result.x - 3, result.z + 2).max() <= 5
    assert (looks_at(result, 3, -2) == 1).all()


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**63 - 1), st.integers(2, 40), st.floats(2.0, 50.0))
def test_random_placement_matches_naive(seed, count, radius):
    expected = naive.throw_darts(seed, count, radius, 0.4, 24)
    result = placed({"count": count, "placement": disc(radius, 0.4)}, seed=seed)
    same = len(expected)
    np.testing.assert_allclose(np.stack([result.x, result.z], axis=1)[:same], expected, atol=1e-9)
    assert same >= min(count, 12)


def test_a_crowded_disc_is_filled_by_search_where_darts_miss():
    result = placed({"count": 205, "placement": disc(7.0, 0.7)})
    assert cKDTree(np.stack([result.x, result.z], 1)).query_pairs(0.7 - 1e-9) == set()
    assert len(naive.throw_darts(1, 205, 7.0, 0.7, 24)) < 205


def test_a_million_in_a_disc_of_a_metre_is_refused_with_how_many_fit():
    message = refused({"count": 1_000_000, "placement": disc(1.0, 0.8)})
    found = re.fullmatch(
        r"t: groups\[0\]\.placement: (\d+) of 1000000 avatars fit in a disc of radius 1 m at least 0\.8 m apart, "
        r"expected a radius of about 566 m, a smaller distance or fewer avatars",
        message,
    )
    assert found, message
    assert 3 <= int(found[1]) <= 7


def test_many_avatars_keep_their_distance():
    result = placed({"count": 50_000, "placement": disc(200.0, 0.9)})
    nearest = cKDTree(np.stack([result.x, result.z], 1)).query(np.stack([result.x, result.z], 1), k=2)[0][:, 1]
    assert nearest.min() >= 0.9
    inner = np.count_nonzero(np.hypot(result.x, result.z) < 200 / np.sqrt(2))
    assert abs(inner - 25_000) < 1_000


def test_discs_keep_their_distance_to_groups_before_them():
    result = placed({"count": 20, "placement": disc(4.0)}, {"count": 20, "placement": disc(4.0), "team": "x"})
    assert naive.least_distance(result.x, result.z) >= 0.9


def test_the_seed_decides_and_nothing_else():
    groups = ({"count": 40, "mix": {"a": 1, "b": 2}, "facing": "random", "placement": disc()},)
    types = {"a": {"scale": {"kind": "normal", "deviation": 0.1}}, "b": {"speed": {"kind": "uniform", "minimum": 0.9,
             "maximum": 1.1}}}  # fmt: skip
    first, again, other = (placed(*groups, types=types, seed=seed) for seed in (5, 5, 6))
    for key in ("x", "z", "heading"):
        assert getattr(first, key).tobytes() == getattr(again, key).tobytes()
        assert getattr(first, key).tobytes() != getattr(other, key).tobytes()
    first, again, other = (drawn(*groups, types=types, seed=seed) for seed in (5, 5, 6))
    for key in ("type", "scale", "speed"):
        assert getattr(first, key).tobytes() == getattr(again, key).tobytes()
        assert getattr(first, key).tobytes() != getattr(other, key).tobytes()


def test_a_grid_is_made_of_rows_with_headings_ahead():
    result = placed({"count": 7, "placement": {"kind": "grid", "columns": 3, "spacing": 2}})
    np.testing.assert_allclose(result.x, [2, 0, -2, 2, 0, -2, 0], atol=1e-12)
    np.testing.assert_allclose(result.z, [2, 2, 2, 0, 0, 0, -2], atol=1e-12)
    np.testing.assert_allclose(result.heading, 0)


def test_a_rotated_grid_is_the_same_grid_in_another_frame():
    result = placed(
        {"count": 7, "placement": {"kind": "grid", "columns": 3, "spacing": 2, "rotation": 90, "centre": [1, 1]}}
    )
    np.testing.assert_allclose(result.x, np.array([2, 2, 2, 0, 0, 0, -2]) + 1, atol=1e-12)
    np.testing.assert_allclose(result.z, np.array([-2, 0, 2, -2, 0, 2, 0]) + 1, atol=1e-12)
    np.testing.assert_allclose(result.heading, np.pi / 2)


def test_headings_of_a_ring_point_at_its_centre():
    result = placed({"count": 6, "placement": {"kind": "ring", "radius": 3, "centre": [1, 2]}})
    np.testing.assert_allclose(np.hypot(result.x - 1, result.z - 2), 3)
    assert (looks_at(result, 1, 2) == 1).all()
    np.testing.assert_allclose([result.x[0], result.z[0]], [1, 5])


def test_a_ring_and_a_line_have_room_for_so_many():
    ring = {"kind": "ring", "radius": 1, "distance": 1}
    assert placed({"count": 6, "placement": ring}).count == 6
    assert refused({"count": 7, "placement": ring}) == (
        "t: groups[0].placement: 6 of 7 avatars fit on a ring of radius 1 m at least 1 m apart, expected a radius of "
        "1.16 m, a smaller distance or fewer avatars"
    )
    line = {"kind": "line", "start": [0, 0], "end": [3, 4], "distance": 0.5}
    assert naive.least_distance(*np.stack([(p := placed({"count": 11, "placement": line})).x, p.z])) == pytest.approx(
        0.5
    )
    assert refused({"count": 12, "placement": line}) == (
        "t: groups[0].placement: 11 of 12 avatars fit on a line of 5 m at least 0.5 m apart, expected a line of 5.5 m, "
        "a smaller distance or fewer avatars"
    )


def test_headings_of_a_line_point_across_it():
    result = placed({"count": 3, "placement": {"kind": "line", "start": [-3, 1], "end": [3, 1]}})
    np.testing.assert_allclose(result.x, [-3, 0, 3])
    np.testing.assert_allclose(result.heading, 0, atol=1e-12)


@pytest.mark.parametrize("rotation", [0.0, 30.0, -135.0])
def test_two_armies_face_each_other_across_their_gap(rotation):
    army = {"kind": "army", "gap": 4, "ranks": 2, "spacing": 1, "rotation": rotation}
    result = placed(
        {"count": 7, "team": "a", "placement": {**army, "side": "left"}},
        {"count": 7, "team": "b", "placement": {**army, "side": "right"}},
    )
    left, right = slice(0, 7), slice(7, 14)
    # Mirror images of each other in the middle of the gap.
    np.testing.assert_allclose(np.abs(np.angle(np.exp(1j * (result.heading[left] - result.heading[right])))), np.pi)
    gap = np.hypot(result.x[left, None] - result.x[right], result.z[left, None] - result.z[right]).min()
    assert gap == pytest.approx(4)
    across = np.array([np.cos(np.radians(rotation)), -np.sin(np.radians(rotation))])
    assert (np.stack([result.x, result.z], 1)[left] @ across >= 2 - 1e-9).all()
    facing = np.stack([np.sin(result.heading), np.cos(result.heading)], 1)
    np.testing.assert_allclose(facing[left] @ across, -1)


def test_ranks_of_an_army_have_a_depth_and_stand_behind_the_gaps_of_those_before_them():
    army = {"kind": "army", "side": "left", "gap": 4, "ranks": 3, "spacing": 2, "depth": 0.9, "offset": 0.25}
    result = placed({"count": 6, "placement": army})
    np.testing.assert_allclose(result.x, [2, 2, 2.9, 2.9, 3.8, 3.8])
    np.testing.assert_allclose(result.z, [-1, 1, -0.5, 1.5, -1, 1])
    short = placed({"count": 7, "placement": {**army, "ranks": 2, "offset": 0.5}})
    np.testing.assert_allclose(short.z, [-3, -1, 1, 3, -2, 0, 2])


def test_facing_sets_headings():
    place = {"kind": "ring", "radius": 2, "centre": [4, 0]}
    other = {"count": 2, "team": "x", "placement": {"kind": "line", "start": [-9, -1], "end": [-9, 1]}}
    group = {"count": 5, "team": "y", "placement": place}
    result = placed({**group, "facing": "outwards"}, other)
    assert (looks_at(result, 4, 0)[:5] == -1).all()
    assert (looks_at(placed({**group, "facing": "enemies"}, other), -9, 0)[:5] == 1).all()
    np.testing.assert_allclose(placed({**group, "facing": -90}, other).heading[:5], -np.pi / 2)
    random = placed({**group, "facing": "random", "count": 9}, other).heading[:9]
    assert len(np.unique(random)) == 9
    assert np.abs(random).max() <= np.pi


def test_points_come_from_text_and_binary_files_alike(tmp_path):
    points = np.array([[0, 0, 90], [1, 2, -90], [3.5, -1, 0]])
    np.save(tmp_path / "p.npy", points.astype(np.float32))
    (tmp_path / "p.csv").write_text("X [m],z (m),heading\n" + "\n".join(",".join(map(str, row)) for row in points))
    (tmp_path / "q.csv").write_text("\n".join(" ".join(map(str, row)) for row in points))
    (tmp_path / "r.csv").write_text("\ufeff0;0;90\n1;2;-90\n3.5;-1;0\n", encoding="utf-8")
    for file in ("p.npy", "p.csv", "q.csv", "r.csv"):
        result = placed({"count": 3, "placement": {"kind": "points", "file": file}}, folder=tmp_path)
        np.testing.assert_allclose(result.x, points[:, 0], err_msg=file)
        np.testing.assert_allclose(result.z, points[:, 1])
        np.testing.assert_allclose(result.heading, np.radians(points[:, 2]))
    inline = placed({"count": 2, "placement": {"kind": "points", "points": [[0, 1], [2, 1]]}})
    np.testing.assert_allclose(inline.heading, [np.pi / 2, -np.pi / 2])


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ("x,z\n1,2\n3,x\n", "could not convert string 'x' to float64"),
        ("x,z\n1,2\n3\n", "number of columns changed"),
        ("1\n2\n", "holds an array of shape (2, 1), expected rows of x, z and perhaps a heading"),
        ("1,2\n3,inf\n", "row 2 is 3, inf, expected finite numbers up to 4000 m"),
        ("x,z\n", "0 of 2 avatars fit, for there are 0 points, expected 2 or more"),
        ("1,2\n", "1 of 2 avatars fit, for there are 1 points, expected 2 or more"),
    ],
)
def test_a_file_of_points_that_cannot_be_used_says_why(tmp_path, content, reason):
    (tmp_path / "p.csv").write_text(content)
    message = refused({"count": 2, "placement": {"kind": "points", "file": "p.csv"}}, folder=tmp_path)
    assert message.startswith("t: groups[0].placement")
    assert reason in message
    assert "\n" not in message


def test_pickles_and_words_in_npy_files_are_refused(tmp_path):
    for name, array in (("a.npy", np.array([{"x": 1}], dtype=object)), ("b.npy", np.array(["x"]))):
        np.save(tmp_path / name, array, allow_pickle=True)
        message = refused({"count": 2, "placement": {"kind": "points", "file": name}}, folder=tmp_path)
        assert message.startswith(f"t: groups[0].placement.file: {tmp_path / name}: ")


def test_avatars_at_one_position_are_refused_by_name():
    grid = {"kind": "grid", "columns": 2}
    assert refused(
        {"count": 4, "placement": grid}, {"count": 1, "placement": {"kind": "grid", "centre": [0.75, 0.8]}}
    ) == ("t: groups[1].placement: avatar g1_0 would be 0.05 m from g0_0, expected 0.1 m or more")


def test_avatars_outside_the_arena_are_counted_and_named():
    grid = {"kind": "grid", "columns": 5, "spacing": 1}
    circle = {"kind": "circle", "radius": 1.5}
    assert refused({"count": 25, "placement": grid}, arena=circle) == (
        "t: groups[0].placement: 16 of 25 avatars are outside the arena, g0_00, g0_01, g0_02 and 13 more, "
        "expected all inside a circle of radius 1.5 m"
    )
    rectangle = {"kind": "rectangle", "size": [2, 8], "centre": [0, 0]}
    assert refused({"count": 25, "placement": grid}, arena=rectangle) == (
        "t: groups[0].placement: 10 of 25 avatars are outside the arena, g0_00, g0_04, g0_05 and 7 more, "
        "expected all inside a rectangle of 2 m by 8 m"
    )
    assert placed({"count": 9, "placement": {**grid, "columns": 3}}, arena=circle).count == 9


def test_errors_of_a_scenario_file_name_its_line(tmp_path, monkeypatch):
    monkeypatch.setattr(assets, "policy_names", lambda: ["boxer"])
    text = (Path(__file__).parents[2] / "scenarios/brawl_30.yaml").read_text()
    (tmp_path / "s.yaml").write_text(text.replace("radius: 5", "radius: 1"))
    line = 1 + text[: text.index("kind: disc")].count("\n")
    with pytest.raises(
        ScenarioError, match=rf"^{re.escape(str(tmp_path))}/s\.yaml:{line}:7: groups\[0\]\.placement: \d+ of"
    ):
        place_groups(load_scenario(tmp_path / "s.yaml"))


def test_mixes_and_distributions_are_drawn_as_they_say():
    types = {
        "a": {"scale": {"kind": "normal", "mean": 1.1, "deviation": 0.05}, "speed": 1.25},
        "b": {"scale": {"kind": "uniform", "minimum": 0.9, "maximum": 1.0}},
        "c": {},
    }
    result = drawn({"count": 20_000, "mix": {"c": 0, "b": 3, "a": 1}, "placement": disc(300.0)}, types=types)
    a, b = result.type == 0, result.type == 1
    assert (a | b).all()
    assert abs(a.mean() - 0.25) < 0.01
    assert (result.speed[a] == 1.25).all()
    assert (result.speed[b] == 1).all()
    assert result.scale[a].min() >= 1.0 - 1e-12
    assert result.scale[a].max() <= 1.2 + 1e-12
    assert abs(result.scale[a].mean() - 1.1) < 0.003
    assert abs(result.scale[b].mean() - 0.95) < 0.002


def test_temperaments_are_drawn_for_each_avatar_from_its_type():
    types = {
        "a": {"tempo": {"kind": "uniform", "minimum": 30, "maximum": 90}, "range": 0.2},
        "b": {"aggression": {"kind": "uniform", "minimum": 0.5, "maximum": 2}, "tempo": 10,
              "range": {"kind": "normal", "mean": 0.1, "deviation": 0.1}},
    }  # fmt: skip
    kinds = np.arange(20_000) % 2
    groups = ({"count": 20, "mix": {"a": 1, "b": 1}, "placement": disc(30.0)},)
    drawn = tempered(scenario_of(*groups, types=types), kinds)
    a, b = drawn[kinds == 0], drawn[kinds == 1]
    tempo = 60.0 / a[:, 0]
    assert (tempo.min(), tempo.max()) == pytest.approx((30.0, 90.0), abs=0.1)
    assert tempo.mean() == pytest.approx(60.0, abs=0.5)
    assert (a[:, 1] == 0.0).all()
    assert (a[:, 2] == 0.2).all()
    assert (b[:, 0] == 1.0).all()
    assert np.mean(2.0 ** b[:, 1]) == pytest.approx(1.25, abs=0.02)
    assert (b[:, 2].mean(), b[:, 2].min(), b[:, 2].max()) == pytest.approx((0.1, -0.1, 0.3), abs=0.005)
    assert abs(np.corrcoef(b[:, 1], b[:, 2])[0, 1]) < 0.03
    assert tempered(scenario_of(*groups, types=types), kinds[:50]).tobytes() == drawn[:50].tobytes()
    other = tempered(scenario_of(*groups, types=types, seed=6), kinds)
    assert not (other[kinds == 0, 0] == a[:, 0]).any()


def test_groups_teams_and_waiting_avatars_keep_their_order():
    events = [{"kind": "add", "group": "g1", "when": {"kind": "frame", "frame": 3}}]
    groups = [{"count": 2, "team": "x", "placement": {"kind": "grid", "centre": [9 * i, 0]}} for i in range(3)]
    groups[1] |= {"waits": True, "team": "y"}
    scenario = scenario_of(*groups, events=events)
    np.testing.assert_array_equal(groups_of_avatars(scenario), [0, 0, 1, 1, 2, 2])
    np.testing.assert_array_equal(teams_of_avatars(scenario), [0, 0, 1, 1, 0, 0])
    assert [group.name for group in scenario.groups] == ["g0", "g1", "g2"]
    assert scenario.teams == ("x", "y")


def test_a_disc_that_waits_finds_its_way_among_others_and_blocks_none_of_them():
    events = [{"kind": "add", "group": "g1", "when": {"kind": "frame", "frame": 3}}]
    here = {"count": 3, "placement": disc(1.5)}
    scenario = scenario_of(here, {**here, "waits": True}, events=events)
    x, z, _ = place_groups(scenario)
    alone = placed(here)
    np.testing.assert_array_equal(x[:3], alone.x)
    assert np.hypot(x[3:], z[3:]).max() <= 1.5
    after = scenario_of({**here, "waits": True}, here, events=[{**events[0], "group": "g0"}])
    assert len(place_groups(after)[0]) == 6
