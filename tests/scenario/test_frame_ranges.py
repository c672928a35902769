"""Ranges of frames as users write them."""

import pytest

from crowdsim.errors import TakeError
from crowdsim.scenario.frame_ranges import FrameRange, output_frames, parse_frames, parse_length


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (":", (0, 100)),
        ("0:5", (0, 5)),
        (":5", (0, 5)),
        ("5:", (5, 100)),
        (" 3 : 4 ", (3, 4)),
        ("0.5s:1s", (30, 60)),
        ("0.51s:1.01s", (31, 61)),
        ("10:1s", (10, 60)),
        ("1s:70", (60, 70)),
        (": 0.1 s", (0, 6)),
        ("1.5s:", (90, 100)),
        ("0s:1.666s", (0, 100)),
    ],
)
def test_a_range_is_half_open_in_frames_or_seconds(text: str, expected: tuple[int, int]) -> None:
    assert parse_frames(text).resolve(100, 60.0) == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("5", "expected A:B, half-open, in frames or seconds, such as 0:120, 2s:5s or 100:"),
        ("a:b", "expected A:B, half-open, in frames or seconds, such as 0:120, 2s:5s or 100:"),
        ("-1:4", "expected A:B, half-open, in frames or seconds, such as 0:120, 2s:5s or 100:"),
        ("1:2:3", "expected A:B, half-open, in frames or seconds, such as 0:120, 2s:5s or 100:"),
        ("1m:2m", "expected A:B, half-open, in frames or seconds, such as 0:120, 2s:5s or 100:"),
        ("0.5:2", "0.5 is no whole number, expected frames, or seconds as in 0.5s"),
        ("5:5", "is empty, expected the first frame before the last"),
        ("2s:1s", "is empty, expected the first frame before the last"),
        ("70:1s", "is empty, expected the first frame before the last"),
        ("90:101", "there are frames 0 to 99 at 60 fps, 1.66667 s"),
        ("100:", "there are frames 0 to 99 at 60 fps, 1.66667 s"),
        ("1s:1.8s", "there are frames 0 to 99 at 60 fps, 1.66667 s"),
    ],
)
def test_another_range_is_refused(text: str, message: str) -> None:
    with pytest.raises(TakeError) as caught:
        parse_frames(text).resolve(100, 60.0)
    assert str(caught.value) == f"frames {text!r}: {message}"


def test_a_length_is_frames_or_seconds() -> None:
    assert parse_length("300") == (300, False)
    assert parse_length("20s") == (20, True)
    assert parse_length("2.5 s") == (2.5, True)
    for text in ("0", "0s", "1.5", "-3", "s", "2m"):
        with pytest.raises(TakeError, match="expected a whole number of frames from 1, or seconds as in 20s"):
            parse_length(text)


def test_a_run_lasts_until_its_last_control_frame_ends() -> None:
    assert output_frames(75, 15.0, 60.0) == 300
    assert output_frames(150, 15.0, 24.0) == 240
    assert output_frames(150, 15.0, 24000 / 1001) == 240
    assert output_frames(1, 15.0, 1.0) == output_frames(1, 15.0, 15.0) == 1
    assert FrameRange(0, 5, True, True).resolve(300, 60.0) == (0, 300)
