"""Why avatars did what they did is what they decided by."""

import http.client
import json
import threading

import numpy as np
import pytest
from naive_view import embedded
from scenes import crowdsim, write_scene

import crowdsim as library
from crowdsim.crowd.draw import draw_crowd
from crowdsim.crowd.simulation import Simulation
from crowdsim.errors import TakeError
from crowdsim.play.repeated import Repeated
from crowdsim.scenario.scenario import load_scenario
from crowdsim.view.server import open_server


@pytest.fixture
def run(workplace, finish):
    write_scene(workplace / "four.yaml")
    finish(workplace)
    return workplace / "run"


def started(opened, avatar, frame):
    """The control frame in which the action of an avatar began, by a reading of its own."""
    while frame > 0:
        same = opened.action[frame, avatar] == opened.action[frame - 1, avatar]
        if not same or opened.action_frame[frame, avatar] <= opened.action_frame[frame - 1, avatar]:
            return frame
        frame -= 1
    return 0


def test_decisions_are_those_of_the_run(run) -> None:
    opened = library.open_run(run)
    repeated, asked = Repeated(opened), 0
    # Back and forth: the run is simulated again from its beginning.
    for frame in (30, 12, 39, 20):
        for avatar in range(4):
            began = started(opened, avatar, frame)
            if not began:
                continue
            found = repeated.at(avatar, frame)
            asked += 1
            assert (found["avatar"], found["frame"]) == (avatar, began)
            assert found["opponent"] == opened.opponent[began, avatar]
            (taken,) = [one for one in found["options"] if one["taken"]]
            assert taken["action"] == opened.action[began, avatar]
            values = [one["value"] for one in found["options"]]
            for one in found["options"]:
                # Parts that are next to nothing are left out.
                assert sum(one["parts"]) == pytest.approx(one["value"], abs=0.01)
            assert values[0] == max(values)
            assert found["options"][0]["drawn"]
    assert asked > 8


def test_values_are_those_of_the_simulation_at_that_frame(run) -> None:
    opened = library.open_run(run)
    repeated = Repeated(opened)
    simulation = Simulation(draw_crowd(load_scenario(run / "scenario.resolved.yaml"), opened.policies))
    simulation.run(22)
    for avatar in (0, 3):
        found, told = repeated.values(avatar, 21), simulation.value_map(avatar)
        assert (found["avatar"], found["frame"]) == (avatar, 21)
        np.testing.assert_allclose(found["values"], told.values.ravel(), atol=1e-3)
        assert found["at"] == pytest.approx([told.x, told.z, told.heading], abs=1e-3)
    with pytest.raises(TakeError, match="avatar 9 at control frame 1: is not in the run"):
        repeated.values(9, 1)


def test_decisions_and_values_of_a_frame_need_no_new_simulation(run, monkeypatch) -> None:
    opened, begun = library.open_run(run), []

    def draw(*values):
        begun.append(values)
        return draw_crowd(*values)

    frames = [started(opened, 1, frame) for frame in (14, 24, 39)]
    assert 0 < frames[0] < frames[1] < frames[2]
    alone = [(Repeated(opened).at(1, frame), Repeated(opened).values(1, frame)) for frame in frames]
    monkeypatch.setattr("crowdsim.play.repeated.draw_crowd", draw)
    repeated = Repeated(opened)
    assert [(repeated.at(1, frame), repeated.values(1, frame)) for frame in frames] == alone
    assert len(begun) == 1
    repeated = Repeated(opened)
    assert [(repeated.values(1, frame), repeated.at(1, frame))[::-1] for frame in frames] == alone
    assert len(begun) == 2
    assert repeated.values(1, frames[2]) == alone[2][1]
    assert len(begun) == 2


def test_what_is_not_in_the_run_is_reported(run) -> None:
    repeated = Repeated(library.open_run(run))
    for avatar, frame in ((4, 3), (-1, 3), (0, 40)):
        with pytest.raises(TakeError, match="is not in the run"):
            repeated.at(avatar, frame)


def test_a_run_that_cannot_be_repeated_is_reported(run) -> None:
    path = run / "scenario.resolved.yaml"
    path.write_text(path.read_text(encoding="utf-8").replace("seed: 5", "seed: 6"), encoding="utf-8")
    with pytest.raises(TakeError, match=r"cannot be repeated here|decides nothing at"):
        Repeated(library.open_run(run)).at(0, 39)


def test_a_run_in_memory_has_no_reasons(run) -> None:
    with pytest.raises(TakeError, match="the run is in memory"):
        Repeated(library.run(library.load_scenario(run / "scenario.resolved.yaml")))


def test_a_page_holds_the_decisions_of_those_that_are_named(run) -> None:
    page = run.parent / "page.html"
    assert crowdsim("view", run, "--html", page, "--why", "blue", "-q") == 0
    text = page.read_text(encoding="utf-8")
    scene, _ = embedded(text)
    assert scene["numbers"] == [0, 1, 2, 3]
    start = text.index('id="source">') + len('id="source">')
    reasons = json.loads(text[start : text.index("</script>", start)])["why"]
    assert sorted(reasons) == ["2", "3"]
    opened, repeated = library.open_run(run), Repeated(library.open_run(run))
    for avatar in (2, 3):
        frames = [one["frame"] for one in reasons[str(avatar)]]
        changes = 1 + np.flatnonzero(np.diff(opened.action[:, avatar]))
        assert set(changes.tolist()) <= set(frames)
        assert frames == sorted(set(frames))
        assert reasons[str(avatar)][-1] == repeated.at(avatar, 39)


def test_why_without_a_page_or_of_others_is_refused(run, capsys) -> None:
    assert crowdsim("view", run, "--why", "0", "--no-open") == 2
    assert "--why has no effect without --html" in capsys.readouterr().err
    page = run.parent / "page.html"
    assert crowdsim("view", run, "--html", page, "--avatars", "0-1", "--why", "3") == 2
    assert "--why names avatar 3, expected some of --avatars 0-1" in capsys.readouterr().err
    assert not page.exists()


def test_a_server_tells_why(run) -> None:
    import uvicorn

    opened = library.open_run(run)
    server = open_server(opened.recording(fps=30.0), reasons=Repeated(opened))
    running = uvicorn.Server(uvicorn.Config(server.app, log_level="error", lifespan="off"))
    thread = threading.Thread(target=running.run, kwargs={"sockets": [server.socket]}, daemon=True)
    thread.start()
    _, _, place, token, _ = server.address.split("/")

    def ask(path, token=token):
        connection = http.client.HTTPConnection(*place.split(":"), timeout=120)
        connection.request("GET", f"/{token}/{path}")
        answer = connection.getresponse()
        found = answer.status, answer.read()
        connection.close()
        return found

    try:
        status, body = ask("why/1/39")
        assert status == 200
        assert json.loads(body) == Repeated(opened).at(1, 39)
        assert ask("why/9/39")[0] == 404
        assert b"is not in the run" in ask("why/9/39")[1]
        assert json.loads(ask("values/2/30")[1]) == Repeated(opened).values(2, 30)
        assert ask("values/9/30")[0] == 404
        assert ask("why/x/-1")[0] == 404
        assert ask("why/1/39", "x" * 22)[0] == 403
    finally:
        running.should_exit = True
        thread.join(60)
