"""What users write to choose avatars."""

from dataclasses import replace

import numpy as np
import pytest

from crowdsim.crowd.crowd import build_crowd
from crowdsim.errors import TakeError
from crowdsim.export.select import parse_avatars

NAMES = np.array([f"red_{number}" for number in range(8)] + ["blue-1_0", "blue-1_1"])
CAST = replace(
    build_crowd(np.arange(10.0), np.zeros(10)).cast,
    names=NAMES,
    types=np.isin(np.arange(10), (2, 9)).astype(np.int16),
    type_names=("light", "heavy"),
    teams=(np.arange(10) == 4).astype(np.int16),
    team_names=("home", "guests"),
)


@pytest.mark.parametrize(
    ("text", "numbers"),
    [
        (None, None), ("0", [0]), ("0-3", [0, 1, 2, 3]), ("7,1 , 3-4,3", [1, 3, 4, 7]), ("9-9", [9]),
        ("red_7", [7]), ("blue-1_1, 2 ,red_05", [2, 5, 9]), ("blue-1,1", [1, 8, 9]), ("heavy", [2, 9]), ("guests", [4]),
    ],
)  # fmt: skip
def test_avatars_are_numbers_ranges_and_names_of_avatars_groups_types_and_teams(
    text: str | None, numbers: list[int] | None
) -> None:
    assert parse_avatars(text, CAST) == numbers


KNOWN = "expected a number, or red_0 to red_7, blue-1_0 to blue-1_1"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", f"avatars '': there is no avatar '', {KNOWN}, or a range as in 0-9"),
        ("1;2", f"avatars '1;2': there is no avatar '1;2', {KNOWN}, or a range as in 0-9"),
        ("-1", f"avatars '-1': there is no avatar '-1', {KNOWN}, or a range as in 0-9"),
        (
            "1,rd_3",
            f"avatars '1,rd_3': there is no avatar 'rd_3', {KNOWN} (did you mean 'red_3'?), or a range as in 0-9",
        ),
        ("5-2", "avatars '5-2': '5-2' runs backwards, expected 2-5"),
        ("3,10", "avatars '3,10': there is no avatar 10, expected 0 to 9, or its name"),
    ],
)
def test_other_avatars_are_refused(text: str, message: str) -> None:
    with pytest.raises(TakeError) as caught:
        parse_avatars(text, CAST)
    assert str(caught.value) == message
