"""Progress bars: a line a stage, whatever stages guess of their end."""

from crowdsim.commands.progress import Bars


def shown(text: str) -> list[str]:
    """Last state of every line."""
    return [line.rsplit("\r", 1)[-1] for line in text.split("\n") if line.strip()]


def test_a_stage_that_goes_beyond_its_guessed_end_has_one_line(capsys) -> None:
    with Bars() as bars:
        for done, total in ((1, 74), (70, 74), (74, 74), (75, 75), (76, 76)):
            bars("sweeps", done, total)
        bars("table", 1, 1)
    lines = shown(capsys.readouterr().err)
    assert [line.split("[")[0].split("|")[-1].strip() for line in lines] == ["74/74", "1/1"]
    assert [line.split(":")[0] for line in lines] == ["sweeps", "table"]


def test_a_stage_that_ends_early_says_how_far_it_came(capsys) -> None:
    with Bars() as bars:
        bars("sweeps", 1, 74)
        bars("sweeps", 60, 74)
        bars("table", 1, 1)
    assert "60/74" in shown(capsys.readouterr().err)[0]


def test_a_stage_that_comes_again_has_a_line_again(capsys) -> None:
    with Bars() as bars:
        for _ in range(2):
            bars("frames", 1, 2)
            bars("frames", 2, 2)
    assert len(shown(capsys.readouterr().err)) == 2
