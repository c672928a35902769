"""What takes record of each avatar: build, temperament and stance."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray
import zarr
from take.test_store import AVATARS, CAST, write

from crowdsim.errors import TakeError
from crowdsim.take.header import TakeHeader
from crowdsim.take.layout import LATER_CAST
from crowdsim.take.store import TakeWriter, open_take


def test_stances_have_their_meanings_in_xarray(tmp_path: Path) -> None:
    write(tmp_path / "take.zarr", [6]).close()
    stance = xarray.open_zarr(tmp_path / "take.zarr").stance
    assert stance.attrs["flag_values"] == [0, 1, 2]
    assert stance.attrs["flag_meanings"].split() == ["any", "orthodox", "southpaw"]
    assert stance.values.tolist() == CAST.stances.tolist()


def test_avatars_of_older_takes_are_of_the_usual_build_and_temperament(tmp_path: Path) -> None:
    write(tmp_path / "take.zarr", [6]).close()
    for name in LATER_CAST:
        shutil.rmtree(tmp_path / "take.zarr" / name)
    cast = open_take(tmp_path).cast
    assert np.isnan(cast.tempos).all()
    ones = (cast.girths, cast.legs, cast.arms, cast.aggressions)
    for values, usual in (*((values, 1.0) for values in ones), (cast.ranges, 0.0), (cast.stances, 0)):
        assert values.tolist() == [usual] * AVATARS
    np.testing.assert_array_equal(cast.widths, cast.scales)
    assert (cast.stretches == 1.0).all()


def test_bodies_of_types_are_those_of_the_take(tmp_path: Path) -> None:
    for name, bodies in (("usual", (("male", "gloves"),)), ("other", (("female", "bare"),))):
        header = TakeHeader(replace(CAST, bodies=bodies), 15.0, "test", 3, ("abc",), ("ball",))
        TakeWriter(tmp_path / name / "take.zarr", header, 6).open().close()
        cast = open_take(tmp_path / name).cast
        assert cast.bodies == bodies
        np.testing.assert_array_equal(cast.bare, [name == "other"] * AVATARS)
    # Takes without other bodies are as they were before types had any.
    assert "type_bodies" not in zarr.open_group(str(tmp_path / "usual" / "take.zarr"), mode="r").attrs


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("stance", 3, r"stance: holds 3 at \[2\]"),
        ("girth", 0.0, r"girth: holds 0\.0 at \[2\]"),
        ("legs", 0.0, r"legs: holds 0\.0 at \[2\]"),
        ("arms", 20.0, r"arms: holds 20\.0 at \[2\]"),
        ("tempo", -1.0, r"tempo: holds -1\.0 at \[2\]"),
        ("range", np.nan, r"range: holds nan at \[2\]"),
    ],
)
def test_builds_and_temperaments_that_cannot_be_are_refused(
    tmp_path: Path, name: str, value: float, message: str
) -> None:
    write(tmp_path / "take.zarr", [6]).close()
    zarr.open_group(str(tmp_path / "take.zarr"), mode="r+")[name][2] = value
    with pytest.raises(TakeError, match=message):
        open_take(tmp_path)
