"""Nobody passes obstacles, strikes through them do not land, and scenarios in which they make no sense are refused."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from avatar_fields import base
from naive_places import gap_to, stands
from synthetic_policy import policy
from test_damage import fighters, with_falls
from test_simulation import bytes_of, crowd

from crowdsim.crowd.kernels.confinement import AHEAD, CLEARANCE, is_clear
from crowdsim.crowd.kernels.evaluate import TERMS
from crowdsim.crowd.kernels.fall_clearance import SLIDES, hemmed_in, slide
from crowdsim.crowd.kernels.layout import LANDED, LIMB_ROOM, PELVIS, TRUNK_ROOM, Observed
from crowdsim.crowd.kernels.records import SLIDE
from crowdsim.crowd.kernels.terms import backs
from crowdsim.crowd.obstacles import scenario_shapes
from crowdsim.crowd.placement import place_groups
from crowdsim.crowd.simulation import Simulation
from crowdsim.errors import ScenarioError
from crowdsim.places.arrays import build_places, pack_parts
from crowdsim.places.description import BoxObstacle, DiscObstacle, Door, RopesObstacle, WallObstacle
from crowdsim.scenario.scenario import load_scenario

POLICIES = [policy(0, "v", name="one"), policy(1, "q", frames=50, stride=2, name="two")]
ROOM = (
    RopesObstacle(kind="ropes", points=((-1.2, -1.2), (-1.2, 4.2), (4.2, 4.2), (4.2, -1.2))),
    WallObstacle(kind="wall", points=((-1.0, 1.45), (4.0, 1.45)), doors=(Door(at=2.5, width=1.2, opens=2.0),)),
    DiscObstacle(kind="disc", centre=(0.5, 2.4), radius=0.15),
    BoxObstacle(kind="box", centre=(2.6, -0.65), size=(0.6, 0.4), rotation=20.0),
)
PARTS = pack_parts(list(enumerate(ROOM)), 15.0)


def walled(**fields):
    return replace(crowd(**fields), policies=POLICIES, parts=PARTS)


def pelvises(one, frame_of):
    """Positions of pelvises, of the avatars in the order of their numbers."""
    avatars, model = one.avatars, one.model
    found = []
    for slot in avatars.slot_of[: one.crowd.count]:
        action = avatars.motion["action"][slot]
        done = min(avatars.motion["phase"][slot], model.actions["length"][action])
        stride = model.policies["stride"][avatars.policy[slot]]
        body = (
            model.bodies[int(model.actions["origin"][action] + done * stride), PELVIS] * avatars.playback["scale"][slot]
        )
        cos, sin = np.cos(avatars.heading[slot]), np.sin(avatars.heading[slot])
        found.append((avatars.x[slot] + body[0] * cos + body[2] * sin, avatars.z[slot] - body[0] * sin + body[2] * cos))
    return found


def test_bodies_stay_out_of_obstacles_and_on_their_side_of_closed_doors():
    one = Simulation(walled(interval=15.0))
    for frame in range(150):
        chunk = one.run(1)
        scales = one.crowd.cast.scales
        for number, pelvis in enumerate(pelvises(one, frame)):
            for part in PARTS:
                if stands(part, frame):
                    assert gap_to(part, chunk.x[0, number], chunk.z[0, number]) > CLEARANCE * scales[number] - 1e-4
                    assert gap_to(part, *pelvis) > 0.0
        if frame < 30:
            assert ((chunk.z[0] < 1.45) == (one.crowd.z < 1.45)).all()


def test_without_obstacles_some_of_these_bodies_would_be_in_them():
    chunk = Simulation(replace(walled(interval=15.0), parts=PARTS[:0])).run(150)
    inside = [gap_to(part, x, z) < 0.0 for part in PARTS for x, z in zip(chunk.x.flat, chunk.z.flat, strict=True)]
    assert any(inside)


def test_bodies_without_damage_do_not_read_how_far_those_slide_that_fall():
    found = []
    for far in (0.0, 5.0):
        one = Simulation(walled(interval=15.0))
        assert len(one.avatars.conditions) == len(one.avatars.slides) == 0
        beyond = np.full(one.crowd.count, far, SLIDE)
        one.avatars = one.avatars._replace(slides=beyond[:0])
        found.append(bytes_of([one.run(60)]))
    assert found[0] == found[1]


def test_actions_that_are_clear_for_certain_are_in_no_obstacle_and_most_others_are():
    one, rng, found = Simulation(walled(interval=15.0)), np.random.default_rng(0), []
    model, rooms = one.model, np.array([TRUNK_ROOM] * 3 + [LIMB_ROOM] * 6)
    for _ in range(400):
        slot, turn, at = int(rng.integers(one.present)), rng.uniform(0.0, 2.0 * np.pi), rng.uniform(-1.5, 5.0, 2)
        row, size = model.policies[one.avatars.policy[slot]], float(one.avatars.playback["scale"][slot])
        first = int(row["actions"])
        action = int(rng.integers(first, first + len(POLICIES[one.avatars.policy[slot]].lookup_tables().actions.next)))
        frames = model.actions["origin"][action] + np.arange(model.actions["length"][action] * row["stride"] + 1)
        ground = model.ground[frames]
        # The action begins about where it was drawn, whatever its ground transforms are.
        cos, sin = size * np.cos(turn), size * np.sin(turn)
        x, z = ground["x"][0], ground["z"][0]
        base_x, base_z = at[0] - x * cos - z * sin, at[1] + x * sin - z * cos
        points = []
        for place, outline in zip(ground, model.outlines[frames], strict=True):
            c, s = np.cos(place["heading"]), np.sin(place["heading"])
            local = np.array([[0.0, 0.0], *([px * c + pz * s, pz * c - px * s] for px, _, pz in outline)])
            local += [place["x"], place["z"]]
            points += list(zip([CLEARANCE, *rooms], local[:, 0], local[:, 1], strict=True))
        lack = min(
            gap_to(part, base_x + px * cos + pz * sin, base_z - px * sin + pz * cos) - room * size
            for room, px, pz in points
            for part in PARTS
        )
        clear = is_clear(model, one.avatars, one._world.places, slot, action, base_x, base_z, cos, sin)
        found.append((clear, lack >= 0.0))
    assert all(free for clear, free in found if clear)
    assert sum(clear for clear, _ in found) > 0.7 * sum(free for _, free in found) > 40


def test_actions_far_from_all_obstacles_are_clear_but_those_of_bodies_larger_than_the_grid_reaches():
    one = Simulation(walled(interval=15.0))

    def clear():
        return is_clear(one.model, one.avatars, one._world.places, 0, 0, 40.0, 40.0, 1.0, 0.0)

    assert clear()
    one.avatars.playback["scale"][0] = 1000.0
    assert not clear()


def test_roots_slide_evenly_to_where_there_will_be_room():
    wall = pack_parts([(0, WallObstacle(kind="wall", points=((-9.0, 0.9), (9.0, 0.9))))], 15.0)
    one = Simulation(replace(walled(interval=0.0, arena=np.zeros(5), speed=1.0), parts=wall))
    assert AHEAD >= 4

    def bases():
        slots = one.avatars.slot_of[: one.crowd.count]
        return one.avatars.motion["action"][slots].copy(), base(one.model, one.avatars, slots).T

    actions, before = bases()
    last, known, growth, slid = np.zeros(len(before)), np.zeros(len(before), bool), [], 0
    for _ in range(200):
        one.run(1)
        now, after = bases()
        way = np.linalg.norm(after - before, axis=1)
        same = (now == actions) & (one.avatars.playback["action_before"][one.avatars.slot_of[: one.crowd.count]] < 0)
        growth += (way - last)[same & known].tolist()
        slid += int((same & (way > 0.0)).sum())
        last, known, actions, before = way, same, now, after
    assert slid > 30
    assert max(growth) < 0.03


@pytest.mark.parametrize("seed", range(3))
def test_what_it_costs_to_be_backed_into_obstacles_matches_naive(seed):
    one, rng = Simulation(walled()), np.random.default_rng(seed)
    model, avatars, places, seen = one.model, one.avatars, one._world.places, 0
    for own in range(12):
        x, z, size = *rng.uniform(-0.9, 3.9, 2), avatars.playback["scale"][own]
        avatars.x[own], avatars.z[own] = x, z
        state, away = model.actions["next"][avatars.motion["action"][own]], rng.normal(0.0, 1.0, 2)
        moves = model.moves[model.offsets[state] : model.offsets[state + 1]]
        values = np.zeros(len(moves))
        backs._add_backs(model, avatars, places, 0.0, own, state, *away, values)
        cos, sin = np.cos(avatars.heading[own]) * size, np.sin(avatars.heading[own]) * size
        gaps = []
        for part in PARTS[[stands(part, 0) for part in PARTS]]:
            gap, step = gap_to(part, x, z), 1e-6
            out = np.array([gap_to(part, x + step, z) - gap, gap_to(part, x, z + step) - gap]) / step
            if gap < (model.reaches[state] + backs.BEHIND) * size and out @ away > 0.0:
                gaps.append((gap, out))
        gap, out = min(gaps, key=lambda one: one[0], default=(np.inf, np.zeros(2)))
        expected = []
        for move in moves:
            end = np.array([move["x"] * cos + move["z"] * sin, move["z"] * cos - move["x"] * sin])
            near = np.clip(1.0 - (gap + end @ out) / (backs.BEHIND * size), 0.0, 1.0)
            way = away - end
            expected.append(-backs.BACKED * near * max(way @ out / np.linalg.norm(way), 0.0))
        np.testing.assert_allclose(values, expected, atol=1e-3)
        seen += min(expected) < -0.1
    assert seen >= 2


def test_a_fighter_turns_out_from_a_wall_behind_it():
    behind = pack_parts([(0, WallObstacle(kind="wall", points=((-30.0, -0.6), (30.0, -0.6))))], 15.0)
    base = replace(crowd(interval=0.0, arena=np.zeros(5), scale=1.0, speed=1.0), policies=POLICIES, parts=behind)
    x, z = np.tile(np.arange(6) * 4.0 - 10.0, 2), np.repeat([0.0, 1.2], 6)
    one = Simulation(replace(base, x=x, z=z, heading=np.where(z > 0.0, math.pi, 0.0)))
    term, costs = TERMS.index("backs"), []
    for _ in range(60):
        costs += [decision.values[term] for decision in one.explain() if len(decision.actions)]
        one.step()
    backed = [each for each in costs if each.min() < -0.05]
    assert len(backed) > 10
    assert all(np.ptp(each) > 0.0 for each in backed)
    free = Simulation(replace(one.crowd, parts=behind[:0]))
    assert not any(decision.values[term].any() for _ in range(20) for decision in (free.explain(), free.step())[0])


@pytest.mark.parametrize(("search", "threads"), [("kd_tree", 1), ("kd_tree", 2), ("scipy", 2)])
def test_takes_with_obstacles_are_the_same_for_any_search_and_threads(search, threads):
    expected = bytes_of([Simulation(walled()).run(90)])
    assert bytes_of([Simulation(walled(), threads, search).run(90)]) == expected
    backwards = Simulation(walled(), order=np.arange(12)[::-1])
    assert bytes_of([backwards.run(90)]) == expected


def test_a_simulation_with_obstacles_goes_on_from_a_state():
    whole, first, second = (Simulation(walled()) for _ in range(3))
    expected = [whole.run(40), whole.run(50)]
    first.run(40)
    state = first.state()
    assert not any(name.startswith("world.places") for name in state)
    second.restore(state)
    assert bytes_of([second.run(50)]) == bytes_of(expected[1:])


def test_no_strike_lands_through_a_wall():
    wall = pack_parts([(0, WallObstacle(kind="wall", points=((-9.0, 0.0), (9.0, 0.0)), thickness=0.02))], 15.0)
    x, z = np.tile(np.arange(6) * 0.6, 2), np.repeat([-0.33, 0.33], 6)
    base = replace(crowd(interval=0.0, arena=np.zeros(5), scale=1.0), x=x, z=z, policies=POLICIES)
    heading = np.where(z < 0.0, 0.0, math.pi)
    both = {}
    for name, parts in (("open", wall[:0]), ("walled", wall)):
        one = Simulation(replace(base, heading=heading, parts=parts))
        both[name] = one.run(120)
    for name, chunk in both.items():
        events = chunk.events
        landed = (events.outcome == LANDED) & (events.victim >= 0)
        through = (z[events.attacker] < 0.0) != (z[np.maximum(events.victim, 0)] < 0.0)
        assert (landed & through).any() == (name == "open")
    assert ((both["walled"].z < 0.0) == (z < 0.0)).all()


def scenario(tmp_path, obstacles, groups=None, **keys):
    groups = groups or [
        {"name": "red", "team": "red", "type": "a", "count": 2,
         "placement": {"kind": "points", "points": [[0, 0], [1, 0]]}},
        {"name": "blue", "team": "blue", "type": "a", "count": 1, "placement": {"kind": "points", "points": [[0, 5]]}},
    ]  # fmt: skip
    data = {"name": "t", "duration": 15, "types": {"a": {}}, "opponents": {"kind": "other_team"}, **keys}
    return load_scenario({**data, "groups": groups, "obstacles": obstacles}, policies=["boxer"])


def refusal(*arguments, **keys):
    with pytest.raises(ScenarioError) as failure:
        place_groups(scenario(*arguments, **keys))
    return str(failure.value)


def test_starts_in_walls_are_refused_with_a_place_that_is_free(tmp_path):
    wall = {"kind": "wall", "points": [[-3, 0.1], [0.5, 0.1]]}
    assert refusal(tmp_path, [wall]) == (
        "t: groups[0].placement: 1 of 2 avatars start in or near obstacles, red_0; red_0 at 0.00, 0.00 is inside "
        "obstacles[0], expected 0.3 m or more from all, such as 0.00, -0.40"
    )


def test_paths_into_obstacles_and_through_them_are_refused(tmp_path):
    room = {"kind": "wall", "points": [[-3, 6], [3, 6], [3, 9], [-3, 9]], "closed": True}
    leave = {"kind": "leave", "group": "blue", "when": {"kind": "frame", "frame": 9}}

    def said(path, obstacle=room, **keys):
        return refusal(tmp_path, [obstacle], events=[{**leave, "path": path}], **keys)

    assert said([[0, 4], [0, 6.1]]) == (
        "t: events[0].path[1]: 0, 6.1 is inside obstacles[0], expected 0.3 m or more from all, such as 0.00, 6.50"
    )
    assert said([[0, 4], [0, 7.5]]) == (
        "t: events[0].path[1]: obstacles part 0, 7.5 from 0, 4 before it, expected a gap or a door of 0.6 m or more"
    )
    assert said([[0, 7.5]]) == (
        "t: events[0].path[0]: obstacles part 0, 7.5 from where blue begins, expected a gap or a door of 0.6 m or more"
    )
    groups = [
        {"name": "red", "team": "red", "type": "a", "count": 1, "placement": {"kind": "points", "points": [[0, 0]]}},
        {"name": "blue", "team": "blue", "type": "a", "count": 1, "enter": {"path": [[0, 5], [0, 7.5], [0, 2]]}},
    ]
    assert "t: groups[1].enter.path[1]: obstacles part 0, 7.5 from 0, 5" in refusal(tmp_path, [room], groups=groups)
    door = {**room, "doors": [{"at": 3, "width": 1.2, "opens": 9}]}
    place_groups(scenario(tmp_path, [door], events=[{**leave, "path": [[0, 4], [0, 7.5]]}]))


def test_points_without_room_are_refused(tmp_path):
    box = {"kind": "box", "centre": [6, 5], "size": [4, 4]}
    put = {"kind": "place", "group": "blue", "when": {"kind": "frame", "frame": 9}}
    assert refusal(tmp_path, [box], events=[{**put, "point": [6, 5]}]) == (
        "t: events[0].point: 6, 5 is in or near obstacles[0], and no point within 1 m has room; expected one that is "
        "0.3 m or more from all, such as 6.00, 2.60"
    )
    # It is put beside the obstacle.
    place_groups(scenario(tmp_path, [box], events=[{**put, "point": [4.2, 5]}]))


def test_starts_outside_of_ropes_are_refused_and_a_solid_arena_is_of_ropes(tmp_path):
    ropes = {"kind": "ropes", "points": [[-2, -2], [-2, 4], [2, 4], [2, -2]]}
    message = "t: groups[1].placement: 1 of 1 avatars start outside of ropes, blue_0; blue_0 at 0.00, 5.00, expected "
    assert refusal(tmp_path, [ropes]) == message + "all inside"
    arena = {"kind": "rectangle", "size": [4, 12], "solid": True}
    place_groups(scenario(tmp_path, [], arena=arena))
    narrow = {**arena, "size": [2.2, 12]}
    assert "red_1 at 1.00, 0.00 is 0.07 m from the arena's ropes" in refusal(tmp_path, [], arena=narrow)


def test_a_door_before_an_obstacle_leads_nowhere(tmp_path):
    wall = {"kind": "wall", "points": [[-3, 2], [3, 2]], "doors": [{"at": 3}]}
    box = {"kind": "box", "centre": [0, 3], "size": [3, 1.5]}
    assert refusal(tmp_path, [wall, box]) == (
        "t: obstacles[0].doors[0]: the door 3 m along leads nowhere: obstacles[1] is behind it at 0.00, 2.60, "
        "expected 0.5 m of room on both sides"
    )


def test_a_door_across_a_corner_is_as_wide_as_the_crow_flies(tmp_path):
    wall = {"kind": "wall", "points": [[-3, 2], [3, 2], [3, 9]], "doors": [{"at": 6}, {"at": 11}]}
    box = {"kind": "box", "centre": [-1, 3.3], "size": [1, 1]}
    place_groups(scenario(tmp_path, [wall, box]))
    assert refusal(tmp_path, [{**wall, "doors": [{"at": 6}, {"at": 2}]}, box]) == (
        "t: obstacles[0].doors[1]: the door 2 m along leads nowhere: obstacles[1] is behind it at -1.00, 2.60, "
        "expected 0.5 m of room on both sides"
    )
    assert refusal(tmp_path, [{**wall, "doors": [{"at": 6, "width": 0.7}]}]) == (
        "t: obstacles[0].doors[0]: the door 6 m along is across a corner of its wall, where it leaves a gap of 0.49 m "
        "at 2.83, 2.17, expected 0.6 m or more: move it along the wall, or widen it"
    )


def test_walls_that_close_a_group_in_are_refused_unless_a_door_opens(tmp_path):
    room = {"kind": "wall", "points": [[-2, -2], [3, -2], [3, 2], [-2, 2]], "closed": True}
    message = refusal(tmp_path, [room])
    assert message.startswith("t: groups[0].placement: obstacles close the group in at 0.00, 0.00: no way leads to ")
    assert "groups[1].placement" in message
    place_groups(scenario(tmp_path, [{**room, "doors": [{"at": 3, "opens": 1}]}]))
    assert refusal(tmp_path, [{**room, "doors": [{"at": 3, "opens": None}]}])


def test_teams_that_rows_of_a_table_name_decide_who_is_closed_in(tmp_path):
    (tmp_path / "cast.csv").write_text("name,x,z,team\nAnna,0,0,red\nBen,1,0,blue\nCleo,0,5,red\nDov,1,5,red\n")
    text = """version: 1
name: s
duration: 15
types: {a: {}}
opponents: {kind: other_team}
obstacles: [{kind: wall, points: [[-2, -2], [3, -2], [3, 2], [-2, 2]], closed: true}]
groups: [{type: a, placement: {kind: table, file: cast.csv}}]
"""
    (tmp_path / "s.yaml").write_text(text)
    place_groups(load_scenario(tmp_path / "s.yaml", policies=["boxer"]))
    (tmp_path / "cast.csv").write_text("name,x,z,team\nAnna,0,0,red\nBen,1,5,blue\n")
    message = refusal_of(load_scenario(tmp_path / "s.yaml", policies=["boxer"]))
    assert "obstacles close the group in at 0.00, 0.00" in message


def test_a_round_solid_arena_has_ropes_just_inside_its_border(tmp_path):
    arena = {"kind": "circle", "radius": 7, "centre": [0, 2], "solid": True}
    ((_, ropes),) = scenario_shapes(scenario(tmp_path, [], arena=arena))
    corners = np.array(ropes.points) - [0.0, 2.0]
    middles = (corners + np.roll(corners, 1, axis=0)) / 2
    assert np.linalg.norm(corners, axis=1) == pytest.approx(7.0)
    assert 6.97 < np.linalg.norm(middles, axis=1).min() < 7.0


def test_discs_of_avatars_leave_obstacles_out(tmp_path):
    groups = [{"name": "all", "type": "a", "count": 40, "placement": {"kind": "disc", "radius": 4, "distance": 0.6}}]
    obstacles = [{"kind": "box", "centre": [1, 0], "size": [3, 3]}, {"kind": "disc", "centre": [-3, 0], "radius": 1}]
    one = scenario(tmp_path, obstacles, groups, opponents={"kind": "anyone"})
    x, z, _ = place_groups(one)
    parts = pack_parts(list(enumerate(one.obstacles)), 1.0)
    assert min(gap_to(part, *point) for part in parts for point in zip(x, z, strict=True)) >= 0.3


def test_uneven_ground_is_refused_by_its_name(tmp_path):
    with pytest.raises(ScenarioError, match=r"obstacles\[0\].kind: uneven ground is not supported"):
        scenario(tmp_path, [{"kind": "ramp", "points": [[0, 0], [1, 1]]}])
    with pytest.raises(ScenarioError, match="terrain: uneven ground is not supported"):
        scenario(tmp_path, [], terrain="hills.png")


def test_a_plan_is_named_with_its_file_and_kept_with_its_checksum(tmp_path):
    (tmp_path / "s.yaml").write_text(
        "version: 1\nname: s\nduration: 15\ntypes: {a: {}}\nobstacles: {file: plan.geojson}\n"
        "groups:\n  - {type: a, count: 2, placement: {kind: grid}}\n"
    )
    (tmp_path / "plan.geojson").write_text('{"type": "LineString", "coordinates": [[-3, 3], [3, 3]]}')
    one = load_scenario(tmp_path / "s.yaml", policies=["boxer"])
    assert one.files == ("plan.geojson",)
    assert one.obstacles.sha256
    place_groups(one)
    (tmp_path / "plan.geojson").write_text('{"type": "FeatureCollection", "features": []}')
    message = refusal_of(load_scenario(tmp_path / "s.yaml", policies=["boxer"]))
    assert "s.yaml:5:19: obstacles.file: " in message
    assert "is no floor plan: it draws nothing" in message
    (tmp_path / "plan.geojson").unlink()
    with pytest.raises(ScenarioError, match=r"obstacles.file: is 'plan.geojson', and .* holds no such file"):
        load_scenario(tmp_path / "s.yaml", policies=["boxer"])


def test_starts_inside_of_solid_outlines_are_refused_but_not_in_their_holes(tmp_path):
    outer = [[-4, -4], [8, -4], [8, 2.5], [2.5, 2.5], [2.5, 8], [-4, 8], [-4, -4]]
    hole = [[-2, -2], [2, -2], [2, 2], [-2, 2], [-2, -2]]
    groups = [{"name": "all", "type": "a", "count": 2,
               "placement": {"kind": "points", "points": [[0, 0], [1, 1]]}}]  # fmt: skip

    def placed(rings, at=(0, 0)):
        text = json.dumps({"type": "Polygon", "coordinates": rings})
        (tmp_path / "plan.geojson").write_text(text)
        groups[0]["placement"]["points"][0] = at
        data = {"version": 1, "name": "s", "duration": 15, "types": {"a": {}}, "groups": groups}
        (tmp_path / "s.yaml").write_text(json.dumps({**data, "obstacles": {"file": "plan.geojson"}}))
        return load_scenario(tmp_path / "s.yaml", policies=["boxer"])

    message = refusal_of(placed([outer]))
    assert (
        "2 of 2 avatars start in or near obstacles, all_0, all_1; all_0 at 0.00, 0.00 is inside the floor plan, "
        in message
    )
    assert "such as " in refusal_of(placed([outer], (-3.5, 0)))
    assert "1 of 2 avatars start in or near obstacles, all_0; all_0 at 5.00, 0.00" in refusal_of(
        placed([outer, hole], (5, 0))
    )
    place_groups(placed([outer, hole]))


def test_avatars_are_thrown_around_solid_outlines_and_into_their_holes(tmp_path):
    outer = np.array([[-6, -6], [6, -4], [5, 5], [0, 2], [-6, 6]])
    hole = np.array([[-4, -4], [2, -3], [2, 0], [-4, 0]])
    rings = [[*ring.tolist(), ring[0].tolist()] for ring in (outer, hole)]
    (tmp_path / "plan.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": rings}))
    group = {"name": "all", "type": "a", "count": 120, "placement": {"kind": "disc", "radius": 10, "distance": 0.6}}
    data = {"version": 1, "name": "s", "duration": 15, "types": {"a": {}}, "groups": [group]}
    (tmp_path / "s.yaml").write_text(json.dumps({**data, "obstacles": {"file": "plan.geojson"}}))
    x, z, _ = place_groups(load_scenario(tmp_path / "s.yaml", policies=["boxer"]))
    held = 0
    for point in np.column_stack([x, z]):
        in_outer, in_hole = (abs(turns_around(ring, point)) > 0.5 for ring in (outer, hole))
        assert in_hole or not in_outer
        held += in_hole
    assert held


def turns_around(ring, point):
    """How many times a ring goes around a point."""
    way = (ring - point) @ np.array([1, 1j])
    return np.angle(np.roll(way, -1) / way).sum() / (2 * np.pi)


def refusal_of(one):
    with pytest.raises(ScenarioError) as failure:
        place_groups(one)
    return str(failure.value)


@pytest.mark.parametrize("turn", [0.0, 1.1, -2.5])
def test_bodies_fall_before_a_wall(turn):
    model = with_falls()
    axes = model.fall_axes.copy()
    axes["to_z"] = 1.6  # a body lies ahead of where it stands, from its head to its feet
    model = model._replace(fall_axes=axes)
    one = Simulation(replace(fighters(1), policies=POLICIES), model=model)
    own, nobody = 0, Observed(np.array([0], np.int32), np.array([0], np.int32), np.zeros((1, 1), np.int32))
    one.avatars.heading[own] = turn
    here, ahead = np.array([one.avatars.x[own], one.avatars.z[own]]), np.array([np.sin(turn), np.cos(turn)])
    aside = np.array([ahead[1], -ahead[0]])
    lacks, slides = {}, {}
    for far in (2.2, 1.3, 0.9):
        ends = [tuple((here + far * ahead + side * aside).tolist()) for side in (-3.0, 3.0)]
        wall = WallObstacle(kind="wall", points=tuple(ends), thickness=0.02)
        world = one._world._replace(places=build_places(pack_parts([(0, wall)], 15.0)))
        lacks[far] = hemmed_in(model, one.avatars, world, 0, own, 0, 0.0, 0.0)
        slide(model, one.avatars, world, 0, own, 0, nobody, 0)
        slides[far] = float(np.array([one.avatars.slides["x"][own], one.avatars.slides["z"][own]]) @ ahead)
        size = one.avatars.playback["scale"][own]
        naive = max(0.25 * size - (far - 0.01 - 1.6 * size), 0.0)
        assert lacks[far] == pytest.approx(20.0 * naive**2, abs=1e-3)
    assert lacks[2.2] == 0.0 < lacks[1.3] < lacks[0.9]
    assert slides[2.2] == 0.0
    for far in (1.3, 0.9):  # in the nearest of eight directions
        assert slides[far] == pytest.approx(-SLIDES, rel=0.08)
