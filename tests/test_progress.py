"""Progress: bars on a terminal, elsewhere one line of plain text a stage."""

import re
import sys

import pytest

from crowdsim.commands import common
from crowdsim.commands.progress import Bars


@pytest.fixture(autouse=True)
def talks(monkeypatch):
    """Let commands talk, whatever the one before was told."""
    monkeypatch.setattr(common.talk, "quiet", False)


@pytest.fixture
def terminal(monkeypatch, capsys):
    """Make standard error a terminal, and return what ends up on it: the last state of every line."""
    monkeypatch.setattr(type(sys.stderr), "isatty", lambda stream: True, raising=False)

    def shown() -> list[str]:
        text = capsys.readouterr().err
        assert "\r" in text
        return [line.rsplit("\r", 1)[-1] for line in text.split("\n") if line.strip()]

    return shown


def lines(text: str) -> list[str]:
    """Lines that are plain text, with their times made equal."""
    assert not set(text) & set("\r\x1b\u2588")
    return [re.sub(r"\d+\.\d s$", "T", line) for line in text.splitlines()]


def test_a_stage_that_goes_beyond_its_guessed_end_has_one_line(terminal) -> None:
    with Bars() as bars:
        for done, total in ((1, 74), (70, 74), (74, 74), (75, 75), (76, 76)):
            bars("sweeps", done, total)
        bars("table", 1, 1)
    result = terminal()
    assert [line.split("[")[0].split("|")[-1].strip() for line in result] == ["74/74", "1/1"]
    assert [line.split(":")[0] for line in result] == ["sweeps", "table"]


def test_a_stage_that_ends_early_reports_its_progress(terminal) -> None:
    with Bars() as bars:
        bars("sweeps", 1, 74)
        bars("sweeps", 60, 74)
        bars("table", 1, 1)
    assert "60/74" in terminal()[0]


def test_a_stage_that_comes_again_has_a_line_again(terminal) -> None:
    with Bars() as bars:
        for _ in range(2):
            bars("frames", 1, 2)
            bars("frames", 2, 2)
    assert len(terminal()) == 2


def test_without_a_terminal_a_stage_is_one_plain_line(capsys) -> None:
    with Bars() as bars:
        for done in range(1, 1001):
            bars("control", done, 1000)
        bars("sweeps", 60, 74)
        bars.note("a note")
        bars("table", 1, 1)
    result = capsys.readouterr()
    assert lines(result.err) == ["control: 1,000 of 1,000, T", "a note", "sweeps: 60 of 74, T", "table: T"]
    assert result.out == ""


def test_quiet_progress_prints_nothing(capsys, monkeypatch) -> None:
    monkeypatch.setattr(common.talk, "quiet", True)
    with Bars() as bars:
        bars("control", 1, 1)
        bars.note("a note")
    assert capsys.readouterr() == ("", "")
