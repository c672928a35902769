"""What the player shows of a run is what the run has."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from naive_view import read_joints, unpack_scene
from scenes import write_scene

import crowdsim
from crowdsim.body.parts import SKIN_PARTS
from crowdsim.errors import CrowdsimError, TakeError
from crowdsim.motion.body import PARTS
from crowdsim.render.camera import build_track
from crowdsim.render.stage import build_stage
from crowdsim.render.take_source import TakeSource
from crowdsim.scenario.cameras import KINDS
from crowdsim.scenario.heals import find_heals
from crowdsim.view.page import check_size
from crowdsim.view.recording import OUTSIDE, PlannedCamera

LATE = {
    "name": "late", "team": "blue", "type": "boxer", "count": 1, "waits": True,
    "placement": {"kind": "points", "points": [[3, 0]]},
}  # fmt: skip
ENTER = {"kind": "add", "group": "late", "when": {"kind": "seconds", "seconds": 2}}
HURT = {"boxer": {"policy": "tiny", "scale": {"kind": "uniform", "minimum": 0.9, "maximum": 1.1}, "legs": 1.05,
                  "damage": {"health": 40}}}  # fmt: skip


@pytest.fixture(scope="module")
def runs():
    return {}


@pytest.fixture
def run(runs, workplace):
    """A run of five avatars of various sizes who can be hurt; one comes late."""
    if "run" not in runs:
        from scenes import scene

        groups = [*scene()["groups"], LATE]
        path = write_scene(workplace / "four.yaml", duration=90, types=HURT, groups=groups, events=[ENTER])
        runs["run"] = crowdsim.run(crowdsim.load_scenario(path))
    return runs["run"]


def read(recording):
    scene = unpack_scene(recording.scene())
    return scene, read_joints(scene, [recording.block(number) for number in range(recording.block_count)])


def test_joints_are_within_a_millimetre_or_so_of_the_poses(run) -> None:
    recording = run.recording(fps=30.0)
    scene, (joints,) = read(recording)
    (poses,) = run.sampler.sample(0, scene["frames"], 30.0)
    expected = poses.joints()[0]
    there = np.isfinite(expected[..., 0])
    assert 0 < there[:, 4].sum() < there[:, 4].size
    assert np.linalg.norm(joints - expected, axis=-1)[there].max() < 1.2e-3
    stays = scene["tables"]["present"].reshape(-1, 3)
    present = np.zeros(there.shape[:2], bool)
    for avatar, start, stop in stays:
        present[start:stop, avatar] = True
    np.testing.assert_array_equal(present, there[..., 0])


def test_a_part_of_a_run_has_the_same_poses(run) -> None:
    whole = read(run.recording(fps=30.0))[1][0]
    scene, (part,) = read(run.recording("1,3", "1s:3s", 30.0))
    assert scene["first"] == 30
    assert scene["names"] == run.cast.names[[1, 3]].tolist()
    assert np.abs(part - whole[30:90, [1, 3]]).max() < 1e-3


def test_strikes_are_those_of_the_take_with_who_is_not_recorded_marked(run) -> None:
    scene = unpack_scene(run.recording().scene())
    strikes, tables = run.strikes(), scene["tables"]
    assert len(strikes)
    np.testing.assert_allclose(tables["strike_time"], strikes["seconds"], atol=1e-5)
    np.testing.assert_array_equal(tables["strike_attacker"], strikes["attacker"])
    assert [scene["outcomes"][one] for one in tables["strike_outcome"]] == strikes["outcome"].tolist()
    attacker = int(strikes["attacker"][0])
    part = unpack_scene(run.recording([attacker]).scene())["tables"]
    own = (strikes["attacker"] == attacker) | (strikes["victim"] == attacker)
    assert len(part["strike_time"]) == own.sum()
    assert set(part["strike_attacker"].tolist()) <= {0, OUTSIDE}
    assert OUTSIDE in part["strike_victim"]


def test_health_goes_on_from_what_strikes_before_the_first_frame_have_taken(run) -> None:
    whole = unpack_scene(run.recording().scene())["tables"]
    health = whole["health"].reshape(-1, 2)
    np.testing.assert_array_equal(health, 40)
    damage = np.asarray(run.events.damage)
    hit = int(np.argmax(damage > 0))
    assert damage[hit] > 0
    victim, later = int(run.events.victim[hit]), float(run.events.frame[hit]) / 15.0 + 0.05
    part = run.recording(frames=f"{int(later * 60) + 1}:")
    left = unpack_scene(part.scene())["tables"]["health"].reshape(-1, 2)[victim]
    assert left[0] == 40
    assert left[1] < 40


def test_health_that_is_restored_is_so_in_the_recording(run) -> None:
    damage = np.asarray(run.events.damage)
    hit = int(np.argmax(damage > 0))
    victim, frame = int(run.events.victim[hit]), int(run.events.frame[hit]) + 2
    event = {"kind": "heal", "when": {"kind": "frame", "frame": frame}}
    groups = [{"name": "all", "count": run.avatar_count}]
    heals = find_heals(groups, [event], run.control_rate)
    healed = replace(run, heals=heals)
    tables = unpack_scene(healed.recording().scene())["tables"]
    assert tables["heal_avatar"].tolist() == list(range(run.avatar_count))
    np.testing.assert_allclose(tables["heal_time"], (frame - 1) / run.control_rate, atol=1e-3)
    later = (frame + 0.5) / run.control_rate
    since = (damage > 0) & (run.events.victim == victim) & (run.events.frame > frame - 1)
    lost = damage[since & (run.events.frame < frame)].sum()
    part = unpack_scene(healed.recording(frames=f"{int(later * 60) + 1}:").scene())["tables"]
    assert part["health"].reshape(-1, 2)[victim, 1] == pytest.approx(40 - lost, abs=8)
    assert part["health"].reshape(-1, 2)[victim, 1] > 40 - damage[hit]
    assert "heal_time" not in part
    only = find_heals(groups, [{**event, "group": "all", "member": 1}], run.control_rate)
    assert [(one.first, one.stop) for one in only] == [(1, 2)]


def test_shorts_are_those_of_pictures(workplace) -> None:
    groups = [
        {"name": name, "team": "red", "type": name, "count": 1, "placement": {"kind": "points", "points": [[at, 0]]}}
        for at, name in enumerate(("hems", "plain", "stripes"))
    ]
    types = {name: {"policy": "tiny"} for name in ("plain", "stripes", "hems")}
    path = write_scene(workplace / "types.yaml", duration=10, types=types, groups=groups, opponents={"kind": "anyone"})
    run = crowdsim.run(crowdsim.load_scenario(path))
    shown = unpack_scene(run.recording(avatars=[0, 2]).scene())["tables"]["skin_paint"].reshape(2, -1, 4)
    source = TakeSource(run, run.policies, 30.0)
    drawn = build_stage(source, (32, 24)).skins.pose(source.poses(0), np.array([99.0, 0.0, 99.0]), 1.0).paints
    colours = np.rint(255 * np.sqrt(drawn.reshape(2, -1, 4)[..., :3]))
    np.testing.assert_array_equal(shown[..., :3], colours)
    shorts, stripes, hems = (colours[:, SKIN_PARTS.index(name)].tolist() for name in ("shorts", "stripes", "hems"))
    assert [one == plain for one, plain in zip(stripes, shorts, strict=True)] == [True, False]
    assert [one == plain for one, plain in zip(hems, shorts, strict=True)] == [False, True]


def test_bodies_are_of_the_sex_and_with_the_hands_of_their_types(run) -> None:
    skin, glove, shirt = (PARTS.index(part) for part in ("skin", "glove", "shirt"))
    usual = unpack_scene(run.recording().scene())
    other = unpack_scene(replace(run, cast=replace(run.cast, bodies=(("female", "bare"),))).recording().scene())
    gloves, bare = (one["tables"]["paint"].reshape(-1, 8, 4) for one in (usual, other))
    assert (gloves[:, glove] != gloves[:, skin]).any(axis=-1).all()
    np.testing.assert_array_equal(bare[:, glove], gloves[:, skin])
    # Women wear tops, men have bare chests.
    np.testing.assert_array_equal(gloves[:, shirt], gloves[:, skin])
    np.testing.assert_array_equal(bare[:, shirt, :3], gloves[:, glove, :3])
    np.testing.assert_array_equal(np.delete(bare, [glove, shirt], axis=1), np.delete(gloves, [glove, shirt], axis=1))
    ends = [np.diff(one["figures"][0]["skins"][0]["ends"], prepend=0) for one in (usual, other)]
    for part, there in (("top", [0, 1]), ("gloves", [1, 0]), ("skin", [1, 1])):
        assert [int(count[SKIN_PARTS.index(part)] > 0) for count in ends] == there


def test_actions_and_opponents_are_those_of_every_control_frame(run) -> None:
    scene = unpack_scene(run.recording().scene())
    tables = scene["tables"]
    rows = tables["action_table"].reshape(-1, 4)
    for avatar in range(run.avatar_count):
        for frame in range(run.frame_count):
            first, stop = tables["action_offset"][avatar : avatar + 2]
            row = first + np.searchsorted(tables["action_frame"][first:stop], frame, side="right") - 1
            action, clip, start, stride = rows[tables["action_row"][row]]
            assert action == run.action[frame, avatar]
            first, stop = tables["opponent_offset"][avatar : avatar + 2]
            at = first + np.searchsorted(tables["opponent_frame"][first:stop], frame, side="right") - 1
            assert tables["opponent"][at] == run.opponent[frame, avatar]
            if action < 0:
                continue
            row_phase = tables["action_phase"][row] + (frame - tables["action_frame"][row]) * tables["speed"][avatar]
            assert row_phase == pytest.approx(run.action_frame[frame, avatar], abs=1e-3)
            # The captured frame that the avatar is at lies in the clip that is named.
            database = run.policies[0].database
            number = database.clip_names.index(scene["clips"][int(clip)])
            origin = (int(run.policies[0].graph.action_first[int(action)]) - 1) * database.stride
            assert origin == database.clip_starts[number] * database.stride + start
            assert stride == database.stride


def test_cameras_are_where_pictures_have_them(run) -> None:
    scene = unpack_scene(run.recording(fps=30.0).scene())
    source = TakeSource(run, run.policies, 30.0)
    assert [camera["name"] for camera in scene["cameras"]][:4] == ["auto", "side", "front", "top"]
    for i, camera in enumerate(scene["cameras"]):
        track = scene["tables"][f"camera_{i}"].reshape(-1, 9)
        view = build_track(source, camera["name"], (1280, 720)).view(60.0)
        np.testing.assert_allclose(track[10, :3], view.eye, atol=1e-3)
        np.testing.assert_allclose(track[10, 3:6], view.ahead, atol=1e-3)
        assert camera["kind"] in KINDS


def test_a_camera_of_a_fight_cuts_between_the_moments_of_its_track_as_in_pictures(run) -> None:
    # Seen from behind the one or the other in turn.
    cuts, fps = (2.17, 4.5), 30.0
    source = SimpleNamespace(fps=fps)
    ways = np.array([[0.0, 0.0, 1.0], [0.9, 0.0, 0.1], [0.0, 0.0, -1.0]])

    def view(frame: float) -> SimpleNamespace:
        turned = ways[np.searchsorted(cuts, frame / fps, side="right")] + [0.0, 0.0, 0.01 * frame / fps]
        return SimpleNamespace(eye=-turned, ahead=turned / np.linalg.norm(turned), field=0.6, haze=34.0)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("crowdsim.view.recording.build_track", lambda *_: SimpleNamespace(view=view))
        track = PlannedCamera(source, "fight", None, 15, 150, {"kind": "fight"}, True).track
    moments = 0.5 + 0.2 * np.arange(len(track))
    rows = np.flatnonzero(track[:, 8] >= 0.0)
    np.testing.assert_allclose(moments[rows] + 0.2 * track[rows, 8], cuts, atol=0.1 / fps)


def test_few_avatars_have_the_camera_of_a_fight(run, workplace) -> None:
    path = write_scene(workplace / "duel.yaml", duration=60)
    few = crowdsim.run(crowdsim.load_scenario(path))
    own = KINDS["fight"].model_validate({"kind": "fight", "avatars": [0, 2], "elevation": 20})
    recording = replace(few, cameras={"pair": own}).recording(fps=30.0)
    assert [name for name, one in recording.cameras.items() if one.slow] == ["auto", "pair"]
    scene, quick = unpack_scene(recording.scene()), unpack_scene(recording.scene(slow=False))
    assert [camera["name"] for camera in scene["cameras"]] == ["auto", "side", "front", "top", "orbit", "pair"]
    assert quick["cameras"] == scene["cameras"]
    assert set(scene["tables"]) - set(quick["tables"]) == {"camera_0", "camera_5"}
    source = TakeSource(few, few.policies, 30.0)
    for number, chosen in ((0, "auto"), (5, own)):
        track, view = scene["tables"][f"camera_{number}"].reshape(-1, 9), build_track(source, chosen, (1280, 720)).view
        for row in (0, 7, 15):
            np.testing.assert_allclose(track[row, :3], view(6.0 * row).eye, atol=1e-4)
            np.testing.assert_allclose(track[row, 3:6], view(6.0 * row).ahead, atol=1e-4)
    assert not any(one.slow for one in run.recording().cameras.values())
    assert "auto" not in few.recording([0, 2]).cameras


def test_avatars_that_are_not_there_are_refused(run) -> None:
    with pytest.raises(TakeError, match="none of these avatars is there in frames 0:10"):
        run.recording("late_0", "0:10")
    with pytest.raises(TakeError, match="there is no avatar 9"):
        run.recording("9")
    with pytest.raises(TakeError, match=r"frames"):
        run.recording(frames="5:5")


def test_a_page_that_no_browser_could_load_is_refused(run) -> None:
    recording = run.recording()
    check_size(recording)
    recording.motion.frames = 10_000_000
    with pytest.raises(CrowdsimError, match=r"the page would have about 3\.0 GB, expected 0\.6 at most: fewer avatars"):
        check_size(recording)


def test_blocks_of_large_crowds_have_fewer_frames(run) -> None:
    recording = run.recording()
    assert recording.block_frames == 300
    recording.motion.avatars = 1000
    assert recording.block_frames == 200
    recording.motion.avatars = 1_000_000
    assert recording.block_frames == 10


def test_a_scenario_camera_is_among_those_of_the_page(run) -> None:
    camera = KINDS["fixed"].model_validate({"kind": "fixed", "position": [1, 2, 9]})
    scene = unpack_scene(replace(run, cameras={"mine": camera}).recording().scene())
    assert scene["cameras"][-1] == {"name": "mine", "kind": "fixed", "position": [1.0, 2.0, 9.0]}
