"""The player in a browser: pages load alone, show what pictures show, and do what input asks for."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import _chromium
import numpy as np
import pytest
import yaml
from conftest import picture, screen
from scenes import crowdsim, scene, write_scene

import crowdsim as library
from crowdsim.body.looks import usual_build
from crowdsim.body.skin import build_skin_of, pose_skins
from crowdsim.bvh.io import write_bvh
from crowdsim.performer.session import perform
from crowdsim.poses.attachments import place_attachments
from crowdsim.render.camera import build_track
from crowdsim.render.take_source import TakeSource
from crowdsim.scenario.camera_files import camera_in_file
from crowdsim.view.server import open_server

pytestmark = pytest.mark.browser

HOSTILE = "<img src=x onerror=\"document.title='owned'\"><script>document.title='owned'</script>"


@pytest.fixture
def run(workplace, finish) -> Path:
    write_scene(workplace / "four.yaml", types={"boxer": {"policy": "tiny", "damage": {"health": 40}}})
    finish(workplace)
    return workplace / "run"


@pytest.fixture
def page(run) -> Path:
    """A page of a fight of two against two."""
    assert crowdsim("view", run, "--html", run.parent / "page.html", "-q") == 0
    return run.parent / "page.html"


@pytest.fixture
def player(browser, page):
    """The page in the browser, paused at its begin."""
    browser.shown(page)
    browser.evaluate("crowdsimPlayer.play(false); crowdsimPlayer.seek(0)")
    browser.settle()
    yield browser
    assert browser.console == []


def test_a_page_from_a_file_shows_itself_without_errors_and_asks_for_nothing_else(browser, page) -> None:
    browser.shown(page)
    browser.wait("crowdsimPlayer.time > 0.5")
    assert browser.console == []
    assert browser.requests == [page.as_uri()]
    assert browser.evaluate("document.getElementById('message').hidden")
    assert browser.evaluate("document.title") == "four"


def test_joints_that_the_page_unpacks_are_within_a_millimetre_or_so_of_the_poses(player, run) -> None:
    sampler = library.open_run(run).sampler
    for frame in (0, 1, 77, 159):
        shown = np.array(player.evaluate(_chromium.JOINTS.replace("FRAME", str(frame))))
        (poses,) = sampler.sample(frame, frame + 1, 60.0)
        assert np.linalg.norm(shown - poses.joints()[0][0], axis=-1).max() < 1.2e-3


def near(shown: np.ndarray, colour: np.ndarray, far: int) -> int:
    """How many pixels have nearly the hue of a colour, however they are lit."""
    bright = shown.max(axis=-1) > 60
    unlike = np.abs(shown / np.maximum(shown.max(axis=-1, keepdims=True), 1) - colour / colour.max())
    return int((bright & (unlike.max(axis=-1) < far / 255)).sum())


def test_boxers_have_the_colours_and_the_places_that_rendered_pictures_have(player, run) -> None:
    from PIL import Image

    view = player.evaluate(
        "crowdsimPlayer.camera.choices.findIndex(choice => choice.name === 'side') + ' ' + "
        "document.getElementById('picture').clientWidth + ' ' + document.getElementById('picture').clientHeight"
    )
    choice, width, height = map(int, view.split())
    player.evaluate(f"crowdsimPlayer.chooseCamera({choice}); crowdsimPlayer.seek(1)")
    shown = picture(player)
    out = run.parent / "drawn"
    size = f"{width}x{height}"
    words = [
        "--png",
        "--camera",
        "side",
        "--frames",
        "60:61",
        "--fps",
        "60",
        "--size",
        size,
        "--no-caption",
        "--figure",
        "body",
    ]
    assert crowdsim("render", run, "--out", out, *words, "-q") == 0
    drawn = np.asarray(Image.open(out / "frames" / "000060.png").convert("RGB")).astype(int)
    for colour in ((209, 41, 38), (38, 92, 230)):
        here, there = (near(one, np.array(colour), 60) for one in (shown, drawn))
        assert there > 300
        assert 0.5 * there < here < 2.0 * there


SKINNED = """(() => {
  const { crowd, scene } = crowdsimPlayer, t = scene.tables;
  return crowd.skinned.map((avatar, row) => {
    const v = t.skin_0_vertices, first = crowd.boneRow * row + 64, bones = crowd.bones.subarray(first), points = [];
    for (let i = 0; i < v.length / 3; i += 40) {
      const p = [0, 0, 0];
      for (let k = 0; k < 4; k++) for (let axis = 0; axis < 3; axis++) {
        const at = 12 * t.skin_0_joints[4 * i + k] + 4 * axis, b = bones.subarray(at, at + 4);
        const moved = b[0] * v[3 * i] + b[1] * v[3 * i + 1] + b[2] * v[3 * i + 2] + b[3];
        p[axis] += t.skin_0_weights[4 * i + k] / 255 * moved;
      }
      points.push(p);
    }
    return [avatar, points];
  });
})()"""
"""Places of every 40th vertex of the avatars that have skins, as the graphics program finds them."""


def test_avatars_near_have_the_skins_that_exports_have(browser, workplace, finish) -> None:
    boxer = {"policy": "tiny", "scale": 1.05, "girth": 1.2, "legs": 1.06}
    write_scene(workplace / "four.yaml", types={"boxer": boxer})
    finish(workplace)
    run = library.open_run(workplace / "run")
    (workplace / "page.html").write_text(run.view(), encoding="utf-8")
    browser.shown(workplace / "page.html")
    browser.evaluate("crowdsimPlayer.play(false); crowdsimPlayer.seek(1)")
    browser.settle()
    found = browser.evaluate(SKINNED)
    assert len(found) > 1
    (poses,) = run.sampler.sample(60, 61, 60.0)
    positions, rotations = poses.joints()
    database, cast = run.policies[0].database, run.cast
    for avatar, points in found:
        girth = float(cast.girths[avatar])
        skin = build_skin_of(database, usual_build(girth), 1.4)
        lengths = cast.stretches[avatar][run.sampler.motions[0].segments]
        own = skin.shaped(girth, lengths)
        at = own.matrices(positions[0, [avatar]], rotations[0, [avatar]], cast.scales[[avatar]])
        vertices = pose_skins([own], at)[0][0]
        gaps = np.linalg.norm(np.array(points) - vertices[::40], axis=1)
        assert np.median(gaps) < 1e-3
        # Where bones meet, bodies grow there in the binding pose.
        assert gaps.max() < 8e-3
    # Capsules behind skins cast shadows and are pointed at, but are not drawn.
    assert browser.evaluate("crowdsimPlayer.crowd.visible < crowdsimPlayer.crowd.drawn")
    assert browser.console == []


LOOKS = """(distance => {
  const player = crowdsimPlayer, { camera, crowd, painter, overlay } = player, bars = [], { ctx } = overlay;
  camera.grab(player.view);
  camera.orbit.distance = distance;
  ctx.fillRect = (x, y, width, height) => { if (ctx.fillStyle.startsWith('rgba(0, 0, 0')) bars.push(width); };
  player.draw(0, true);
  delete ctx.fillRect;
  const { detail, triangles } = crowd.skinned.length ? { detail: crowd.details[crowd.skinned[0]],
    triangles: painter.mesh(0, 0, crowd.details[crowd.skinned[0]]).count / 3 } : { detail: 3, triangles: 0 };
  return [crowd.skinned.length, crowd.visible > 0, detail, triangles, Math.max(0, ...bars)];
})(DISTANCE)"""


def test_skins_are_coarser_and_bars_of_health_smaller_the_further_avatars_are(player) -> None:
    player.evaluate("crowdsimPlayer.set('labels', false)")
    found = [player.evaluate(LOOKS.replace("DISTANCE", str(distance))) for distance in (5, 9, 20, 120)]
    skinned, capsules, details, triangles, bars = zip(*found, strict=True)
    assert skinned == (4, 4, 4, 0)
    assert capsules == (False, False, False, True)
    assert list(details) == sorted(details)
    assert details[0] < 2
    assert triangles[0] >= 1400
    assert 300 < triangles[2] <= 560
    assert triangles[3] == 0
    assert bars[0] == 34
    assert 0 < bars[2] < bars[0]
    assert bars[3] == 0


def test_bodies_skeletons_and_the_labelled_cloud_are_shown(player) -> None:
    player.evaluate("crowdsimPlayer.seek(0.5); crowdsimPlayer.set('labels', false)")
    pictures = [picture(player)]
    for look in ("skeletons", "cloud"):
        player.press("k")
        player.settle()
        assert player.evaluate("crowdsimPlayer.crowd.look") == look
        pictures.append(picture(player))
        x, y = player.evaluate("crowdsimPlayer.view.project(...crowdsimPlayer.crowd.roots.subarray(3, 6)).slice(0, 2)")
        player.click(x, y)
        player.settle()
        assert player.evaluate("crowdsimPlayer.selected") >= 0
        player.evaluate("crowdsimPlayer.select(-1)")
        player.settle()
    for one, other in ((0, 1), (1, 2), (0, 2)):
        assert (np.abs(pictures[one] - pictures[other]).max(axis=-1) > 40).mean() > 0.01
    # Points lie on avatars, each with the label of its own.
    assert player.evaluate("crowdsimPlayer.crowd.points") > 4000
    far = player.evaluate(
        "(() => { const c = crowdsimPlayer.crowd, found = new Set(); let far = 0;"
        "for (let i = 0; i < c.points; i++) { found.add([...c.cloud.subarray(6 * i + 3, 6 * i + 6)].join());"
        "far = Math.max(far, Math.min(...[0, 1, 2, 3].map(a => Math.hypot(c.cloud[6 * i] - c.roots[3 * a],"
        "c.cloud[6 * i + 2] - c.roots[3 * a + 2])))); } return [found.size, far]; })()"
    )
    assert far[0] == 4
    assert far[1] < 1.2
    player.press("k")
    player.settle()
    last = picture(player)
    gaps = [np.abs(last - one).mean() for one in pictures]
    assert gaps[0] < 0.5 * min(gaps[1:]), gaps


def test_bvh_files_are_shown_as_skeletons_and_as_a_cloud(browser, workplace) -> None:
    write_bvh(workplace / "clip.bvh", perform(6.0, 2)[0].clip.sliced(0, 200))
    assert crowdsim("view", workplace / "clip.bvh", "--html", workplace / "page.html", "-q") == 0
    browser.shown(workplace / "page.html")
    browser.evaluate("crowdsimPlayer.play(false); crowdsimPlayer.seek(0.5)")
    browser.settle()
    pictures = [picture(browser)]
    for look in ("skeletons", "cloud"):
        browser.press("k")
        browser.settle()
        assert browser.evaluate("crowdsimPlayer.crowd.look") == look
        pictures.append(picture(browser))
    for one, other in ((0, 1), (1, 2), (0, 2)):
        assert (np.abs(pictures[one] - pictures[other]).max(axis=-1) > 40).mean() > 0.002
    assert browser.console == []


def test_what_avatars_carry_is_shown(browser, workplace, finish) -> None:
    ends = {"start": [-0.07, 0.0, -0.1], "end": [-0.07, 0.0, 0.6], "radius": 0.03}
    stick = {"kind": "capsules", "joint": "right_hand", "colour": "#00c800", "capsules": [ends]}
    write_scene(workplace / "four.yaml", types={"boxer": {"policy": "tiny", "attachments": [stick]}})
    finish(workplace)
    run = library.open_run(workplace / "run")
    (workplace / "page.html").write_text(run.view(fps=30), encoding="utf-8")
    browser.shown(workplace / "page.html")
    browser.evaluate("crowdsimPlayer.play(false); crowdsimPlayer.seek(1)")
    browser.settle()
    (poses,) = run.sampler.sample(30, 31, 30.0)
    held = place_attachments(run.cast, np.arange(4), *(part[0] for part in poses.joints()))
    drawn = browser.evaluate(
        "(() => { const { crowd } = crowdsimPlayer, found = []; for (let i = 0; i < crowd.visible; i++) {"
        "const s = [...crowd.shapes.subarray(12 * i, 12 * i + 12)];"
        "if (s[9] > 0.5 && s[8] < 0.01 && s[10] < 0.01) found.push([crowd.owners[i], ...s.slice(0, 8)]); }"
        "return found.sort((a, b) => a[0] - b[0]); })()"
    )
    assert [one[0] for one in drawn] == held.avatars.tolist() == [0, 1, 2, 3]
    np.testing.assert_allclose([one[1:4] for one in drawn], held.starts, atol=1e-3)
    np.testing.assert_allclose([one[5:8] for one in drawn], held.ends, atol=1e-3)
    assert near(picture(browser), np.array((0, 200, 0)), 60) > 100
    assert browser.console == []


def test_meshes_that_avatars_carry_are_their_triangles_on_near_avatars(browser, workplace, finish) -> None:
    (workplace / "plate.obj").write_text("v 0 0 0\nv 0.6 0 0\nv 0 0.6 0\nv 0.6 0.6 0\nf 1 2 4 3\n", encoding="utf-8")
    plate = {"kind": "mesh", "joint": "head", "file": "plate.obj", "offset": [-0.3, 0.2, 0], "colour": "#00c800"}
    write_scene(workplace / "four.yaml", types={"boxer": {"policy": "tiny", "attachments": [plate]}})
    finish(workplace)
    (workplace / "page.html").write_text(library.open_run(workplace / "run").view(fps=30), encoding="utf-8")
    browser.shown(workplace / "page.html")
    browser.evaluate("crowdsimPlayer.play(false); crowdsimPlayer.seek(1)")
    browser.settle()
    # Owners of rods that are drawn, of all rods, and of meshes.
    shown, rods, meshes = browser.evaluate(
        "(() => { const { crowd } = crowdsimPlayer, rods = [];"
        "for (let i = 0; i < crowd.drawn; i++) if (crowd.shapes[12 * i + 9] > 0.5 && crowd.shapes[12 * i + 8] < 0.01)"
        "rods.push([i, crowd.owners[i]]);"
        "const of = list => [...new Set(list.map(([, avatar]) => avatar))];"
        "return [of(rods.filter(([i]) => i < crowd.visible)), of(rods), crowd.meshes.length && crowd.skinned]; })()"
    )
    assert meshes
    assert set(rods) == {0, 1, 2, 3}
    assert set(shown) == {0, 1, 2, 3} - set(meshes)
    assert browser.evaluate("crowdsimPlayer.crowd.meshes.length") == len(meshes)
    red, green, blue = np.moveaxis(picture(browser).astype(int), -1, 0)
    assert (green > np.maximum(red, blue) + 40).sum() > 500
    browser.press("k")
    browser.settle()
    assert browser.evaluate("crowdsimPlayer.crowd.meshes.length") == 0
    assert browser.console == []


def test_scrubbing_changes_the_picture_and_going_back_brings_it_back(player) -> None:
    first = picture(player)
    player.evaluate(
        "(() => { const s = document.getElementById('scrub'); s.value = 1.5; s.dispatchEvent(new Event('input')); })()"
    )
    second = picture(player)
    assert player.evaluate("crowdsimPlayer.time") == pytest.approx(1.5, abs=0.01)
    assert (np.abs(first - second).max(axis=-1) > 40).sum() > 500
    player.press("Home")
    player.wait("crowdsimPlayer.time === 0")
    assert np.abs(picture(player) - first).max() <= 2


def test_a_click_chooses_the_avatar_under_it_and_says_what_it_does(player, run) -> None:
    opened = library.open_run(run)
    player.evaluate("crowdsimPlayer.seek(2.0)")
    player.settle()
    for avatar in range(4):
        x, y = player.evaluate(
            f"(() => {{ const p = crowdsimPlayer, h = p.crowd.heads.slice({3 * avatar}, {3 * avatar + 3});"
            "return p.view.project(...h).slice(0, 2); })()"
        )
        player.click(x, y)
        seen = player.wait("crowdsimPlayer.selected >= 0 && String(crowdsimPlayer.selected)")
        hidden = player.evaluate(
            f"crowdsimPlayer.view.project(...crowdsimPlayer.crowd.heads.slice(3 * {seen}, 3 * {seen} + 3))[2]"
        )
        own = player.evaluate(
            f"crowdsimPlayer.view.project(...crowdsimPlayer.crowd.heads.slice({3 * avatar}, {3 * avatar + 3}))[2]"
        )
        assert int(seen) == avatar or hidden < own
        player.settle()
        text = player.evaluate("document.getElementById('details').innerText")
        chosen = int(seen)
        assert text.startswith(opened.cast.names[chosen])
        frame = 30
        opponent = int(opened.opponent[frame, chosen])
        assert re.search(rf"opponent\s+{opened.cast.names[opponent]}", text)
        assert re.search(rf"action\s+{int(opened.action[frame, chosen])}\s", text)
        assert re.search(r"health\s+\d+ of 40", text)
        player.press("Escape")
        player.wait("crowdsimPlayer.selected === -1")


def test_dragging_turns_a_camera_and_its_yaml_is_what_render_reads(player, tmp_path) -> None:
    eye = player.evaluate("crowdsimPlayer.view.eye")
    player.drag((600, 300), (720, 340))
    player.wait("crowdsimPlayer.camera.kind === 'free'")
    player.settle()
    moved = player.evaluate("crowdsimPlayer.view.eye")
    assert np.linalg.norm(np.subtract(eye, moved)) > 0.5
    text = player.evaluate("crowdsimPlayer.camera.yaml(crowdsimPlayer.view)")
    (tmp_path / "shot.yaml").write_text(text, encoding="utf-8")
    camera = camera_in_file(f"{tmp_path / 'shot.yaml'}#view")
    assert camera.kind == "fixed"
    assert camera.position == pytest.approx(moved, abs=2e-3)


def test_every_camera_gives_yaml_that_render_reads(player, tmp_path) -> None:
    for choice in range(player.evaluate("crowdsimPlayer.camera.choices.length")):
        player.evaluate(f"crowdsimPlayer.select(2); crowdsimPlayer.chooseCamera({choice})")
        player.settle()
        text = player.evaluate("crowdsimPlayer.camera.yaml(crowdsimPlayer.view)")
        (tmp_path / "shot.yaml").write_text(text, encoding="utf-8")
        (name,) = yaml.safe_load(text)["cameras"]
        camera = camera_in_file(f"{tmp_path / 'shot.yaml'}#{name}")
        kind = player.evaluate("crowdsimPlayer.camera.kind")
        if kind in ("follow", "eye"):
            assert (camera.kind, camera.avatar) == (kind, "blue_0")


def test_keys_step_by_control_frames_and_play(player) -> None:
    for presses, seconds in ((1, 1 / 15), (2, 3 / 15)):
        for _ in range(presses):
            player.press("ArrowRight")
        player.wait(f"Math.abs(crowdsimPlayer.time - {seconds}) < 1e-6")
    player.press("ArrowLeft")
    player.wait(f"Math.abs(crowdsimPlayer.time - {2 / 15}) < 1e-6")
    player.press(" ")
    player.wait("crowdsimPlayer.time > 0.4")
    player.press(" ")
    player.wait("!crowdsimPlayer.playing")


def test_a_recording_that_ends_begins_again_or_stops(player) -> None:
    player.evaluate(
        "document.getElementById('loop').checked = false; crowdsimPlayer.seek(2.5); crowdsimPlayer.play(true)"
    )
    player.wait("!crowdsimPlayer.playing")
    assert player.evaluate("crowdsimPlayer.time === crowdsimPlayer.end")
    player.evaluate(
        "document.getElementById('loop').checked = true; crowdsimPlayer.seek(2.5); crowdsimPlayer.play(true)"
    )
    player.wait("crowdsimPlayer.time < 2")
    player.evaluate("crowdsimPlayer.play(false)")


def test_trails_and_the_map_of_hits_show_on_the_floor(player, run) -> None:
    player.evaluate("crowdsimPlayer.seek(2.6)")
    before = picture(player)
    player.press("h")
    player.wait("crowdsimPlayer.options.hits")
    after = picture(player)
    landed = int(library.open_run(run).events.landed.sum())
    assert landed > 0
    assert player.evaluate("crowdsimPlayer.facts.heat(2.6).count") == landed
    # Warm where it was grey.
    warm = (after[..., 0] - after[..., 2] > 60) & (np.abs(before[..., 0] - before[..., 2]) < 40)
    assert warm.sum() > 200
    player.evaluate("crowdsimPlayer.set('hits', false)")
    player.settle()
    plain = screen(player)
    player.evaluate("crowdsimPlayer.set('trails', true)")
    player.settle()
    assert (np.abs(screen(player) - plain).max(axis=-1)[:500] > 40).sum() > 50


def test_time_stands_still_while_a_block_is_missing(player) -> None:
    player.evaluate(
        "(() => { const { recording } = crowdsimPlayer, real = recording.source.block; recording.blocks.clear();"
        "recording.source.block = number => new Promise(done => {"
        "globalThis.letGo = () => real(number).then(done); }); })();"
        "crowdsimPlayer.seek(1); crowdsimPlayer.play(true)"
    )
    player.wait("crowdsimPlayer.waiting && !!globalThis.letGo")
    before = player.evaluate("crowdsimPlayer.time")
    player.evaluate("new Promise(done => setTimeout(done, 600))")
    assert player.evaluate("crowdsimPlayer.time") == before
    assert "being prepared" in player.evaluate("document.getElementById('clock').textContent")
    player.evaluate("letGo()")
    player.wait(f"crowdsimPlayer.time > {before} + 0.2")
    player.evaluate("crowdsimPlayer.play(false)")


def test_the_camera_follows_an_avatar(player) -> None:
    player.evaluate("crowdsimPlayer.select(3); crowdsimPlayer.chooseCamera(crowdsimPlayer.camera.find('follow'))")
    for seconds in (0.0, 1.0, 2.4):
        player.evaluate(f"crowdsimPlayer.seek({seconds})")
        player.settle()
        x, y, depth = player.evaluate("crowdsimPlayer.view.project(...crowdsimPlayer.crowd.roots.slice(9, 12))")
        assert 200 < x < 1080
        assert 50 < y < 600
        assert 1.5 < depth < 8.0


def test_hostile_names_stay_text(browser, run) -> None:
    opened = library.open_run(run)
    names = np.array([HOSTILE, *opened.cast.names[1:]])
    cast = replace(opened.cast, names=names, team_names=(HOSTILE, "blue"), type_names=(HOSTILE,))
    page = run.parent / "hostile.html"
    page.write_text(replace(opened, cast=cast, scenario=HOSTILE).view(fps=10.0), encoding="utf-8")
    browser.shown(page)
    browser.evaluate("crowdsimPlayer.select(0); crowdsimPlayer.set('labels', true); crowdsimPlayer.play(false)")
    browser.settle()
    assert browser.evaluate("document.title") == HOSTILE
    assert browser.evaluate("document.getElementById('title').textContent") == HOSTILE
    assert browser.evaluate("document.querySelector('#details h2').textContent") == HOSTILE
    assert browser.evaluate("document.querySelector('#teams th[scope], #teams tbody th').textContent") == HOSTILE
    assert browser.evaluate("document.images.length") == 0
    assert browser.console == []
    assert browser.requests == [page.as_uri()]


def test_a_served_page_shows_itself_and_asks_its_server_alone(browser, run) -> None:
    import threading

    import uvicorn

    server = open_server(library.open_run(run).recording())
    running = uvicorn.Server(uvicorn.Config(server.app, log_level="error", lifespan="off"))
    thread = threading.Thread(target=running.run, kwargs={"sockets": [server.socket]}, daemon=True)
    thread.start()
    browser.shown(server.address)
    browser.evaluate("crowdsimPlayer.play(false); crowdsimPlayer.seek(1.6)")
    browser.settle()
    assert browser.console == []
    assert all(request.startswith(server.address) for request in browser.requests)
    assert f"{server.address}block/1" in browser.requests
    # The camera of the fight comes when it is chosen, and is where pictures have it.
    shown = "crowdsimPlayer.camera.choices[crowdsimPlayer.camera.choice].name"
    assert browser.evaluate(shown) == "side"
    browser.evaluate("crowdsimPlayer.chooseCamera(0)")
    browser.wait(f"{shown} === 'auto'")
    browser.settle()
    opened = library.open_run(run)
    view = build_track(TakeSource(opened, opened.policies, 60.0), "auto", (1280, 720)).view(96.0)
    np.testing.assert_allclose(browser.evaluate("[...crowdsimPlayer.view.eye]"), view.eye, atol=0.01)
    assert browser.console == []
    running.should_exit = True
    thread.join(60)
    browser.evaluate("crowdsimPlayer.recording.blocks.clear(); crowdsimPlayer.seek(0.2)")
    browser.wait("!document.getElementById('message').hidden")
    assert browser.evaluate("document.getElementById('message').textContent").startswith("The connection is lost")


def test_a_page_with_reasons_shows_why_an_avatar_does_what_it_does(browser, run) -> None:
    page = run.parent / "reasons.html"
    assert crowdsim("view", run, "--html", page, "--why", "red_1", "-q") == 0
    browser.shown(page)
    browser.evaluate("crowdsimPlayer.play(false); crowdsimPlayer.seek(2); crowdsimPlayer.select(0)")
    browser.settle()
    assert browser.evaluate("document.getElementById('reasons').hidden")
    browser.evaluate("crowdsimPlayer.select(1); document.getElementById('why').open = true")
    browser.wait("!!document.querySelector('#why-text .taken')")
    opened = library.open_run(run)
    action = int(opened.action[30, 1])
    assert browser.evaluate("document.querySelector('#why-text .taken').title").startswith(f"action {action},")
    assert browser.console == []
    # Of an opponent that the page does not hold it says so.
    assert crowdsim("view", run, "--html", page, "--why", "red_1", "--avatars", "red_1", "--force", "-q") == 0
    browser.shown(page)
    browser.evaluate("crowdsimPlayer.play(false); crowdsimPlayer.seek(2); crowdsimPlayer.select(0)")
    browser.evaluate("document.getElementById('why').open = true")
    browser.wait("!!document.querySelector('#why-text .taken')")
    assert "about an avatar that is not in this recording" in browser.evaluate(
        "document.querySelector('#why-text p').textContent"
    )


def test_values_lie_at_their_bearings_also_where_the_last_step_is_shorter(player) -> None:
    bearings = (np.arange(0, 100, 3) * 2 * np.pi / 100 - np.pi).round(5)
    ring = np.random.default_rng(3).permutation(len(bearings)) / (len(bearings) - 1)
    found = {"at": [0, 0, 0.4], "distances": [0.5, 3.0], "bearings": bearings.tolist(), "values": [*ring, *ring]}
    player.evaluate(f"crowdsimPlayer.values = {{ find: () => ({json.dumps(found)}) }}")
    player.evaluate("crowdsimPlayer.select(0); crowdsimPlayer.set('valued', true)")
    player.settle()
    shown = np.array(player.evaluate("[...crowdsimPlayer.painter.heat.bytes]"))
    places = (np.arange(256) + 0.5) * 6 / 256 - 3
    turns = np.arctan2(places[None, :], places[:, None]) - 0.4
    expected = 255 * np.interp(turns.ravel(), bearings, ring, period=2 * np.pi)
    np.testing.assert_allclose(shown, expected, atol=1)


def test_obstacles_are_shown_and_doors_vanish_while_they_are_open(browser, workplace) -> None:
    doors = [{"at": 2, "width": 1.5, "opens": 1}]
    wall = {"kind": "wall", "points": [[-2, 3], [2, 3]], "height": 2, "doors": doors}
    opened = library.run(library.load_scenario(scene(obstacles=[wall])))
    page = workplace / "walls.html"
    page.write_text(opened.view(fps=15.0), encoding="utf-8")
    browser.shown(page)
    browser.evaluate("crowdsimPlayer.play(false); crowdsimPlayer.seek(0.5)")
    closed = picture(browser)
    count = browser.evaluate("crowdsimPlayer.crowd.drawn")
    browser.evaluate("crowdsimPlayer.seek(1.5)")
    picture(browser)
    assert browser.evaluate("crowdsimPlayer.crowd.drawn") == count - 12
    browser.evaluate("crowdsimPlayer.crowd.obstacles.length = 0; crowdsimPlayer.seek(0.5)")
    without = picture(browser)
    assert (np.abs(closed - without).max(axis=-1) > 30).sum() > 300
    assert browser.console == []


def test_a_report_shows_its_player(browser, run) -> None:
    assert crowdsim("report", run, "-q") == 0
    browser.open(run / "report.html")
    browser.wait("document.querySelector('iframe')?.contentDocument?.documentElement?.dataset.state === 'shown'")
    browser.wait("document.querySelector('iframe').contentWindow.crowdsimPlayer?.time > 0.3")
    assert (
        browser.evaluate("document.querySelector('iframe').contentDocument.getElementById('title').textContent")
        == "four"
    )
    assert browser.console == []
    # Pictures are in the page itself.
    assert browser.evaluate("[...document.images].every(one => one.naturalWidth === 352)")
    asked = [one for one in browser.requests if one != "about:srcdoc" and not one.startswith("data:")]
    assert asked == [(run / "report.html").as_uri()]


def test_a_page_that_was_cut_off_says_so(browser, page) -> None:
    text = page.read_text(encoding="utf-8")
    page.write_text(text[: text.index('<script type="text/plain"')], encoding="utf-8")
    browser.open(page)
    browser.wait("document.getElementById('message') && !document.getElementById('message').hidden")
    assert "part of its recording is missing" in browser.evaluate("document.getElementById('message').textContent")


def test_without_webgl_a_line_says_so(browser, page) -> None:
    script = "HTMLCanvasElement.prototype.getContext = () => null"
    added = browser.call("Page.addScriptToEvaluateOnNewDocument", source=script)["identifier"]
    try:
        browser.open(page)
        browser.wait("document.documentElement?.dataset.state === 'failed'")
        assert browser.evaluate("document.getElementById('message').textContent").startswith(
            "This browser has no WebGL 2"
        )
    finally:
        browser.call("Page.removeScriptToEvaluateOnNewDocument", identifier=added)
