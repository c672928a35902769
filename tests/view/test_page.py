"""The page of the player: complete, closed to the world, and harmless whatever things are called."""

import html
import re
from dataclasses import replace

import numpy as np
import pytest
from naive_view import embedded
from scenes import crowdsim, write_scene

import crowdsim as library
from crowdsim.view.page import GENERATOR, Page, is_page, page_head

HOSTILE = "</script><script>document.title='owned'</script>"


@pytest.fixture
def run(workplace, finish):
    write_scene(workplace / "four.yaml")
    finish(workplace)
    return workplace / "run"


def test_a_page_holds_the_whole_recording_and_asks_nobody(run, capsys) -> None:
    page = run.parent / "page.html"
    assert crowdsim("view", run, "--html", page, "--fps", "30") == 0
    assert re.fullmatch(rf"{re.escape(str(page))}: [\d.]+ kB\n", capsys.readouterr().out)
    text = page.read_text(encoding="utf-8")
    scene, blocks = embedded(text)
    assert scene["frames"] == 80
    assert len(blocks) == 1
    assert scene["names"] == ["red_0", "red_1", "blue_0", "blue_1"]
    assert not re.search(r"https?://|//[a-z]+\.|@import|url\(", text)
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)[1]
    assert "default-src 'none'" in policy
    assert "connect-src 'none'" in policy
    assert "unsafe" not in policy
    # A page is what Python returns, too.
    assert library.open_run(run).view(fps=30.0) == text


def test_avatars_and_frames_are_chosen_as_in_exports(run) -> None:
    page = run.parent / "page.html"
    assert crowdsim("view", run, "--html", page, "--avatars", "red,blue_1", "--frames", "1s:2s", "-q") == 0
    scene, _ = embedded(page.read_text(encoding="utf-8"))
    assert scene["names"] == ["red_0", "red_1", "blue_1"]
    assert (scene["fps"], scene["first"], scene["frames"]) == (60, 60, 60)


def test_an_archive_is_opened_as_a_run(run) -> None:
    assert crowdsim("pack", run, "-o", run.parent / "run.zip", "-q") == 0
    pages = [run.parent / name for name in ("a.html", "b.html")]
    for thing, page in zip((run, run.parent / "run.zip"), pages, strict=True):
        assert crowdsim("view", thing, "--html", page, "--frames", ":10", "-q") == 0
    assert pages[0].read_bytes() == pages[1].read_bytes()


def test_the_same_run_gives_the_same_page_for_any_number_of_threads(run) -> None:
    opened = library.open_run(run)
    assert opened.view(threads=1) == opened.view(threads=2)


def test_a_page_is_replaced_with_force_only_and_another_file_never(run, capsys) -> None:
    page = run.parent / "page.html"
    assert crowdsim("view", run, "--html", page, "--frames", ":10", "-q") == 0
    before = page.read_bytes()
    assert crowdsim("view", run, "--html", page, "--frames", ":20", "-q") == 2
    assert capsys.readouterr().err == f"{page}: is there already; --force replaces it\n"
    assert page.read_bytes() == before
    assert crowdsim("view", run, "--html", page, "--frames", ":20", "--force", "-q") == 0
    assert page.read_bytes() != before
    page.write_text("<!doctype html><title>mine</title>", encoding="utf-8")
    assert crowdsim("view", run, "--html", page, "--force", "-q") == 2
    assert capsys.readouterr().err == f"{page}: is there already and no page of crowdsim view, expected another name\n"
    assert "mine" in page.read_text(encoding="utf-8")
    page.unlink()
    page.symlink_to(run.parent / "four.yaml")
    assert crowdsim("view", run, "--html", page, "--force", "-q") == 2
    assert [path.name for path in run.parent.glob(".*.part")] == []


def test_options_that_have_no_effect_are_refused(run, capsys) -> None:
    page = run.parent / "page.html"
    assert crowdsim("view", run, "--html", page, "--port", "8000") == 2
    assert capsys.readouterr().err == "--port has no effect on --html, expected one of them\n"
    assert crowdsim("view", run, "--force") == 2
    assert capsys.readouterr().err == "--force has no effect without --html\n"
    assert not page.exists()


def test_a_page_is_written_also_where_no_browser_is_to_be_opened(run) -> None:
    page = run.parent / "page.html"
    assert crowdsim("view", run, "--html", page, "--no-open", "--frames", ":5", "-q") == 0
    assert is_page(page)


def test_what_is_no_run_is_refused(workplace, capsys) -> None:
    assert crowdsim("view", workplace / "nothing", "--html", workplace / "page.html") == 2
    assert str(workplace / "nothing") in capsys.readouterr().err
    assert not (workplace / "page.html").exists()


def test_hostile_names_stay_text(run) -> None:
    opened = library.open_run(run)
    names = np.array([HOSTILE, *opened.cast.names[1:]])
    cast = replace(opened.cast, names=names, team_names=(HOSTILE, "blue"), type_names=(HOSTILE,))
    page = replace(opened, cast=cast, scenario=HOSTILE).view(fps=10.0)
    assert embedded(page)[0]["names"][0] == HOSTILE
    # Nothing but the program is a script that runs, and the title alone has the name, escaped.
    assert re.findall(r"<script[^>]*>", page) == [
        '<script type="application/json" id="source">', "<script>", '<script type="text/plain" id="block-0">',
    ]  # fmt: skip
    assert "owned'</script>" not in page
    assert html.escape(HOSTILE) in page_head(HOSTILE)


def test_a_page_begins_with_what_it_is_known_by() -> None:
    assert GENERATOR in page_head("x" * 200).encode()[:4096]


def test_notebooks_show_a_page_in_a_frame_of_its_own() -> None:
    shown = Page("<p title=\"a\">'b' & c</p>")._repr_html_()
    assert html.unescape(re.search(r'srcdoc="([^"]*)"', shown)[1]) == "<p title=\"a\">'b' & c</p>"
