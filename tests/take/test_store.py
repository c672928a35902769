"""Takes on disk: what is written is what is read, by us and by others."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray
import zarr

from crowdsim.crowd.events import OUTCOMES
from crowdsim.errors import OutputError, TakeError
from crowdsim.scenario.names import avatar_name_fault
from crowdsim.take.header import TakeHeader
from crowdsim.take.layout import CAST as CAST_FIELDS
from crowdsim.take.store import TakeWriter, open_take
from crowdsim.take.take import VARIABLES, Cast, Events

AVATARS = 5
CAST = Cast(
    names=np.array([f"red_{i}" for i in range(AVATARS)]),
    types=np.zeros(AVATARS, np.int16),
    teams=np.array([0, 0, 1, 1, 1], np.int16),
    policies=np.zeros(AVATARS, np.int16),
    scales=np.linspace(0.9, 1.1, AVATARS).astype(np.float32),
    speeds=np.ones(AVATARS, np.float32),
    type_names=("boxer",),
    team_names=("red", "blue"),
    policy_names=("boxer",),
    colours=np.full((1, 3), np.nan),
    girths=np.linspace(0.85, 1.25, AVATARS).astype(np.float32),
    legs=np.linspace(0.9, 1.1, AVATARS).astype(np.float32),
    arms=np.linspace(1.1, 0.9, AVATARS).astype(np.float32),
    tempos=np.array([40.0, np.nan, 60.0, 70.0, 80.0], np.float32),
    aggressions=np.linspace(0.5, 2.0, AVATARS).astype(np.float32),
    ranges=np.linspace(-0.2, 0.4, AVATARS).astype(np.float32),
    stances=np.array([0, 1, 2, 1, 1], np.uint8),
    groups=np.array([0, 0, 1, 1, 0], np.int32),
    group_names=("first", "second"),
)
NO_EVENTS = Events(*(np.zeros((0, 3) if name == "point" else 0) for name in Events.__dataclass_fields__))
HEADER = TakeHeader(CAST, 15.0, "test", 3, ("abc",), ("ball",))


def events(*frames: float) -> Events:
    count = len(frames)
    return Events(
        frame=np.array(frames),
        attacker=np.arange(count, dtype=np.int32),
        victim=np.full(count, AVATARS - 1, np.int32),
        hand=np.ones(count, np.uint8),
        point=np.arange(3.0 * count).reshape(-1, 3),
        speed=np.full(count, 7.5),
        landed=np.arange(count) % 2 == 0,
    )


def chunk(first: int, frames: int) -> dict[str, np.ndarray]:
    base = (first + np.arange(frames))[:, None] * 10.0 + np.arange(AVATARS)
    rows = {name: base + index for index, name in enumerate(VARIABLES)}
    return {**rows, "opponent": np.broadcast_to((np.arange(AVATARS) + 1) % AVATARS, base.shape)}


@pytest.mark.parametrize(("reactions", "avoidance"), [(True, False), (False, True)])
def test_a_take_records_reactions_and_collision_avoidance(tmp_path: Path, reactions: bool, avoidance: bool) -> None:
    header = TakeHeader(CAST, 15.0, "test", 3, ("abc",), reactions=reactions, collision_avoidance=avoidance)
    writer = TakeWriter(tmp_path / "take.zarr", header, 1).open()
    writer.append(chunk(0, 1), events(), None)
    writer.close()
    assert open_take(tmp_path).reactions is reactions
    assert open_take(tmp_path).collision_avoidance is avoidance


def write(path: Path, sizes: list[int], planned: int | None = None, chunk_rows: int = 4) -> TakeWriter:
    frames = sum(sizes) if planned is None else planned
    writer = TakeWriter(path, HEADER, frames, chunk_rows).open()
    first = 0
    for size in sizes:
        writer.append(chunk(first, size), events(first + 0.5), np.full((size, 1, 3), float(first)))
        first += size
    return writer


@pytest.mark.parametrize("sizes", [[10], [1, 2, 3, 4], [4, 4, 2], [3, 7]])
def test_a_take_reads_back_as_it_was_written_however_it_came_in(tmp_path: Path, sizes: list[int]) -> None:
    write(tmp_path / "take.zarr", sizes).close()
    take = open_take(tmp_path)
    expected = chunk(0, 10)
    for name in VARIABLES:
        np.testing.assert_array_equal(getattr(take, name)[:], expected[name])
    assert take.frame_count == 10
    assert take.avatar_count == AVATARS
    assert take.status == "done"
    assert take.seed == 3
    assert list(take.cast.names) == list(CAST.names)
    np.testing.assert_array_equal(take.cast.scales, CAST.scales)
    assert take.target_names == ("ball",)
    assert len(take.events.frame) == len(sizes)
    assert take.events.landed.all()


def test_the_bytes_do_not_depend_on_how_frames_came_in(tmp_path: Path) -> None:
    write(tmp_path / "a.zarr", [10]).close()
    write(tmp_path / "b.zarr", [1, 1, 3, 5]).close()
    one, other = (
        {path.relative_to(tmp_path / name): path.read_bytes() for path in sorted((tmp_path / name).rglob("*.*"))
         if path.is_file() and "events" not in path.parts and path.name != ".zmetadata" and "target" not in path.parts}
        for name in ("a.zarr", "b.zarr")
    )  # fmt: skip
    assert one == other


def test_xarray_reads_every_variable_as_it_was_written(tmp_path: Path) -> None:
    writer = TakeWriter(tmp_path / "take.zarr", HEADER, 9, 4).open()
    zeros = {name: np.zeros((9, AVATARS)) for name in VARIABLES}
    zeros["x"][2, 3], zeros["action"][2, 3], zeros["opponent"][:], zeros["action"][0, 0] = np.nan, -1, -1, 7
    strikes = events(0.0, 1.5, 2.5)
    strikes.attacker[:], strikes.victim[:], strikes.hand[:] = 0, [1, -1, 3], [0, 1, 0]
    writer.append(zeros, strikes, np.zeros((9, 1, 3)))
    writer.close()
    take = open_take(tmp_path)
    read = xarray.open_zarr(tmp_path / "take.zarr")
    expected = {name: getattr(take, name)[:] for name in VARIABLES}
    expected |= {"target": take.targets[:], "time": np.arange(9) / 15.0}
    expected |= {name: getattr(take.cast, field) for name, field in CAST_FIELDS.items()}
    assert set(read.variables) == set(expected)
    read_events = xarray.open_zarr(tmp_path / "take.zarr", group="events")
    expected_events = {name: getattr(take.events, name) for name in Events.__dataclass_fields__}
    assert set(read_events.variables) == set(expected_events)
    for group, values in ((read, expected), (read_events, expected_events)):
        for name, value in values.items():
            assert group[name].dtype == value.dtype, name
            np.testing.assert_array_equal(group[name].values, value, err_msg=name)
            assert group[name].attrs["units"], name
            assert group[name].attrs["long_name"], name
    assert {name: str(value.dtype) for name, value in read_events.variables.items()} == {
        "frame": "float32", "attacker": "int32", "victim": "int32", "hand": "uint8", "point": "float32",
        "speed": "float32", "landed": "bool", "limb": "uint8", "outcome": "uint8", "damage": "float32", "down": "bool",
    }  # fmt: skip


def test_outcomes_of_strikes_have_their_meanings_in_xarray(tmp_path: Path) -> None:
    write(tmp_path / "take.zarr", [6]).close()
    outcome = xarray.open_zarr(tmp_path / "take.zarr", group="events").outcome
    assert outcome.attrs["flag_values"] == [0, 1, 2, 3]
    assert outcome.attrs["flag_meanings"].split() == list(OUTCOMES)


def strike_all(path: Path) -> Events:
    """Write a take with a strike of each outcome."""
    writer = TakeWriter(path / "take.zarr", TakeHeader(CAST, 15.0, "test", 3, ("abc",)), 4).open()
    strikes = replace(events(0.0, 0.5, 1.0, 1.5), landed=np.arange(4) == 1, outcome=np.arange(4, dtype=np.uint8))
    strikes = replace(strikes, victim=(strikes.attacker + 1) % AVATARS)
    writer.append(chunk(0, 4), strikes)
    writer.close()
    return strikes


def test_a_take_keeps_what_became_of_strikes(tmp_path: Path) -> None:
    strikes = strike_all(tmp_path)
    take = open_take(tmp_path)
    np.testing.assert_array_equal(take.events.outcome, strikes.outcome)
    assert take.strikes()["outcome"].tolist() == list(OUTCOMES)
    assert take.strikes(outcome="blocked")["attacker"].tolist() == [2]
    assert len(take.strikes(landed=False, outcome="landed")) == 0
    with pytest.raises(TakeError, match=r"outcome is 'evade', expected one of missed, .* \(did you mean 'evaded'"):
        take.strikes(outcome="evade")


def test_takes_without_outcomes_have_those_that_landed_say(tmp_path: Path) -> None:
    strike_all(tmp_path)
    shutil.rmtree(tmp_path / "take.zarr" / "events" / "outcome")
    assert open_take(tmp_path).events.outcome.tolist() == [0, 1, 0, 0]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"outcome": [0, 0, 2, 3]}, r"events/outcome: is missed at \[1\], expected landed"),
        ({"outcome": [1, 1, 2, 3]}, r"events/outcome: is landed at \[0\], expected another, since it did not land"),
        ({"outcome": [0, 1, 9, 3]}, r"events/outcome: holds 9 at \[2\]"),
        ({"victim": [1, 2, -1, 0]}, r"events/victim: is -1 at \[2\], expected another avatar, which blocks"),
        ({"victim": [1, 2, 3, -1]}, r"events/victim: is -1 at \[3\], expected another avatar or a target that evades"),
    ],
)
def test_outcomes_that_cannot_be_are_refused(tmp_path: Path, changes: dict[str, list[int]], message: str) -> None:
    strike_all(tmp_path)
    group = zarr.open_group(str(tmp_path / "take.zarr"), mode="r+")
    for name, values in changes.items():
        group["events"][name][:] = values
    with pytest.raises(TakeError, match=message):
        open_take(tmp_path)


def test_time_and_avatar_names_are_coordinates(tmp_path: Path) -> None:
    write(tmp_path / "take.zarr", [3, 3], planned=100).close("interrupted")
    data = xarray.open_zarr(tmp_path / "take.zarr")
    assert {"time", "name"} <= set(data.coords)
    assert {"time", "name"} <= set(data.x.coords)
    assert data.time.attrs["units"] == "s"
    np.testing.assert_array_equal(data.time, np.arange(6) / 15.0)
    assert float(data.x.swap_dims(frame="time").sel(time=2 / 15, method="nearest")[1]) == chunk(0, 6)["x"][2, 1]
    assert data.x.set_index(avatar="name").sel(avatar="red_3").shape == (6,)


def test_xarray_opens_a_take_with_its_dimensions_and_units(tmp_path: Path) -> None:
    write(tmp_path / "take.zarr", [6]).close()
    data = xarray.open_zarr(tmp_path / "take.zarr")
    assert data.action.dims == ("frame", "avatar")
    assert data.x.attrs["units"] == "m"
    assert data.target.dims == ("frame", "target", "component")
    assert dict(data.sizes) == {"frame": 6, "avatar": AVATARS, "target": 1, "component": 3}
    strikes = xarray.open_zarr(tmp_path / "take.zarr", group="events")
    assert strikes.point.dims == ("event", "component")


def test_an_avatar_frame_takes_24_bytes() -> None:
    from crowdsim.take.layout import DTYPES

    assert sum(np.dtype(DTYPES[name]).itemsize for name in VARIABLES) == 24


def test_nothing_has_the_final_name_before_the_take_is_closed(tmp_path: Path) -> None:
    writer = write(tmp_path / "take.zarr", [8])
    assert not (tmp_path / "take.zarr").exists()
    with pytest.raises(TakeError, match="only what a run left that was killed"):
        open_take(tmp_path)
    writer.close()
    assert [path.name for path in tmp_path.iterdir()] == ["take.zarr"]


def test_an_interrupted_take_keeps_the_frames_that_were_done(tmp_path: Path) -> None:
    write(tmp_path / "take.zarr", [3, 3], planned=100).close("interrupted")
    take = open_take(tmp_path)
    assert take.status == "interrupted"
    assert take.frame_count == 6
    np.testing.assert_array_equal(take.x[:], chunk(0, 6)["x"])


def test_a_path_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"take\.zarr\.partial: cannot be made"):
        write(tmp_path / "file" / "take.zarr", [1])


def test_foreign_and_damaged_takes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(TakeError, match=r"no take here; expected take\.zarr"):
        open_take(tmp_path)
    write(tmp_path / "take.zarr", [4]).close()
    attributes = tmp_path / "take.zarr" / ".zattrs"
    report = json.loads(attributes.read_text())
    attributes.write_text(json.dumps({**report, "format": "other"}))
    (tmp_path / "take.zarr" / ".zmetadata").unlink()
    with pytest.raises(TakeError, match="is no take: its format is 'other', expected 'crowdsim-take'"):
        open_take(tmp_path)
    attributes.write_text(json.dumps({**report, "version": 99}))
    with pytest.raises(TakeError, match="is a take of version 99, expected 1"):
        open_take(tmp_path)
    attributes.write_text(json.dumps({name: value for name, value in report.items() if name != "team_names"}))
    with pytest.raises(TakeError, match=r"\.zattrs: is damaged: team_names: missing, expected a list"):
        open_take(tmp_path)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["a_0", "../../x", "c"], r"avatar 1 is named '\.\./\.\./x', expected letters, digits, '_', '-' and '\.', at "),
        (["/x", "b", "c"], "avatar 0 is named '/x', expected letters"),
        (["a", "b", ""], "avatar 2 is named '', expected letters"),
        (["a", "b\n", "c"], r"avatar 1 is named 'b\\n', expected letters"),
        (["a", "b", "A"], "avatars 0 and 2 are named 'a' and 'A', expected a name of its own each"),
    ],
)
def test_names_that_no_scenario_could_give_are_refused(tmp_path: Path, names: list[str], message: str) -> None:
    cast = replace(CAST, names=np.array([*names, "y", "z"]))
    writer = TakeWriter(tmp_path / "take.zarr", TakeHeader(cast, 15.0, "test", 3, ("abc",)), 1).open()
    writer.append(chunk(0, 1), events(), None)
    writer.close()
    with pytest.raises(TakeError, match=rf"take\.zarr: {message}"):
        open_take(tmp_path)


def test_the_longest_group_name_with_a_number_is_an_avatar_name(tmp_path: Path) -> None:
    assert avatar_name_fault(["g" * 64 + "_0000", "g" * 64 + "_0001"]) == ""
    assert avatar_name_fault(["g" * 65])


def test_policy_names_that_lead_elsewhere_are_refused(tmp_path: Path) -> None:
    cast = replace(CAST, policy_names=("../boxer",))
    writer = TakeWriter(tmp_path / "take.zarr", TakeHeader(cast, 15.0, "test", 3, ("abc",)), 1).open()
    writer.append(chunk(0, 1), events(), None)
    writer.close()
    with pytest.raises(TakeError, match=r"a policy is named '\.\./boxer', expected a name of letters"):
        open_take(tmp_path)


@pytest.mark.parametrize("kind", ["team", "type", "group"])
def test_names_that_a_spreadsheet_would_compute_are_refused(tmp_path: Path, kind: str) -> None:
    named = {f"{kind}_names": ("=1+1", *getattr(CAST, f"{kind}_names")[1:])}
    cast = replace(CAST, **named)
    writer = TakeWriter(tmp_path / "take.zarr", TakeHeader(cast, 15.0, "test", 3, ("abc",)), 1).open()
    writer.append(chunk(0, 1), events(), None)
    writer.close()
    with pytest.raises(TakeError, match=rf"take\.zarr: a {kind} is named '=1\+1', expected a name of letters"):
        open_take(tmp_path)


def test_links_and_pipes_in_a_take_are_refused_and_not_opened(tmp_path: Path) -> None:
    write(tmp_path / "take.zarr", [4]).close()
    part = tmp_path / "take.zarr" / "x" / "0.0"
    part.rename(tmp_path / "elsewhere")
    os.mkfifo(part)
    with pytest.raises(TakeError, match=r"x/0\.0: is a named pipe, expected a regular file"):
        open_take(tmp_path)
    part.unlink()
    part.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(TakeError, match=r"x/0\.0: is a symbolic link, expected a regular file; links are not followed"):
        open_take(tmp_path)


def test_a_take_is_never_written_over_another(tmp_path: Path) -> None:
    write(tmp_path / "take.zarr", [4]).close()
    (tmp_path / "other.zarr.partial").mkdir()
    for name in ("take.zarr", "other.zarr"):
        with pytest.raises(OutputError, match="is there already, expected a new name for the take"):
            write(tmp_path / name, [2])
    assert open_take(tmp_path).frame_count == 4
    assert (tmp_path / "other.zarr.partial").is_dir()


def test_output_frames_reach_to_the_end_of_the_last_control_frame(tmp_path: Path) -> None:
    write(tmp_path / "take.zarr", [15]).close()
    take = open_take(tmp_path)
    assert take.seconds == 1.0
    assert take.output_frames(60) == 60
    assert take.output_frames(24) == 24
    assert take.output_frames(7) == 7
