"""What is played live in a browser: it is followed, changed by the mouse, recorded, and repeated."""

from __future__ import annotations

import math
import threading
from pathlib import Path

import numpy as np
import pytest
from conftest import picture, screen
from naive_view import unpack_scene
from scenes import crowdsim, scene

import crowdsim as library
from crowdsim.play.session import Session, boxer_and_target
from crowdsim.preparation.prepare import load_policies
from crowdsim.scenario.scenario import load_scenario
from crowdsim.view.server import open_server
from crowdsim.view.stage import Stage

pytestmark = pytest.mark.browser

TARGET = (
    "crowdsimPlayer.view.project(...crowdsimPlayer.crowd.targets("
    "crowdsimPlayer.crowd.around(crowdsimPlayer.time * crowdsimPlayer.scene.fps))[0]).slice(0, 2)"
)


@pytest.fixture
def play(workplace, browser):
    """Serve sessions and show them; they end with the test, and the console has no errors."""
    import uvicorn

    ends = []

    def begin(scenario) -> Session:
        session = Session(scenario, load_policies(scenario))
        stage = Stage(session, lambda: f"Recorded as {session.record(Path('recorded')).folder}.")
        server = open_server(stage)
        running = uvicorn.Server(uvicorn.Config(server.app, log_level="error", lifespan="off"))
        thread = threading.Thread(target=running.run, kwargs={"sockets": [server.socket]}, daemon=True)
        thread.start()
        stage.start()

        def end() -> None:
            running.should_exit = True
            thread.join(60)
            stage.close()

        ends.append(end)
        session.end = end
        browser.shown(server.address)
        browser.wait("crowdsimPlayer.counts")
        assert all(request.startswith(server.address) for request in browser.requests)
        return session

    yield begin
    assert browser.console == []
    browser.open("about:blank")
    for end in ends:
        end()


def click(browser, name: str) -> None:
    browser.evaluate(f"document.getElementById('{name}').click()")


def recorded_is_repeated(browser, workplace) -> library.RecordedRun:
    """Record, run what was recorded once more, compare both byte for byte, and return the run."""
    click(browser, "record")
    browser.wait("document.getElementById('said').textContent === 'Recorded as recorded.'")
    kept, again = workplace / "recorded", workplace / "again"
    assert crowdsim("verify", kept, "-q") == 0
    assert crowdsim("run", kept / "scenario.resolved.yaml", "--out", again, "-q") == 0
    ours, theirs = (
        {path.relative_to(folder): path.read_bytes() for path in sorted((folder / "take.zarr").rglob("*"))
         if path.is_file()}
        for folder in (kept, again)
    )  # fmt: skip
    assert ours == theirs
    return library.open_run(kept)


def test_the_boxer_follows_a_target_that_is_dragged_and_lands_on_it(play, browser, workplace) -> None:
    session = play(boxer_and_target("tiny"))
    browser.wait("crowdsimPlayer.recording.latest > 8")
    x, y = browser.evaluate(TARGET)
    browser.drag((x, y), (x - 140, y + 70), steps=15)
    browser.wait("crowdsimPlayer.recording.dragged.size === 0")
    since = session.frame
    place = session.crowd.targets[0].points[-1]
    assert np.hypot(place[0], place[2] - 2.0) > 0.5
    browser.wait(f"crowdsimPlayer.facts.landed.some(i => crowdsimPlayer.scene.tables.strike_time[i] > {since / 15})")
    click(browser, "play")
    browser.wait("!crowdsimPlayer.playing")
    run = recorded_is_repeated(browser, workplace)
    np.testing.assert_allclose(run.targets[-1, 0], place, atol=1e-6)
    landed = run.events.frame[np.asarray(run.events.landed)]
    assert landed[landed > since][0] < since + 10 * 15
    # It has come within reach of where the target is now.
    assert np.hypot(run.x[-1, 0] - place[0], run.z[-1, 0] - place[2]) < 1.6
    assert f"{len(landed)} landed" in browser.evaluate("document.getElementById('summary').textContent")


def test_pictures_are_coarser_while_something_is_dragged_on_a_slow_machine(play, browser) -> None:
    play(boxer_and_target("tiny"))
    browser.wait("crowdsimPlayer.recording.latest > 8")
    x, y = browser.evaluate(TARGET)
    wide = "[crowdsimPlayer.painter.width, document.getElementById('picture').clientWidth]"
    # As on a machine that is fast enough for pictures, and not for what is dragged.
    browser.evaluate(
        "crowdsimPlayer.painter.pace = () => {};"
        "Object.assign(crowdsimPlayer.painter, { median: 30, quality: 1, level: 1 })"
    )
    browser.wait(f"(([now, whole]) => now === whole)({wide})")
    keys = {"button": "left", "buttons": 1}
    browser.call("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, **keys)
    browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=x + 20, y=y + 9, **keys)
    browser.wait(f"(([now, whole]) => now < 0.8 * whole)({wide})")
    # What names are written on takes time to put over the picture.
    assert browser.evaluate("document.getElementById('overlay').hidden")
    browser.call("Input.dispatchMouseEvent", type="mouseReleased", x=x + 20, y=y + 9, button="left")
    browser.wait(f"(([now, whole]) => now === whole)({wide})")
    browser.wait("!document.getElementById('overlay').hidden")


def test_with_shift_a_target_goes_up_and_down(play, browser) -> None:
    session = play(boxer_and_target("tiny"))
    browser.wait("crowdsimPlayer.recording.latest > 3")
    before = session.crowd.targets[0].points[-1]
    x, y = browser.evaluate(TARGET)
    keys = {"button": "left", "buttons": 1, "modifiers": 8}
    browser.call("Input.dispatchMouseEvent", type="mousePressed", x=x, y=y, **keys)
    for step in range(1, 9):
        browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y + 5 * step, **keys)
    browser.call("Input.dispatchMouseEvent", type="mouseReleased", x=x, y=y + 40, **keys)
    browser.wait("crowdsimPlayer.recording.dragged.size === 0")
    after = session.crowd.targets[0].points[-1]
    assert after[1] < before[1] - 0.1
    assert (after[0], after[2]) == (before[0], before[2])


def test_time_stands_still_and_goes_on_frame_by_frame(play, browser) -> None:
    session = play(load_scenario(scene(duration=400)))
    browser.press(" ")
    browser.wait("!crowdsimPlayer.playing")
    frame = session.frame
    browser.press("ArrowRight")
    browser.wait(f"crowdsimPlayer.recording.latest === {frame - 2}")
    assert session.frame == frame + 1
    browser.settle()
    first = browser.screenshot()
    for _ in range(10):
        browser.press("ArrowRight")
    browser.wait(f"crowdsimPlayer.recording.latest === {frame + 8}")
    browser.settle()
    assert browser.screenshot() != first
    assert session.frame == frame + 11
    browser.press(" ")
    browser.wait(f"crowdsimPlayer.recording.latest > {frame + 12}")


def test_types_are_tuned_and_avatars_set_on_one_another_and_taken_out(play, browser, workplace) -> None:
    session = play(load_scenario(scene(duration=400)))
    click(browser, "play")
    browser.wait("!crowdsimPlayer.playing")
    for key, value in (("tempo", 150), ("temperature", 0.3)):
        browser.evaluate(
            f"(() => {{ const s = document.getElementById('tune-boxer-{key}'); s.value = {value};"
            "s.dispatchEvent(new Event('change')); })()"
        )
    browser.wait("document.querySelector('#tune-boxer-tempo + output').textContent === '150'")
    browser.wait("document.querySelector('#tune-boxer-temperature + output').textContent === '0.30'")
    assert session.tunings()["boxer"]["tempo"] == 150
    assert session.tunings()["boxer"]["temperature"] == 0.3
    browser.evaluate("crowdsimPlayer.select(0)")
    browser.wait("!document.getElementById('actions').hidden")
    click(browser, "set-on")
    browser.evaluate("crowdsimPlayer.select(1)")
    browser.wait("document.getElementById('said').textContent === 'red_0 is set on red_1.'")
    browser.evaluate("crowdsimPlayer.select(3)")
    browser.settle()
    click(browser, "remove")
    for _ in range(6):
        browser.press("ArrowRight")
    browser.wait("!crowdsimPlayer.recording.state(crowdsimPlayer.recording.latest).there[3]")
    browser.wait("document.getElementById('remove').textContent === 'Bring back'")
    click(browser, "remove")
    for _ in range(6):
        browser.press("ArrowRight")
    browser.wait("crowdsimPlayer.recording.state(crowdsimPlayer.recording.latest).there[3]")
    run = recorded_is_repeated(browser, workplace)
    assert run.opponent[-1, 0] == 1
    assert -1 in run.action[:, 3]


WHERE = (
    "(([x, y, z]) => crowdsimPlayer.view.project(x, y, z).slice(0, 2))"
    "([0, 1, 2].map(i => crowdsimPlayer.crowd.heads[3 * {} + i]))"
)


HEAD = "[crowdsimPlayer.crowd.heads[3 * {0}], crowdsimPlayer.crowd.heads[3 * {0} + 2]]"
FLOOR = (
    "(({{ eye }}, way) => [0, 2].map(i => eye[i] - eye[1] / way[1] * way[i]))"
    "(crowdsimPlayer.view, crowdsimPlayer.view.ray({}, {}))"
)
"""Where the floor is under a point of the picture, x and z [m]."""


def paused(browser) -> None:
    click(browser, "play")
    browser.wait("!crowdsimPlayer.playing")
    browser.evaluate("crowdsimPlayer.chooseCamera(crowdsimPlayer.camera.choices.findIndex(one => one.name === 'top'))")
    browser.settle()


def test_the_chosen_avatar_is_dragged_elsewhere_and_the_session_repeated(play, browser, workplace) -> None:
    session = play(load_scenario(scene(duration=400)))
    paused(browser)
    browser.evaluate("crowdsimPlayer.select(2)")
    browser.settle()
    x, y = browser.evaluate(WHERE.format(2))
    latest, floor = "crowdsimPlayer.recording.latest", browser.evaluate(FLOOR.format(x + 90, y + 60))
    before, begun = browser.evaluate(HEAD.format(2)), browser.evaluate(latest)
    browser.drag((x, y), (x + 90, y + 60), steps=8)
    browser.wait("document.getElementById('said').textContent.startsWith('blue_0 is put at ')")
    for _ in range(6):
        browser.press("ArrowRight")
    browser.wait(f"{latest} >= {begun} + 6 && crowdsimPlayer.recording.states.get({latest}).there[2] === 1")
    browser.settle()
    after = browser.evaluate(HEAD.format(2))
    assert math.dist(after, floor) < 0.5 < math.dist(before, floor)
    # The camera has not turned meanwhile: the drag was the avatar's.
    assert browser.evaluate("crowdsimPlayer.camera.choices[crowdsimPlayer.camera.choice].name") == "top"
    # Where there is no room, nothing happens but that it is said.
    events = len(session._events)
    browser.evaluate("crowdsimPlayer.recording.send({ do: 'place', avatar: 2, x: 1e9, z: 0 })")
    browser.wait("document.getElementById('said').className.endsWith('wrong')")
    assert len(session._events) == events
    run = recorded_is_repeated(browser, workplace)
    assert np.count_nonzero(run.action[:, 2] < 0) == 1


def test_a_finger_drags_the_chosen_avatar_and_a_second_one_lets_it_be(play, browser) -> None:
    session = play(load_scenario(scene(duration=400)))
    paused(browser)
    browser.evaluate("crowdsimPlayer.select(1)")
    browser.settle()
    x, y = browser.evaluate(WHERE.format(1))

    def touch(kind, *points) -> None:
        browser.call("Input.dispatchTouchEvent", type=kind, touchPoints=[
            {"x": a, "y": b, "id": i} for i, (a, b) in enumerate(points)
        ])  # fmt: skip

    for second in (True, False):
        touch("touchStart", (x, y))
        for step in range(1, 6):
            touch("touchMove", (x - 14 * step, y + 10 * step))
        if second:
            touch("touchStart", (x - 70, y + 50), (x + 200, y))
            browser.wait("!crowdsimPlayer.overlay.placing")
        touch("touchEnd")
        browser.settle()
    browser.wait("document.getElementById('said').textContent.startsWith('red_1 is put at ')")
    assert [one.kind for one in session._events].count("place") == 1


def test_health_is_restored_by_a_click(play, browser, workplace) -> None:
    hurt = {"boxer": {"policy": "tiny", "damage": {"health": 300}}}
    session = play(load_scenario(scene(duration=400, types=hurt)))
    browser.wait("crowdsimPlayer.recording.state(crowdsimPlayer.recording.latest).health.some(one => one < 300)")
    click(browser, "play")
    browser.wait("!crowdsimPlayer.playing")
    low = int(np.argmin(session.health()[0]))
    browser.evaluate(f"crowdsimPlayer.select({low})")
    browser.wait("!document.getElementById('heal').hidden")
    latest = browser.evaluate("crowdsimPlayer.recording.latest")
    click(browser, "heal")
    for _ in range(2):
        browser.press("ArrowRight")
    click(browser, "heal-all")
    for _ in range(5):
        browser.press("ArrowRight")
    # What is asked for is done in its order.
    browser.wait(f"crowdsimPlayer.recording.latest === {latest + 7}")
    assert browser.evaluate(f"crowdsimPlayer.recording.states.get({latest + 7}).health[{low}]") > 280
    heals = [one for one in session._events if one.kind == "heal"]
    assert [one.group for one in heals] == [["red", "red", "blue", "blue"][low], None]
    run = recorded_is_repeated(browser, workplace)
    scene_of = unpack_scene(run.recording().scene())
    assert set(scene_of["tables"]["heal_avatar"].tolist()) == {0, 1, 2, 3}


def test_why_an_avatar_does_what_it_does_is_shown(play, browser) -> None:
    play(load_scenario(scene(duration=400)))
    browser.evaluate("crowdsimPlayer.select(1); document.getElementById('why').open = true")
    browser.wait("!!document.querySelector('#why-text .taken')")
    text = browser.evaluate("document.getElementById('why-text').innerText")
    assert "▶" in text
    assert "learned" in text


def test_values_around_the_chosen_avatar_lie_on_the_floor(play, browser) -> None:
    session = play(load_scenario(scene(duration=400)))
    paused(browser)
    browser.evaluate("crowdsimPlayer.select(1)")
    browser.settle()
    before = picture(browser)
    assert browser.evaluate("document.getElementById('values').hidden")
    browser.press("u")
    browser.wait("!!crowdsimPlayer.painter.heat")
    found = browser.evaluate("crowdsimPlayer.values.decisions.at(-1)")
    told = session.value_map(1)
    assert found["at"] == pytest.approx([told.x, told.z, told.heading], abs=1e-3)
    np.testing.assert_allclose(found["values"], told.values.ravel(), atol=2e-3)
    browser.settle()
    changed = np.abs(picture(browser) - before).max(axis=-1) > 30
    assert changed.mean() > 0.1
    # Lighter is more: in front of it, where it strikes, and behind it.
    ring = told.values[np.argmin(np.abs(told.distances - 0.9))]
    # Bodies may be in the way, and their shadows.
    browser.evaluate("Object.assign(crowdsimPlayer.painter, { quadsOf() {}, drawSkins() {} }); crowdsimPlayer.change()")
    after, lights = picture(browser), []
    for k in (np.argmax(ring), np.argmin(ring)):
        turn = told.heading + told.bearings[k]
        x, z = told.x + 0.9 * np.sin(turn), told.z + 0.9 * np.cos(turn)
        u, v = browser.evaluate(f"crowdsimPlayer.view.project({x}, 0, {z}).slice(0, 2)")
        lights.append(after[round(v) - 1 : round(v) + 2, round(u) - 1 : round(u) + 2].mean())
    assert lights[0] > lights[1] + 10
    low, high = browser.evaluate("[...document.querySelectorAll('.legend span')].map(one => Number(one.textContent))")
    assert (low, high) == pytest.approx((told.values.min(), told.values.max()), abs=0.006)
    browser.press("u")
    browser.wait("!crowdsimPlayer.painter.heat && document.getElementById('values').hidden")


def test_trails_and_the_map_of_hits_show_live(play, browser) -> None:
    play(load_scenario(scene(duration=400)))
    browser.wait("crowdsimPlayer.counts.landed > 0 && crowdsimPlayer.recording.latest > 30")
    paused(browser)
    plain = screen(browser)
    browser.press("g")
    browser.wait("crowdsimPlayer.options.trails")
    browser.settle()
    assert (np.abs(screen(browser) - plain).max(axis=-1)[:500] > 40).sum() > 50
    browser.press("g")
    before = picture(browser)
    browser.press("h")
    browser.wait("!!crowdsimPlayer.painter.heat")
    after = picture(browser)
    warm = (after[..., 0] - after[..., 2] > 60) & (np.abs(before[..., 0] - before[..., 2]) < 40)
    assert warm.sum() > 200


def test_it_begins_again(play, browser) -> None:
    session = play(load_scenario(scene(duration=400)))
    browser.wait("crowdsimPlayer.counts.thrown > 0")
    click(browser, "play")
    browser.wait("!crowdsimPlayer.playing")
    click(browser, "restart")
    browser.wait("crowdsimPlayer.recording.latest === 0")
    assert session.frame == 3
    assert browser.evaluate("crowdsimPlayer.scene.tables.strike_time.length") == session.strikes["thrown"]


def test_what_cannot_be_done_is_said(play, browser) -> None:
    play(load_scenario(scene(duration=400)))
    browser.evaluate("crowdsimPlayer.recording.send({ do: 'set_on', avatar: 1, opponent: 1 })")
    browser.wait("document.getElementById('said').textContent.startsWith('avatar 1 cannot fight itself')")
    assert browser.evaluate("document.getElementById('said').className").endswith("wrong")


def test_a_connection_that_is_lost_is_said(play, browser) -> None:
    session = play(load_scenario(scene(duration=400)))
    session.end()
    browser.wait("!document.getElementById('message').hidden")
    assert browser.evaluate("document.getElementById('message').textContent").startswith("The connection is lost")
