"""What is played live: what is sent of it, what may be asked of it, and who may ask."""

import asyncio
import http.client
import json
import os
import queue
import re
import signal
import socket
import struct
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from naive_view import unpack_scene
from scenes import crowdsim, scene, write_scene

import crowdsim as library
from crowdsim.commands.playing import free_folder
from crowdsim.errors import RunError
from crowdsim.play.session import Session, boxer_and_target
from crowdsim.preparation.prepare import load_policies
from crowdsim.scenario.scenario import load_scenario
from crowdsim.view import server as serving
from crowdsim.view.live import LAG, ROWS, LivePoses, PosedTogether, Settled, clips_of
from crowdsim.view.server import open_server
from crowdsim.view.stage import BACKLOG, Passing, Stage, next_due

HURT = {"boxer": {"policy": "tiny", "damage": {"health": 40}}}


@pytest.fixture
def session(workplace):
    def begin(scenario):
        return Session(scenario, load_policies(scenario))

    return begin


@pytest.fixture
def stage(session):
    return Stage(session(load_scenario(scene(types=HURT))), lambda: "Recorded.")


@pytest.fixture
def address(session):
    """Address of a server of a target and a boxer, which answers until the test is done."""
    import uvicorn

    played = Stage(session(boxer_and_target("tiny")), lambda: "Recorded.")
    server = open_server(played)
    running = uvicorn.Server(uvicorn.Config(server.app, log_level="error", lifespan="off"))
    thread = threading.Thread(target=running.run, kwargs={"sockets": [server.socket]}, daemon=True)
    thread.start()
    played.start()
    yield server.address
    running.should_exit = True
    thread.join(60)
    played.close()
    assert not thread.is_alive()


@pytest.fixture
def undrawn(monkeypatch):
    """Nothing is drawn in this test."""

    def draw(*_others):
        raise AssertionError("a session has begun")

    monkeypatch.setattr(Session, "__init__", draw)


def unpack(message):
    """Return document, and rotations and roots of the one figure, by a reading of its own."""
    (length,) = struct.unpack("<I", message[:4])
    document, rest = json.loads(message[4 : 4 + length]), message[4 + length :]
    return document, rest


def test_live_poses_are_nearly_those_of_the_take(session, workplace) -> None:
    played = session(load_scenario(scene(duration=90)))
    poses, shown = LivePoses(played.crowd), {}
    for _ in range(90):
        poses.add(played.step())
        if poses.shown >= 0:
            ((roots, rotations),) = poses.poses()
            assert (roots.shape, rotations.shape[:2]) == ((ROWS, 4, 3), (ROWS, 4))
            shown[poses.shown] = roots, rotations
    assert sorted(shown) == list(range(90 - LAG))
    run = library.run(load_scenario(scene(duration=90)))
    (taken,) = run.sampler.sample(0, 90 * ROWS, run.control_rate * ROWS)
    roots = np.concatenate([shown[frame][0] for frame in sorted(shown)])
    rotations = np.concatenate([shown[frame][1] for frame in sorted(shown)])
    known = taken.root_positions[: len(roots)]
    apart = np.linalg.norm(roots - known, axis=-1)
    assert np.median(apart) < 0.02
    assert np.quantile(apart, 0.99) < 0.15
    dots = np.einsum("tnjk,tnjk->tnj", rotations, taken.rotations[: len(roots)])
    assert np.quantile(2 * np.arccos(np.clip(np.abs(dots), 0, 1)), 0.9) < np.radians(10)
    # Nothing jerks more than it does in the take, although more is known with each frame.
    jerks, smooth = (np.linalg.norm(np.diff(one, 2, axis=0), axis=-1) for one in (roots, known))
    assert np.quantile(jerks, 0.99) < 1.5 * np.quantile(smooth, 0.99)


def test_landings_are_planned_once_and_forgotten_when_they_are_past(session, monkeypatch) -> None:
    from crowdsim.view import live

    played, asked, real = session(load_scenario(scene(duration=140))), [], live.plan_landings

    def plan(take, near, *others):
        asked.append((near.attackers.copy(), near.times * take.control_rate + poses._frames[0].number))
        return real(take, near, *others)

    monkeypatch.setattr(live, "plan_landings", plan)
    poses, landed = LivePoses(played.crowd), set()
    for _ in range(120):
        frame = played.step()
        poses.add(frame)
        for attacker, time, hit in zip(frame.events.attacker, frame.events.frame, frame.events.landed, strict=True):
            if hit:
                landed.add((int(attacker), round(float(time), 2)))
        if poses.shown >= 0:
            poses.poses()
        # A strike lands up to a control frame before the frame that it is recorded in.
        least = 1000 * (poses._frames[0].number - 1)
        assert all(key[-1] >= least for key in (*poses._known.fists, *poses._known.blows))
    found = [(int(one), round(float(time), 2)) for who, times in asked for one, time in zip(who, times, strict=True)]
    assert len(found) == len(set(found)) > 0
    # All that have landed are among them, but for the last ones; others whose fists would be in a body are, too.
    assert {one for one in landed if one[1] < 110} <= set(found)


def test_fists_that_land_on_a_target_are_posed(session) -> None:
    played = session(boxer_and_target("tiny"))
    poses, landed = LivePoses(played.crowd), 0
    for _ in range(200):
        frame = played.step()
        poses.add(frame)
        landed += int(frame.events.landed.sum())
        if poses.shown >= 0:
            assert np.isfinite(poses.poses()[0][0]).all()
    assert landed > 0


def test_poses_that_are_found_at_once_are_those_that_are_asked_for() -> None:
    def pose_at(avatars, times):
        calls.append(len(avatars))
        parts = [np.flatnonzero(avatars % 2 == policy) for policy in (0, 1)]
        values = (times + avatars)[:, None, None] * np.ones((1, 2, 4))
        return [(some, f"body {k}", times[some], values[some, :, :3], values[some]) for k, some in enumerate(parts)]

    calls: list[int] = []
    avatars, times = np.array([0, 3, 1, 3, 2]), np.array([0.5, 0.25, 1.0, 0.75, 2.0])
    together = PosedTogether(pose_at, avatars, times)
    for some in ([0, 4], [3, 1, 3], [2, 0, 1], []):
        expected = [one for one in pose_at(avatars[some], times[some]) if len(one[0])]
        found = together(avatars[some], times[some])
        assert len(found) == len(expected)
        for one, other in zip(found, expected, strict=True):
            assert one[1] == other[1]
            for k in (0, 2, 3, 4):
                np.testing.assert_array_equal(one[k], other[k])
    assert calls[0] == 5
    assert sum(calls) == 5 + 8


def test_offsets_of_poses_die_away_without_a_jump() -> None:
    settled = Settled(1, 1, np.arange(3) / 30)
    still = np.tile([1.0, 0.0, 0.0, 0.0], (3, 1, 1, 1))
    places = [settled.settle(np.zeros((3, 1, 3)), still)[0]]
    for _ in range(12):
        # From the second time on it is known to be elsewhere.
        places.append(settled.settle(np.full((3, 1, 3), 0.1), still)[0])
    way = np.concatenate(places)[:, 0, 0]
    assert way[:3].tolist() == [0.0, 0.0, 0.0]
    assert (np.diff(way) >= 0).all()
    assert np.diff(way).max() < 0.035
    assert way[-1] == pytest.approx(0.1, abs=1e-4)
    # What goes to another place at once does so.
    assert settled.settle(np.full((3, 1, 3), 5.0), still)[0][0, 0, 0] == 5.0


def test_avatars_that_are_taken_out_have_no_poses(session) -> None:
    played = session(load_scenario(scene()))
    poses = LivePoses(played.crowd)
    for _ in range(5):
        poses.add(played.step())
    played.remove(2)
    for _ in range(LAG + 3):
        poses.add(played.step())
    ((roots, rotations),) = poses.poses()
    assert np.isnan(roots[:, 2]).all()
    assert np.isnan(rotations[:, 2]).all()
    assert np.isfinite(roots[:, [0, 1, 3]]).all()


def test_a_frame_says_what_the_session_knows_and_holds_its_poses(session) -> None:
    played, sent = session(load_scenario(scene(types=HURT))), []
    stage = Stage(played, lambda: "")
    stage.pause(True)
    stage.watch(sent.append)
    for _ in range(60):
        assert stage.act('{"do": "step"}') == '{"done": "step"}'
    frames = [message for message in sent if isinstance(message, bytes)]
    document, rest = unpack(frames[-1])
    assert (document["frame"], document["now"]) == (played.frame - 1 - LAG, played.frame - 1)
    assert document["there"] == [1, 1, 1, 1]
    thrown = sum(len(unpack(frame)[0]["strikes"]["time"]) for frame in frames)
    assert document["counts"] == played.strikes
    assert thrown == played.strikes["thrown"] > 0
    names = [str(name) for name in played.policies[0].database.clip_names]
    assert all(0 <= clip < len(names) for clip in document["clip"])
    joints = played.policies[0].database.skeleton.joint_count
    bits = np.array(unpack_scene(stage.scene())["figures"][0]["bits"])
    rotations = np.frombuffer(rest, "<i2", ROWS * 4 * joints * 4).reshape(ROWS, 4, joints, 4)
    roots = np.frombuffer(rest[rotations.nbytes + -rotations.nbytes % 4 :], "<f4").reshape(ROWS, 4, 3)
    again = LivePoses(played.crowd)
    played.restart()
    for _ in range(len(frames) + LAG):
        again.add(played.step())
        ((real_roots, real_rotations),) = again.poses() if again.shown >= 0 else ((0, 0),)
    np.testing.assert_array_equal(roots, real_roots.astype(np.float32))
    steps = (2.0 ** (bits - 1) - 1)[:, None]
    assert (np.abs(rotations / steps - real_rotations) <= 0.5 / steps + 1e-6).all()


def test_clips_are_those_that_motion_is_from(session) -> None:
    played = session(load_scenario(scene()))
    for _ in range(20):
        frame = played.step()
    clip, place = clips_of(played.crowd, frame)
    database, graph = played.policies[0].database, played.policies[0].graph
    for avatar in range(4):
        begin, end = database.clip_starts[clip[avatar] : clip[avatar] + 2]
        first = int(graph.action_first[frame.action[avatar]]) - 1
        assert begin <= first < end
        at = (first - begin + frame.action_frame[avatar]) * database.stride
        assert place[avatar] == pytest.approx(at, abs=1)


def test_the_scene_has_everyone_where_they_begin(stage) -> None:
    shown = unpack_scene(stage.scene())
    assert shown["names"] == ["red_0", "red_1", "blue_0", "blue_1"]
    assert shown["live"]["lag"] == LAG
    assert shown["live"]["start"] == pytest.approx([stage.played.crowd.x[0], stage.played.crowd.z[0]], abs=1e-3)
    assert {"side", "top"} <= {camera["name"] for camera in shown["cameras"]}
    assert shown["tables"]["health"].reshape(-1, 2)[:, 0].tolist() == [40.0] * 4


def test_it_goes_on_while_someone_watches_and_stands_still_when_it_is_to(stage) -> None:
    came = queue.Queue()
    stage.start()
    try:
        assert stage.played.frame == LAG + 1
        stage.watch(came.put)
        while not isinstance(came.get(timeout=60), bytes):
            pass
        while stage.played.frame < 8:
            came.get(timeout=60)
        answer = json.loads(stage.act('{"do": "pause", "paused": true}'))
        assert answer == {"done": "pause"}
        at = stage.played.frame
        stage.act('{"do": "step"}')
        assert stage.played.frame == at + 1
        stage.leave(came.put)
        stage.act('{"do": "pause", "paused": false}')
    finally:
        stage.close()


@pytest.mark.parametrize(("delay", "lost"), [(0.03, 0.0), (0.2, 0.0), (BACKLOG + 2.0, 2.0)])
def test_a_delay_is_caught_up_with_unless_it_is_long(delay, lost) -> None:
    interval, spent, now, due, frames = 1 / 15, 0.01, 0.0, 0.0, []
    for frame in range(60):
        due = next_due(due, interval, now)
        now = max(now, due) + spent
        frames.append(now)
        # Something else takes the processor.
        now += delay * (frame == 10)
    assert frames[-1] == pytest.approx(60 * interval + spent + lost, abs=interval)
    assert min(np.diff(frames)) >= spent - 1e-9


def test_what_is_asked_for_is_done_or_refused_with_a_reason(stage) -> None:
    told = []
    stage.pause(True)
    stage.watch(told.append)
    for text, answer in (
        ('{"do": "tune", "type": "boxer", "key": "tempo", "value": 90}', {"done": "tune"}),
        ('{"do": "set_on", "avatar": 0, "opponent": 3}', {"done": "set_on"}),
        ('{"do": "set_on", "avatar": 0}', {"done": "set_on"}),
        ('{"do": "place", "avatar": 2, "x": 3, "z": -4.5}', {"done": "place", "said": "blue_0 is put at 3.00, -4.50."}),
        ('{"do": "heal", "avatar": 2}', {"done": "heal"}),
        ('{"do": "heal"}', {"done": "heal"}),
        ('{"do": "remove", "avatar": 1}', {"done": "remove"}),
        ('{"do": "add", "avatar": 1}', {"done": "add"}),
        ('{"do": "speed", "speed": 2}', {"done": "speed"}),
        ('{"do": "record"}', {"done": "record", "said": "Recorded."}),
    ):
        assert json.loads(stage.act(text)) == answer
    assert json.loads(told[-1])["tunings"]["boxer"]["tempo"] == 90
    assert stage.speed == 2
    for text, reason in (
        ("nonsense", "this is no command"),
        ('{"do": "format"}', "this is no command"),
        ('{"do": "remove", "avatar": "../x"}', "this is no command: remove.avatar"),
        ('{"do": "record", "folder": "/etc"}', "this is no command: record.folder"),
        ('{"do": "speed", "speed": 1e9}', "this is no command: speed.speed"),
        ('{"do": "remove", "avatar": 77}', "avatar 77: expected a number from 0 to 3"),
        ('{"do": "place", "avatar": 0, "x": 1e5, "z": 0}', "red_0 at 100000, 0: expected x and z up to"),
        ('{"do": "heal", "avatar": 4}', "avatar 4: expected a number from 0 to 3"),
        ('{"do": "drag", "target": 0, "x": 0, "y": 1, "z": 0}', "target 0: expected one of 0"),
        ('{"do": "tune", "type": "boxer", "key": "tempo", "value": -5}', "tempo: Input should be greater"),
    ):
        assert reason in json.loads(stage.act(text))["error"]


def test_changes_by_the_scenario_are_told_to_those_who_watch(session) -> None:
    event = {"kind": "weights", "when": {"kind": "frame", "frame": 9}, "temperature": 0.4}
    stage, told = Stage(session(load_scenario(scene(events=[event]))), lambda: ""), []
    stage.pause(True)
    stage.watch(told.append)
    for _ in range(10):
        stage.act('{"do": "step"}')
    found = [json.loads(one) for one in told if isinstance(one, str)]
    shown = [one["tunings"]["boxer"]["temperature"] for one in found if "tunings" in one]
    assert shown[0] != 0.4
    assert shown[-1] == 0.4


def test_decisions_of_one_avatar_are_told(stage) -> None:
    told, others = [], []
    stage.pause(True)
    stage.watch(told.append)
    stage.watch(others.append)
    for _ in range(3):
        stage.act('{"do": "step"}')
    assert not any("why" in json.loads(one) for one in told if isinstance(one, str))
    stage.act('{"do": "why", "avatar": 2}', told.append)
    stage.act('{"do": "why", "avatar": 3}', others.append)
    actions = []
    for _ in range(25):
        stage.act('{"do": "step"}')
        actions.append(int(stage._poses._frames[-1].action[2]))
    messages = [json.loads(one) for one in told if isinstance(one, str)]
    reasons = [one["why"] for one in messages if "why" in one]
    assert len(reasons) > 2
    # A page that cannot keep up may miss them.
    assert {isinstance(one, Passing) for one in told if isinstance(one, str) and "why" in json.loads(one)} == {True}
    for one in reasons:
        assert one["avatar"] == 2
        (taken,) = [option for option in one["options"] if option["taken"]]
        assert taken["action"] == actions[one["frame"] - stage.played.frame + 25]
    # Each page is told what it asks about.
    reasons = [json.loads(one)["why"] for one in others if isinstance(one, str) and "why" in json.loads(one)]
    assert {one["avatar"] for one in reasons} == {3}
    stage.leave(others.append)
    stage.act('{"do": "why", "avatar": 1}', others.append)
    stage.act('{"do": "why"}', told.append)
    before = len(told)
    for _ in range(25):
        stage.act('{"do": "step"}')
    assert not any("why" in json.loads(one) for one in told[before:] if isinstance(one, str))


@pytest.mark.parametrize("what", ["why", "values"])
@pytest.mark.parametrize("avatar", [-50, -1, 4, 99999])
def test_what_is_asked_about_an_avatar_that_there_is_not_is_refused_and_it_goes_on(stage, what, avatar) -> None:
    told = []
    stage.pause(True)
    stage.watch(told.append)
    answer = json.loads(stage.act(json.dumps({"do": what, "avatar": avatar}), told.append))
    assert answer == {"error": f"avatar {avatar}: expected a number from 0 to 3"}
    told.clear()
    frame = stage.played.frame
    for _ in range(20):
        stage.advance()
    assert stage.played.frame == frame + 20
    assert not any(what in json.loads(one) for one in told if isinstance(one, str))


def test_beginning_again_begins_again(stage) -> None:
    told = []
    stage.pause(True)
    for _ in range(9):
        stage.act('{"do": "step"}')
    stage.watch(told.append)
    stage.act('{"do": "restart"}')
    assert stage.played.frame == LAG + 1
    assert '{"restart": true}' in told


def test_the_end_of_a_scenario_stops_it(session) -> None:
    stage = Stage(session(load_scenario(scene(until={"landed": 1}, linger=0.5))), lambda: "")
    told = []
    stage.watch(told.append)
    while not stage.played.is_over:
        stage.act('{"do": "step"}')
    stage.act('{"do": "pause", "paused": false}')
    stage.act('{"do": "step"}')
    assert stage.paused
    assert json.loads([one for one in told if isinstance(one, str)][-1])["over"] is True


def connect(address, path=None, origin=None, host=None):
    """Ask for a websocket with headers of one's own; return the status of the answer."""
    _, _, place, token, _ = address.split("/")
    connection = http.client.HTTPConnection(*place.split(":"), timeout=120)
    connection.putrequest("GET", f"/{token}/live" if path is None else path, skip_host=True)
    for name, value in (
        ("Host", host or place), ("Upgrade", "websocket"), ("Connection", "Upgrade"), ("Origin", origin),
        ("Sec-WebSocket-Key", "dGhlIHNhbXBsZSBub25jZQ=="), ("Sec-WebSocket-Version", "13"),
    ):  # fmt: skip
        if value is not None:
            connection.putheader(name, value)
    connection.endheaders()
    status = connection.getresponse().status
    connection.close()
    return status


def test_websockets_without_the_token_or_of_other_pages_are_refused(address) -> None:
    place = address.split("/")[2]
    port = place.split(":")[1]
    assert connect(address, origin=f"http://{place}") == 101
    assert connect(address, host=f"localhost:{port}", origin=f"http://localhost:{port}") == 101
    for path in (f"/{'x' * 22}/live", "/live", "//live", "/"):
        assert connect(address, path) == 403
    for origin in ("http://evil.example", "null", f"https://{place}", "http://localhost:1"):
        assert connect(address, origin=origin) == 403
    for host in ("evil.example", f"evil.example:{port}", f"192.168.0.9:{port}"):
        assert connect(address, host=host) == 403


def test_a_websocket_gets_frames_and_answers(address) -> None:
    from websockets.sync.client import connect as open_socket

    with open_socket(f"{address.replace('http', 'ws', 1)}live") as peer:
        assert unpack(peer.recv(60))[0]["there"] == [1]
        peer.send('{"do": "drag", "target": 0, "x": 1.5, "y": 1.4, "z": 0.5}')
        seen = []
        while [1.5, 1.4, 0.5] not in seen:
            message = peer.recv(60)
            if isinstance(message, bytes):
                seen = unpack(message)[0]["targets"]


def test_a_page_that_reads_nothing_misses_what_passes_and_is_left_when_too_much_waits(stage) -> None:
    class Deaf:
        def __init__(self) -> None:
            self.is_closed, self.code = asyncio.Event(), None

        async def accept(self) -> None:
            pass

        async def send_text(self, _message) -> None:
            await asyncio.Event().wait()

        send_bytes = send_text

        async def receive(self):
            await self.is_closed.wait()
            return {"type": "websocket.disconnect"}

        async def close(self, code) -> None:
            self.code = code
            self.is_closed.set()

    async def play() -> int:
        page = Deaf()
        playing = asyncio.create_task(serving._play(stage, page))
        while not stage._sends:
            await asyncio.sleep(0.01)
        (send,) = stage._sends
        for _ in range(1000):
            send(b"frame")
            send(Passing("values"))
        await asyncio.sleep(0.1)
        assert not playing.done()
        for _ in range(400):
            send("status")
        await asyncio.wait_for(playing, 60)
        return page.code

    assert asyncio.run(play()) == 1013
    assert not stage._sends


def test_a_message_that_is_no_text_closes_the_websocket(address) -> None:
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect as open_socket

    with open_socket(f"{address.replace('http', 'ws', 1)}live") as peer:
        peer.send(b"drag")
        with pytest.raises(ConnectionClosed) as caught:
            list(peer)
    assert caught.value.rcvd.code == 1003


def test_a_folder_that_cannot_be_recorded_into_is_reported_before_anything_is_played(
    workplace, capsys, undrawn
) -> None:
    (workplace / "file").write_text("mine")
    assert crowdsim("play", "tiny", "--out", workplace / "file" / "kept", "--no-open") == 2
    assert f"cannot be made: {workplace / 'file'} is a file" in capsys.readouterr().err


def test_a_missing_package_is_reported_before_anything_is_played(workplace, capsys, monkeypatch, undrawn) -> None:
    monkeypatch.setitem(sys.modules, "websockets", None)
    assert crowdsim("play", "tiny", "--no-open") == 2
    assert "package 'websockets' is missing, which serves the player" in capsys.readouterr().err


def test_a_port_in_use_is_reported_before_anything_is_played(workplace, capsys, undrawn) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert crowdsim("play", "tiny", "--port", port, "--no-open") == 2
    assert f"cannot listen at 127.0.0.1 port {port}: Address already in use" in capsys.readouterr().err


def test_what_is_no_scenario_and_no_policy_is_reported(workplace, capsys) -> None:
    assert crowdsim("play", "nothing", "--no-open") == 2
    error = capsys.readouterr().err
    assert "nothing: no such scenario" in error
    assert "or a policy, one of boxer" in error


def test_the_command_plays_and_records_where_it_is_told(workplace, monkeypatch, capsys) -> None:
    stages, answers, real = [], [], serving.server_at

    def server_at(listening, stage, *others):
        stages.append(stage)
        return real(listening, stage, *others)

    def serve(server) -> None:
        assert stages[0].paused
        answers.append(json.loads(stages[0].act('{"do": "record"}')))

    monkeypatch.setattr(serving, "server_at", server_at)
    monkeypatch.setattr(serving.Server, "serve", serve)
    kept = workplace / "kept"
    assert crowdsim("play", "tiny", "--no-open", "--paused", "--out", kept, "--seed", "7") == 0
    assert answers == [{"done": "record", "said": f"Recorded as {kept}."}]
    assert library.open_run(kept).seed == 7
    said = capsys.readouterr()
    assert f"{kept}: recorded, {LAG + 1} control frames" in said.out
    assert "what was played is kept" not in said.err


@pytest.mark.parametrize("fails", [False, True])
def test_what_was_played_is_kept_while_it_is_recorded(workplace, monkeypatch, fails) -> None:
    stages, found, real, record = [], [], serving.server_at, Session.record

    def server_at(listening, stage, *others):
        stages.append(stage)
        return real(listening, stage, *others)

    def recording(session, *others):
        found.append(load_scenario(workplace / "kept_session" / "scenario.yaml").duration)
        if fails:
            raise RunError("the disk is full")
        return record(session, *others)

    def serve(server) -> None:
        stages[0].act('{"do": "drag", "target": 0, "x": 1.5, "y": 1.4, "z": 0.5}')
        stages[0].act('{"do": "step"}')
        stages[0].act('{"do": "record"}')
        assert not (workplace / "kept_session").exists()

    monkeypatch.setattr(serving, "server_at", server_at)
    monkeypatch.setattr(serving.Server, "serve", serve)
    monkeypatch.setattr(Session, "record", recording)
    assert crowdsim("play", "tiny", "--no-open", "--paused", "--out", workplace / "kept") == 0
    assert found == [LAG + 2]
    assert (workplace / "kept_session").exists() == fails
    assert (workplace / "kept").exists() != fails


def test_what_was_played_is_kept_before_it_begins_again(workplace, monkeypatch) -> None:
    stages, real = [], serving.server_at

    def server_at(listening, stage, *others):
        stages.append(stage)
        return real(listening, stage, *others)

    def serve(server) -> None:
        assert json.loads(stages[0].act('{"do": "restart"}')) == {"done": "restart"}
        stages[0].act('{"do": "remove", "avatar": 3}')
        for _ in range(3):
            stages[0].act('{"do": "step"}')
        answers = [json.loads(stages[0].act('{"do": "restart"}')) for _ in range(2)]
        kept = Path("output") / "four_played_session"
        assert answers == [{"done": "restart", "said": f"What was played is kept in {kept}."}, {"done": "restart"}]
        assert [event.kind for event in load_scenario(kept / "scenario.yaml").events][-1] == "remove"

    monkeypatch.setattr(serving, "server_at", server_at)
    monkeypatch.setattr(serving.Server, "serve", serve)
    write_scene(workplace / "four.yaml")
    assert crowdsim("play", "four.yaml", "--no-open", "--paused") == 0
    assert [path.name for path in (workplace / "output").iterdir()] == ["four_played_session"]


def test_crowds_that_are_too_large_for_real_time_are_announced(workplace, monkeypatch, capsys) -> None:
    monkeypatch.setattr(serving.Server, "serve", lambda server: None)
    write_scene(workplace / "four.yaml", groups=[
        {"name": "all", "team": "red", "type": "boxer", "count": 160, "placement": {"kind": "grid"}},
    ], opponents={"kind": "anyone"})  # fmt: skip
    assert crowdsim("play", "four.yaml", "--no-open") == 0
    assert "160 avatars cannot be posed in real time" in capsys.readouterr().err


def test_folders_that_are_taken_get_a_number(tmp_path) -> None:
    assert free_folder(tmp_path / "run") == tmp_path / "run"
    (tmp_path / "run").mkdir()
    (tmp_path / "run_2").mkdir()
    assert free_folder(tmp_path / "run") == tmp_path / "run_3"


def begin_to_play(workplace: Path, program: str) -> subprocess.Popen[str]:
    """Play ``four.yaml`` in a process of its own, which runs a program of Python."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", program, "play", "four.yaml", "--no-open"]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment, cwd=workplace
    )


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_what_was_played_is_kept_after_ctrl_c(workplace) -> None:
    from websockets.sync.client import connect as open_socket

    write_scene(workplace / "four.yaml")
    process = begin_to_play(workplace, "from crowdsim.cli import main; main()")
    try:
        address = process.stdout.readline().strip()
        with open_socket(f"{address.replace('http', 'ws', 1)}live", open_timeout=120) as peer:
            peer.send('{"do": "remove", "avatar": 3}')
            while True:
                message = peer.recv(60)
                if isinstance(message, bytes) and unpack(message)[0]["there"] == [1, 1, 1, 0]:
                    break
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    kept = re.search(r"what was played is kept: crowdsim run (\S+) repeats it", said)[1]
    assert crowdsim("run", kept, "--out", workplace / "again", "-q") == 0
    run = library.open_run(workplace / "again")
    assert run.action[0, 3] >= 0
    assert run.action[-1, 3] == -1


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_ctrl_c_during_a_long_step_keeps_what_was_played_without_a_traceback(workplace) -> None:
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect as open_socket

    write_scene(workplace / "four.yaml")
    slow = (
        "import time; from crowdsim.cli import main; from crowdsim.view.stage import Stage; advance = Stage.advance\n"
        "def long(stage):\n  advance(stage)\n  time.sleep(600 if stage.played.frame > 20 else 0)\n"
        "Stage.advance = long; main()"
    )
    process = begin_to_play(workplace, slow)
    try:
        address = process.stdout.readline().strip()
        with open_socket(f"{address.replace('http', 'ws', 1)}live", open_timeout=120) as peer:
            peer.send('{"do": "remove", "avatar": 3}')
            while not (isinstance(message := peer.recv(60), bytes) and unpack(message)[0]["now"] == 20):
                pass
            # The step has the lock, for which this waits.
            peer.send('{"do": "remove", "avatar": 2}')
            process.send_signal(signal.SIGINT)
            with suppress(ConnectionClosed):
                for _ in peer:
                    pass
        _, said = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    assert "Traceback" not in said
    assert "ERROR" not in said
    kept = re.search(r"what was played is kept: crowdsim run (\S+) repeats it", said)[1]
    assert crowdsim("validate", kept, "-q") == 0
