"""What users write to choose avatars."""

import pytest

from crowdsim.errors import TakeError
from crowdsim.export.select import parse_avatars


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
