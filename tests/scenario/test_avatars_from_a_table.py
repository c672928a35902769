"""A table places avatars, and gives each of them a name, and a heading, a type and a team where it says so."""

import csv
from pathlib import Path

import numpy as np
import pytest
from scenes import crowdsim, scene

from crowdsim.crowd.distributions import draw_types
from crowdsim.crowd.placement import place_groups, teams_of_avatars
from crowdsim.errors import ScenarioError
from crowdsim.scenario.scenario import dump_scenario, load_scenario
from crowdsim.scenario.warnings import team_warnings
from crowdsim.take.store import open_take

CAST = """\
name, x [m], z (m), heading, type, team
Anna,-1,0,90,quick,red
"Cleo", -1.5, 1.5, , quick, red
Ben,1,0,-90,heavy,blue
Dov,1.5,1.5,,,blue
"""


def with_table(folder: Path, text: str = CAST, others: tuple = (), **keys):
    """Plain data of a scenario whose first group is placed by this table."""
    (folder / "cast.csv").write_text(text, encoding="utf-8")
    group = {"name": "four", "type": "heavy", "placement": {"kind": "table", "file": "cast.csv"}, **keys}
    group = {key: value for key, value in group.items() if value is not None}
    return scene(types={"quick": {"policy": "tiny"}, "heavy": {"policy": "tiny"}}, groups=[group, *others])


def write(folder: Path, text: str = CAST, others: tuple = (), **keys) -> Path:
    import yaml

    path = folder / "cast.yaml"
    path.write_text(yaml.safe_dump(with_table(folder, text, others, **keys), sort_keys=False))
    return path


def loaded(folder: Path, text: str = CAST, others: tuple = (), keys: dict | None = None, **options):
    return load_scenario(write(folder, text, others, **(keys or {})), policies=["tiny"], **options)


def refused(folder: Path, text: str, others: tuple = (), **keys) -> list[str]:
    with pytest.raises(ScenarioError) as error:
        loaded(folder, text, others, keys)
    return str(error.value).replace(f"{folder}/", "").splitlines()


def test_a_table_gives_names_types_teams_positions_and_headings(tmp_path):
    result = loaded(tmp_path)
    assert result.avatar_names() == ["Anna", "Cleo", "Ben", "Dov"]
    assert [result.avatar_name(i) for i in range(4)] == result.avatar_names()
    assert (result.avatar_count, result.teams, result.used_types) == (4, ("red", "blue"), {"quick", "heavy"})
    np.testing.assert_array_equal(draw_types(result), [0, 0, 1, 1])
    np.testing.assert_array_equal(teams_of_avatars(result), [0, 0, 1, 1])
    x, z, heading = place_groups(result)
    np.testing.assert_array_equal(np.stack([x, z]), [[-1, -1.5, 1, 1.5], [0, 1.5, 0, 1.5]])
    # Without a heading an avatar looks at the middle, (0, 0.75).
    np.testing.assert_allclose(heading, [np.pi / 2, np.arctan2(1.5, -0.75), -np.pi / 2, np.arctan2(-1.5, -0.75)])


def test_avatars_groups_and_teams_are_found_by_name(tmp_path):
    other = {"name": "late", "team": "blue", "type": "quick", "count": 2, "placement": {"kind": "grid"}}
    result = loaded(tmp_path, others=({**other, "waits": False, "placement": {"kind": "grid", "centre": [9, 9]}},))
    found = {name: result.members(name) for name in ("Ben", "four", "red", "blue", "late_1", "four_1", "Eve")}
    assert found == {
        "Ben": [2], "four": [0, 1, 2, 3], "red": [0, 1], "blue": [2, 3, 4, 5], "late_1": [5], "four_1": None,
        "Eve": None,
    }  # fmt: skip
    assert result.avatar_names()[3:] == ["Dov", "late_0", "late_1"]


def test_numbers_order_avatars_and_a_count_takes_the_first_ones(tmp_path):
    text = "number,name,x,z\n2,A,0,0\n0,B,1,0\n1,C,2,0\n"
    assert loaded(tmp_path, text, keys={"team": "red"}, overrides="opponents={kind: anyone}").avatar_names() == [
        "B", "C", "A",
    ]  # fmt: skip
    keys = {"team": "red", "count": 2}
    assert loaded(tmp_path, text, keys=keys, overrides="opponents={kind: anyone}").avatar_names() == ["B", "C"]
    part = loaded(tmp_path, CAST, fraction=0.5, overrides="opponents={kind: anyone}")
    assert part.avatar_names() == ["Anna", "Cleo"]


def test_types_that_a_table_leaves_open_are_drawn_from_the_mix(tmp_path):
    rows = "".join(f"a{i},{i},0,{'quick' if i < 5 else ''}\n" for i in range(40))
    keys = {"type": None, "mix": {"quick": 1, "heavy": 1}, "team": "red"}
    result = loaded(tmp_path, f"name,x,z,type\n{rows}", keys=keys, overrides="opponents={kind: anyone}")
    types = draw_types(result)
    assert (types[:5] == 0).all()
    assert 5 < np.count_nonzero(types[5:] == 1) < 30


def test_members_of_one_group_look_at_the_middle_of_teams_other_than_their_own(tmp_path):
    _, _, heading = place_groups(loaded(tmp_path, keys={"facing": "enemies"}))
    assert (heading[:2] > 0).all()  # the red ones are at x < 0
    assert (heading[2:] < 0).all()


def test_a_resolved_scenario_loads_again_and_notices_that_the_table_has_changed(tmp_path):
    result = loaded(tmp_path)
    (tmp_path / "again.yaml").write_text(dump_scenario(result))
    again = load_scenario(tmp_path / "again.yaml", policies=["tiny"])
    assert again == result
    assert again.files == ("cast.csv",)
    assert again.avatar_names() == result.avatar_names()
    (tmp_path / "cast.csv").write_text(CAST.replace("Dov", "Eve"))
    with pytest.raises(ScenarioError, match="sha256: the file has changed, expected the checksum"):
        load_scenario(tmp_path / "again.yaml", policies=["tiny"])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("name,x\nA,1\n", ["1:1: no column z, expected name, x and z in the first line"]),
        ("name,x,z,tpe\nA,1,2,quick\n",
         ["1:10: no known column 'tpe', expected name, x, z, heading, type, team or number (did you mean 'type'?)"]),
        ("name,x,z,x\nA,1,2,3\n", ["1:10: a second column 'x', expected one"]),
        ("", ["1:1: the file is empty, expected columns name, x and z"]),
        ("name,x,z\n\n", ["2:1: the table has no rows, expected one for each avatar"]),
        ("name,x,z\nA,1\n", ["2:1: the row has 2 cells, expected 3 as the first line"]),
        ("name,x,z\nA,1,nan\nB,4001,2\nC,1_0,inf\n",
         ["2:5: z is 'nan', expected metres from -4000 to 4000", "3:3: x is '4001', expected metres from -4000 to 4000",
          "4:3: x is '1_0', expected metres from -4000 to 4000",
          "4:7: z is 'inf', expected metres from -4000 to 4000"]),
        ("name,x,z,heading\nA,1,2,361\n", ["2:7: heading is '361', expected degrees from -360 to 360"]),
        ("name,x,z\nAnna,1,2\nBen,2,2\nanna,3,2\n",
         ["4:1: name is 'anna' like that in line 2, expected a name of its own"]),
        ("name,x,z\n../up,1,2\n", ["2:1: name is '../up', expected one of letters, digits, '_', '-' and '.'"]),
        ("name,x,z\nCON,1,2\n", ["2:1: name is 'CON', expected one of letters, digits, '_', '-' and '.', at most 64"]),
        ("name,x,z\n3-5,1,2\n", ["2:1: name is '3-5', which means avatars by number, expected a letter in it"]),
        ("name,x,z\nAvatars,1,2\n",
         ["2:1: name is 'Avatars', as the list beside exported files, expected another one"]),
        ('name,x,z\n"A,1,2\n', ["2:1: a quote that is not closed in its line, expected '\"' at its end"]),
        ('name,x,z\n"A"b,1,2\n', ["2:4: text behind a quoted cell, expected ','"]),
        ("name,x,z,number\nA,1,2,0\nB,2,2,0\nC,3,2,4\n",
         ["3:7: number is 0 like that in line 2, expected each once",
          "4:7: number is '4', expected whole numbers from 0 to 2, each once"]),
        ("name;x;z;type\nA;1;2;quik\n",
         ["2:7: type is 'quik', expected a type: quick or heavy (did you mean 'quick'?)"]),
        ("name,x,z\nfour,1,2\nquick,2,2\nlate_0,3,2\n",
         ["2:1: name is 'four' like group 'four', expected a name of its own",
          "3:1: name is 'quick' like type 'quick', expected a name of its own",
          "4:1: name is 'late_0' like avatar 'late_0' of group 'late', expected a name of its own"]),
        ("name,x,z,team\nA,1,2,Red\nB,2,2,red\n",
         ["3:7: team is 'red', which is 'Red' but for capitals, expected one of these"]),
        (b"name,x,z\nA,1,2\nB,\xff,2\n", ["3:3: byte 0xff is no UTF-8, expected a text file in UTF-8"]),
        ("name,x,z\n" + "A" * 10_001, ["2:1: the line is longer than 10,000 characters, expected a row of cells"]),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_table_is_reported_with_file_line_and_column(tmp_path, text, expected):
    other = {"name": "late", "team": "blue", "type": "quick", "count": 1, "placement": {"kind": "grid"}}
    path = write(tmp_path, others=(other,))
    (tmp_path / "cast.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ScenarioError) as error:
        load_scenario(path, policies=["tiny"])
    lines = str(error.value).splitlines()
    start = f"groups[0].placement.file: {tmp_path / 'cast.csv'}:"
    assert len(lines) == len(expected)
    for line, one in zip(lines, expected, strict=True):
        place, _, rest = line.partition(": ")
        assert place.startswith(f"{path}:")
        assert rest.startswith(start + one)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_cells_lie_between_commas_semicolons_or_tabs_and_may_be_quoted(tmp_path, separator, ending):
    rows = ['"name"', '"x"', "z [m]", "type", '"team"'], ["A", "1", '"2"', "", '"red"'], ['"B"', "3", "4", "quick", ""]
    text = "\ufeff" + ending.join(separator.join(row) for row in rows) + ending * 2
    path = write(tmp_path)
    (tmp_path / "cast.csv").write_bytes(text.encode())
    result = load_scenario(path, policies=["tiny"])
    assert result.avatar_names() == ["A", "B"]
    assert result.teams == ("red", "one")
    assert [row.type.text for row in result.groups[0].rows] == ["", "quick"]
    np.testing.assert_array_equal(place_groups(result)[:2], [[1, 3], [2, 4]])


def test_of_very_many_faults_of_a_table_the_first_ones_are_reported(tmp_path):
    lines = refused(tmp_path, "name,x,z\n" + "".join(f"a{i},x,0\n" for i in range(5000)))
    assert 100 <= len(lines) <= 101


def test_tables_with_too_few_rows_and_avatars_without_a_type_are_refused(tmp_path):
    assert refused(tmp_path, CAST, count=5)[0].endswith(
        "groups[0].count: is 5, but cast.csv has 4 rows, expected at most as many"
    )
    assert refused(tmp_path, CAST, type=None)[0].endswith(
        "groups[0]: has neither 'type' nor 'mix', and cast.csv has no type in line 5, expected one of these"
    )
    full = CAST.replace("1.5,,,blue", "1.5,,heavy,blue")
    assert loaded(tmp_path, full, keys={"type": None}).avatar_count == 4


def test_avatars_of_a_table_enter_along_a_path_and_look_along_it(tmp_path):
    enter = {"path": [[-9, 0], [-5, 0]]}
    assert refused(tmp_path, CAST, enter=enter)[0].endswith(
        "groups[0].placement.file: is 'cast.csv', whose headings have no effect with 'enter', since avatars look along "
        "their path, expected no column 'heading'"
    )
    result = loaded(tmp_path, CAST.replace(",90,", ",,").replace(",-90,", ",,"), keys={"enter": enter})
    assert result.avatar_names() == ["Anna", "Cleo", "Ben", "Dov"]


@pytest.mark.parametrize(
    ("file", "expected"),
    [
        ("none.csv", "holds no such file, expected one of cast.csv"),
        ("../cast.csv", "expected a path inside the scenario's folder"),
        ("cast.npy", "expected a file that ends in .csv"),
        ("nul.csv", "expected a name that Windows allows, since runs hold the file too"),
    ],
)
def test_tables_lie_in_the_scenario_s_folder(tmp_path, file, expected):
    assert refused(tmp_path, CAST, placement={"kind": "table", "file": file})[0].endswith(expected)


def test_a_table_that_is_a_link_out_of_the_folder_is_refused(tmp_path):
    (tmp_path / "up.csv").write_text(CAST)
    folder = tmp_path / "scenes"
    folder.mkdir()
    path = write(folder)
    (folder / "cast.csv").unlink()
    (folder / "cast.csv").symlink_to(tmp_path / "up.csv")
    with pytest.raises(ScenarioError, match="a link that leaves the scenario's folder, expected a file in it"):
        load_scenario(path, policies=["tiny"])


def test_groups_without_a_table_still_need_a_count(tmp_path):
    group = {"type": "heavy", "placement": {"kind": "grid"}}
    with pytest.raises(ScenarioError, match=r"groups\[1\].count: missing, expected a whole number from 1 to 10000000"):
        loaded(tmp_path, others=(group,))


def test_conditions_name_teams_of_tables(tmp_path):
    def data(team):
        event = {"kind": "flee", "when": {"kind": "strikes", "count": 3, "team": team}}
        return {**with_table(tmp_path), "events": [event]}

    path = tmp_path / "cast.yaml"
    path.write_text(str(data("blue")))
    load_scenario(path, policies=["tiny"])
    path.write_text(str(data("blu")))
    with pytest.raises(ScenarioError, match=r"team: is 'blu', expected a team: red or blue \(did you mean 'blue'\?\)"):
        load_scenario(path, policies=["tiny"])


def test_a_team_of_one_avatar_that_is_spelt_nearly_as_another_is_pointed_out(tmp_path):
    assert team_warnings(loaded(tmp_path)) == []
    (warning,) = team_warnings(loaded(tmp_path, CAST + "Eve,3,3,,,blu\n"))
    assert warning.message.endswith("cast.csv:6:11: team is 'blu', and no other avatar is of it (did you mean 'blue'?)")


def test_two_avatars_at_one_point_are_refused(tmp_path):
    with pytest.raises(ScenarioError, match=r"avatar Ben would be 0.00 m from Anna, expected 0.1 m or more"):
        place_groups(loaded(tmp_path, CAST.replace("Ben,1", "Ben,-1")))


def test_runs_takes_and_exports_use_the_names_of_a_table(workplace: Path, capsys):
    path = write(workplace)
    text = path.read_text() + "outputs: {bvh: {avatars: [Anna, blue]}}\n"
    path.write_text(text)
    assert crowdsim("run", path) == 0
    folder = workplace / "output" / "four"
    assert {one.name for one in (folder / "bvh").iterdir()} == {"Anna.bvh", "Ben.bvh", "Dov.bvh", "avatars.csv"}
    rows = list(csv.DictReader((folder / "bvh" / "avatars.csv").open()))
    assert [(row["number"], row["name"], row["team"], row["type"]) for row in rows] == [
        ("0", "Anna", "red", "quick"), ("2", "Ben", "blue", "heavy"), ("3", "Dov", "blue", "heavy"),
    ]  # fmt: skip
    cast = open_take(folder / "take.zarr").cast
    assert cast.names.tolist() == ["Anna", "Cleo", "Ben", "Dov"]
    assert cast.members("four").tolist() == [0, 1, 2, 3]
    assert cast.members("red").tolist() == [0, 1]
    assert crowdsim("export", folder, "--bvh", "--avatars", "Cleo,3", "--out", workplace / "x", "--quiet") == 0
    assert {one.name for one in (workplace / "x" / "bvh").iterdir()} == {"Cleo.bvh", "Dov.bvh", "avatars.csv"}
    capsys.readouterr()
    assert crowdsim("export", folder, "--bvh", "--avatars", "Cloe", "--out", workplace / "y") == 2
    assert "there is no avatar 'Cloe', expected a number, or Anna, Cleo, Ben, Dov (did you mean 'Cleo'?)" in (
        capsys.readouterr().err
    )
    assert crowdsim("run", path, "--extend", "5") == 0
    assert open_take(folder / "take.zarr").cast.members("four").tolist() == [0, 1, 2, 3]


def test_takes_without_a_table_record_no_groups(workplace: Path):
    import yaml

    path = workplace / "plain.yaml"
    path.write_text(yaml.safe_dump(scene()))
    assert crowdsim("run", path, "--quiet") == 0
    assert not (workplace / "output" / "four" / "take.zarr" / "group").exists()
