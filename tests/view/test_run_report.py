"""A report says what a run's figures mean, shows the run, and how to repeat it; whatever things are called."""

import base64
import html
import io
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from naive_view import embedded, unpack_scene
from PIL import Image
from scenes import crowdsim, write_scene

import crowdsim as library
from crowdsim.errors import TakeError
from crowdsim.play.session import Session
from crowdsim.preparation.prepare import load_policies
from crowdsim.render.look import Look
from crowdsim.render.stage import build_stage
from crowdsim.render.take_source import TakeSource
from crowdsim.runs.exports import choose_report
from crowdsim.scenario.scenario import load_scenario
from crowdsim.take.quality import measure_take
from crowdsim.view.report import THUMBNAILS, report_parts, verdicts
from crowdsim.view.report_plots import mean_health, opponent_distances

HURT = {"boxer": {"policy": "tiny", "damage": {"health": 30}}}
HOSTILE = "</pre></script><script>document.title='owned'</script>\"'"


def player_of(page: str) -> str:
    """The page of the player that is in a report."""
    return html.unescape(re.search(r'<iframe title="[^"]*" srcdoc="([^"]*)"', page)[1])


@pytest.fixture(autouse=True)
def plain_camera(monkeypatch):
    """The camera that suits a crowd, which is planned at once; what films a fight poses every strike beforehand."""
    monkeypatch.setattr("crowdsim.render.cameras.auto._FIGHT", range(0))


@pytest.fixture
def run(workplace, finish):
    write_scene(workplace / "four.yaml", duration=150)
    finish(workplace)
    return workplace / "run"


@pytest.fixture(scope="module")
def runs():
    return {}


@pytest.fixture
def finished(runs, workplace, finish, tmp_path_factory):
    """A copy of a run of avatars that can be hurt, which is made once."""
    if "run" not in runs:
        heal = {"kind": "heal", "when": {"kind": "frame", "frame": 9}}
        write_scene(workplace / "four.yaml", duration=20, types=HURT, events=[heal])
        finish(workplace)
        runs["run"] = tmp_path_factory.mktemp("finished") / "run"
        shutil.copytree(workplace / "run", runs["run"])
    return Path(shutil.copytree(runs["run"], workplace / "odd"))


def test_a_report_has_summary_verdicts_player_scenario_and_how_to_repeat_it(run, capsys) -> None:
    assert crowdsim("report", run) == 0
    assert re.search(r"report\.html: [\d.]+ [kM]B", capsys.readouterr().out)
    page = (run / "report.html").read_text(encoding="utf-8")
    opened = library.open_run(run)
    text = html.unescape(re.sub(r"<[^>]+>", " ", page.replace(player_of(page), "")))
    assert f"{len(opened.events.frame)}" in text
    assert "seed 5" in text
    assert "How it looks" in text
    assert "crowdsim run scenario.yaml" in text
    assert f"policy tiny: {opened.fingerprints[0]}" in text
    found, blocks = embedded(player_of(page))
    assert found["frames"] == opened.output_frames(opened.fps)
    assert blocks
    assert not re.search(r"https?://", page)
    # The scenario in it is the run's.
    shown = html.unescape(re.findall(r"<pre>(.*?)</pre>", page, re.DOTALL)[-1])
    assert yaml.safe_load(shown) == yaml.safe_load((run / "scenario.resolved.yaml").read_text(encoding="utf-8"))
    assert crowdsim("verify", run) == 0


def test_pictures_show_moments_spread_over_the_run(run) -> None:
    assert crowdsim("report", run, "--no-player", "-q") == 0
    page = (run / "report.html").read_text(encoding="utf-8")
    found = re.findall(r'<img src="data:image/jpeg;base64,([^"]*)" alt="The run after ([\d.]+) s">\2 s<', page)
    times = np.array([float(seconds) for _, seconds in found])
    np.testing.assert_allclose(np.diff(times), 10 / THUMBNAILS, atol=0.35)
    assert len(found) == THUMBNAILS
    opened = library.open_run(run)
    source = TakeSource(opened, opened.policies, 3.2, arena=opened.arena)
    stage = build_stage(source, (352, 198), look=Look(caption=False))
    for data, seconds in found:
        shown = np.asarray(Image.open(io.BytesIO(base64.b64decode(data))), float)
        drawn = stage.picture(round(float(seconds) * 3.2))
        assert np.abs(shown - drawn).mean() < 4


def test_plots_show_strikes_health_and_distances(workplace, finish) -> None:
    heal = {"kind": "heal", "when": {"kind": "frame", "frame": 90}, "group": "red"}
    write_scene(workplace / "four.yaml", duration=150, types=HURT, events=[heal])
    finish(workplace)
    run = library.open_run(workplace / "run")
    assert crowdsim("report", workplace / "run", "--no-player", "-q") == 0
    page = (workplace / "run" / "report.html").read_text(encoding="utf-8")
    said = [html.unescape(one) for one in re.findall(r'role="img" aria-label="([^"]*)"', page)]
    outcomes = run.strikes()["outcome"]
    landed, blocked = (int((outcomes == name).sum()) for name in ("landed", "blocked"))
    assert said[0] == f"{landed} strikes landed, {blocked} were blocked, {len(outcomes) - landed - blocked} missed"
    assert len(re.findall(r'<rect class="landed"', page)) > 1
    # Health by a count of its own.
    left = dict.fromkeys(range(4), 30.0)
    health = {name: [] for name in ("red", "blue")}
    order = np.argsort(run.events.frame, kind="stable")
    for frame in (60, 89.5, 149.9):
        left = dict.fromkeys(range(4), 30.0)
        for k in order:
            at, victim = float(run.events.frame[k]), int(run.events.victim[k])
            if victim < 0 or at > frame or (frame > 89 and at <= 89 and victim < 2):
                continue
            left[victim] = max(left[victim] - float(run.events.damage[k]), 0.0)
        health["red"].append((left[0] + left[1]) / 60)
        health["blue"].append((left[2] + left[3]) / 60)
    found = mean_health(run, np.full(4, 30.0), run.heals, np.array([60, 89.5, 149.9]) / 15.0)
    for name, values in health.items():
        np.testing.assert_allclose(found[name], values, atol=1e-6)
    assert min(health["red"][0], health["blue"][0]) < 1
    assert said[1].startswith(f"red has {100 * health['red'][-1]:.0f} % left at the end; blue has ")
    gaps, times = opponent_distances(run)
    frame = round(times[-1] * 15)
    other = int(run.opponent[frame, 0])
    apart = np.hypot(run.x[frame, 0] - run.x[frame, other], run.z[frame, 0] - run.z[frame, other])
    assert gaps[-1, 0] == pytest.approx(float(apart), nan_ok=True) or other < 0
    assert said[2].startswith("The median distance is ")
    assert crowdsim("verify", workplace / "run") == 0


def test_health_is_whole_where_avatars_come_back_and_not_where_they_are_put_elsewhere(workplace) -> None:
    def event(kind, frame, **more):
        return {"kind": kind, "when": {"kind": "frame", "frame": frame}, "group": "red", **more}

    events = [event("place", 110, member=1, point=[4, 4]), event("remove", 120), event("add", 140)]
    types = {"boxer": {"policy": "tiny", "damage": {"health": 1000}}}
    scenario = load_scenario(write_scene(workplace / "four.yaml", duration=160, types=types, events=events))
    known, session = [], Session(scenario, load_policies(scenario))
    for _ in range(160):
        session.step()
        known.append(session.health()[0])
    run = library.run(scenario)
    frames = np.array([100, 112, 118, 141, 150, 159])
    expected = np.array(known)[frames] / 1000
    assert (expected[2, :2] < 1).all()
    assert (expected[3, :2] == 1).all()
    for name, own in (("red", slice(2)), ("blue", slice(2, 4))):
        found = mean_health(run, np.full(4, 1000.0), run.heals, frames / 15.0)[name]
        np.testing.assert_allclose(found, expected[:, own].mean(axis=1), atol=1e-6)
    tables = unpack_scene(run.recording().scene())["tables"]
    assert tables["heal_avatar"].tolist() == [0, 1]
    np.testing.assert_allclose(tables["heal_time"], 139 / 15, atol=1e-3)
    late = unpack_scene(run.recording(frames="600:").scene())["tables"]["health"].reshape(-1, 2)[:, 1]
    np.testing.assert_allclose(late[:2], np.array(known)[150, :2], atol=1e-3)


def test_teams_and_avatars_have_their_strikes(run) -> None:
    assert crowdsim("report", run, "--no-player", "-q") == 0
    page = (run / "report.html").read_text(encoding="utf-8")
    assert "<iframe" not in page
    opened = library.open_run(run)
    strikes = opened.strikes()
    of_red = np.isin(strikes["attacker"], [0, 1])
    row = [2, of_red.sum(), (of_red & strikes["landed"]).sum()]
    cells = "".join(f'<td class="number">{value:,}</td>' for value in row)
    assert f"<td>red</td>{cells}" in page


def test_a_run_writes_the_report_that_the_command_writes(workplace) -> None:
    report = {"fps": 30, "avatars": ["red", 3], "frames": "0:60"}
    write_scene(workplace / "four.yaml", duration=60, outputs={"report": report})
    assert crowdsim("run", "four.yaml", "--out", "run", "-q") == 0
    written = (workplace / "run" / "report.html").read_bytes()
    words = ["--avatars", "red,blue_1", "--frames", "0:60", "--fps", "30"]
    assert crowdsim("report", "run", "--out", "other", "--threads", "1", *words, "-q") == 0
    assert (workplace / "other" / "report.html").read_bytes() == written
    assert embedded(player_of(written.decode()))[0]["names"] == ["red_0", "red_1", "blue_1"]
    assert crowdsim("verify", "run") == 0


def test_a_report_leaves_pictures_in_a_folder_of_its_name(run) -> None:
    assert crowdsim("render", run, "--png", "--frames", "0:1", "--size", "160x90", "--out", run / "report") == 0
    pictures = sorted((run / "report").rglob("*.png"))
    assert pictures
    assert crowdsim("report", run, "--no-player") == 0
    assert (run / "report.html").is_file()
    assert sorted((run / "report").rglob("*.png")) == pictures


def test_a_take_without_frames_has_no_report(run) -> None:
    with pytest.raises(TakeError, match="'four': has no control frames"):
        choose_report(replace(library.open_run(run), action=np.zeros((0, 4))), 30.0, None, None, False)


def test_avatars_that_there_are_not_are_reported_where_the_scenario_names_them(workplace, capsys) -> None:
    path = write_scene(workplace / "four.yaml", outputs={"report": {"avatars": [9]}})
    assert crowdsim("validate", path) == 2
    assert "outputs.report.avatars[0]: is 9, expected an avatar from 0 to 3" in capsys.readouterr().err


def test_what_is_of_the_player_needs_it(run, workplace, capsys) -> None:
    assert crowdsim("report", run, "--no-player", "--fps", "12") == 2
    assert "are of the player" in capsys.readouterr().err
    write_scene(workplace / "bare.yaml", outputs={"report": {"player": False, "avatars": [0]}})
    assert crowdsim("validate", "bare.yaml") == 2
    assert "is of the player" in capsys.readouterr().err


def test_a_report_that_no_browser_could_load_is_refused_before_the_run(workplace, capsys) -> None:
    write_scene(workplace / "large.yaml", duration=200_000, outputs={"report": {"fps": 240}})
    assert crowdsim("validate", "large.yaml") == 2
    assert "expected 0.6 at most" in capsys.readouterr().err


def test_another_file_is_not_replaced(run, tmp_path, capsys) -> None:
    out = tmp_path / "mine"
    out.mkdir()
    (out / "report.html").write_text("mine", encoding="utf-8")
    assert crowdsim("report", run, "--out", out, "--no-player", "--force", "-q") == 2
    assert "report.html" in capsys.readouterr().err
    assert (out / "report.html").read_text(encoding="utf-8") == "mine"


def test_a_report_that_is_there_is_not_written_again(run) -> None:
    assert crowdsim("report", run, "--no-player", "-q") == 0
    before = (run / "report.html").stat().st_mtime_ns
    assert crowdsim("report", run, "--no-player", "-q") == 0
    assert (run / "report.html").stat().st_mtime_ns == before
    assert crowdsim("report", run, "--no-player", "--force", "-q") == 0
    assert (run / "report.html").stat().st_mtime_ns > before


def test_an_archive_has_its_report_beside_it(run) -> None:
    assert crowdsim("pack", run, "-o", run.parent / "packed.zip", "-q") == 0
    assert crowdsim("report", run.parent / "packed.zip", "--no-player", "-q") == 0
    assert crowdsim("report", run, "--no-player", "-q") == 0
    assert (run.parent / "packed" / "report.html").read_bytes() == (run / "report.html").read_bytes()


def test_a_run_without_its_scenario_has_no_report(run, capsys) -> None:
    (run / "scenario.resolved.yaml").unlink()
    assert crowdsim("report", run, "-q") == 2
    assert "scenario.resolved.yaml: cannot be read, and the report shows it" in capsys.readouterr().err


@pytest.mark.parametrize(
    "odd",
    [
        "types: {red: {damage: 3}}", "types: [1]", "types: {boxer: {damage: {health: x}}}",
        "types: {boxer: {damage: {health: .nan}}}", "types: {boxer: {damage: {health: -3}}}",
        f"types: {{boxer: {{damage: {{health: {'9' * 400}}}}}}}", "groups: 7", "groups: [{name: x, count: .inf}]",
        "events: {a: 1}", "events: [{kind: heal, when: {kind: seconds, seconds: .inf}}]",
        "events: [{kind: heal, member: 1.5, when: {kind: frame, frame: 3}}]", "cameras: 3", 'name: "',
        "obstacles: !!timestamp xx", 'arena: !!float ""', f"arena: 1{':1' * 400}.5",
    ],
)  # fmt: skip
def test_a_report_leaves_out_what_an_odd_scenario_does_not_say(finished, odd) -> None:
    path = finished / "scenario.resolved.yaml"
    before, key = path.read_text(encoding="utf-8"), odd.partition(":")[0]
    others = [part for part in re.split(r"(?m)^(?=\w+:)", before) if not part.startswith(f"{key}:")]
    path.write_text("".join([*others, f"{odd}\n"]), encoding="utf-8")
    assert crowdsim("report", finished, "-q") == 0
    opened = library.open_run(finished)
    assert opened.health == {}
    assert opened.notes[0].endswith("; arena, obstacles, cameras and health of the run are not shown")
    page = (finished / "report.html").read_text(encoding="utf-8")
    assert "Health left" not in page
    assert embedded(player_of(page))[0]["frames"] > 0


def test_hostile_names_stay_text(run) -> None:
    opened = library.open_run(run)
    cast = replace(
        opened.cast, names=np.array([HOSTILE, *opened.cast.names[1:]]), team_names=(HOSTILE, "blue"),
        policy_names=(HOSTILE,),
    )  # fmt: skip
    hostile = replace(opened, cast=cast, scenario=HOSTILE)
    hostile.__dict__["sampler"] = opened.sampler
    page = b"".join(report_parts(hostile, None, f"name: {HOSTILE}")).decode()
    assert "owned" in page
    assert "<script" not in page
    assert page.count("<pre>") == page.count("</pre>") == 2


def figures(**changes):
    found = dict.fromkeys(
        ("first_landed_seconds", "air_share", "stuck_share", "out_of_reach_share", "turned_away_share",
         "overlap_share", "penetration_share", "fists_off_share", "foot_slide_median", "foot_slide_median_captured",
         "transition_jump_ratio")
    )  # fmt: skip
    return {**found, "strikes_thrown": 10, **changes}


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"first_landed_seconds": 2.0}, (True, "The first strike lands after 2.0 s")),
        ({"first_landed_seconds": 9.0}, (False, "The first strike lands after 9.0 s; at most 8.0 s looks right")),
        ({"first_landed_seconds": 1.0, "air_share": 0.2},
         (False, "20.0 % of strikes are thrown at opponents beyond their reach; at most 5.0 % looks right")),
        ({"first_landed_seconds": 1.0, "stuck_share": 0.0},
         (True, "No avatar stays out of reach of its opponent for more than 10 s")),
        ({"first_landed_seconds": 1.0, "foot_slide_median": 0.04, "foot_slide_median_captured": 0.02},
         (False, "Planted feet slide 2.00 times the capture's; at most 1.5 times looks right")),
        ({"first_landed_seconds": 1.0, "transition_jump_ratio": 1.2},
         (True, "Joints accelerate 1.20 times the capture's around transitions")),
    ],
)  # fmt: skip
def test_a_verdict_says_what_a_figure_is_and_what_looks_right(changes, expected) -> None:
    assert expected in verdicts(figures(**changes))


def test_nothing_is_said_of_what_was_not_measured() -> None:
    assert verdicts(figures(strikes_thrown=0)) == []
    assert verdicts(figures()) == [(False, "No strike lands")]


def test_all_figures_that_verdicts_look_at_are_measured(run) -> None:
    measured = measure_take(library.open_run(run).sampler)
    assert set(figures()) <= set(measured)
