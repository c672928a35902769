"""A disk that fails at every other operation of an extension and of a training, on a test process of its own."""

from pathlib import Path

import pytest
from test_faults import check_failing, make_scene


@pytest.mark.slow
@pytest.mark.parametrize("name", ["extend", "train"])
def test_a_failing_disk_is_a_clear_error_and_the_command_can_be_completed(
    workplace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    check_failing(make_scene(workplace, True), name, 2, monkeypatch, capsys)
