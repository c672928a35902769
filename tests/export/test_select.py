"""What users write to choose avatars and frames."""

import pytest

from crowdsim.errors import TakeError
from crowdsim.export.select import parse_avatars, parse_range


@pytest.mark.parametrize(
    ("text", "numbers"),
    [(None, None), ("0", [0]), ("0-3", [0, 1, 2, 3]), ("7,1 , 3-4,3", [1, 3, 4, 7]), ("9-9", [9])],
)
def test_avatars_are_numbers_and_ranges(text: str | None, numbers: list[int] | None) -> None:
    assert parse_avatars(text, 10) == numbers


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "avatars '': '' is no number or range, expected 0-9 or 0,3,5-7"),
        ("1;2", "avatars '1;2': '1;2' is no number or range, expected 0-9 or 0,3,5-7"),
        ("-1", "avatars '-1': '-1' is no number or range, expected 0-9 or 0,3,5-7"),
        ("5-2", "avatars '5-2': '5-2' runs backwards, expected 2-5"),
        ("3,10", "avatars '3,10': there is no avatar 10, the take has 0 to 9"),
    ],
)
def test_other_avatars_are_refused(text: str, message: str) -> None:
    with pytest.raises(TakeError) as caught:
        parse_avatars(text, 10)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("text", "expected"), [(None, None), ("0:5", (0, 5)), (":5", (0, 5)), ("5:", (5, 100)), (" 3 : 4 ", (3, 4))]
)
def test_frames_are_half_open(text: str | None, expected: tuple[int, int] | None) -> None:
    assert parse_range(text, 100, 60.0) == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("5", "frames '5': expected A:B, half-open, such as 0:120"),
        ("a:b", "frames 'a:b': expected A:B, half-open, such as 0:120"),
        ("5:5", "frames '5:5': is empty, expected the first frame before the last"),
        ("90:101", "frames '90:101': the take has frames 0 to 99 at 60 fps"),
    ],
)
def test_other_frames_are_refused(text: str, message: str) -> None:
    with pytest.raises(TakeError) as caught:
        parse_range(text, 100, 60.0)
    assert str(caught.value) == message
