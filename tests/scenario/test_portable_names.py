"""Names in scenarios become names of files, which every system must be able to have."""

from pathlib import Path

import pytest
from scenes import crowdsim, scene, write_scene

from crowdsim.scenario.names import avatar_name_fault

RESERVED = ["CON", "nul", "Aux", "PRN", "COM1", "lpt9", "con.x", "COM0.tar.gz", "a.", "a..", "a:b", "a ", "a\\b", "a?"]
ALLOWED = ["CONSOLE", "con_1", "a.b", "COM", "COM10", "nul-1", "x.con"]


def findings(path: Path, capsys) -> tuple[int, str]:
    capsys.readouterr()
    code = crowdsim("validate", path)
    return code, capsys.readouterr().err


@pytest.mark.parametrize("name", RESERVED)
def test_names_that_windows_reserves_are_findings(workplace: Path, name: str, capsys) -> None:
    group = {**scene()["groups"][0], "name": name}
    for changes, where in (({"name": name}, "name"), ({"groups": [group, scene()["groups"][1]]}, "groups[0].name")):
        path = write_scene(workplace / "four.yaml", **changes)
        code, report = findings(path, capsys)
        assert code == 2
        assert f" {where}: is {name!r}, expected a name of letters, digits, '_', '-' and '.', at most 64" in report
        assert report.endswith("and none that Windows reserves, such as CON, NUL or COM1\n")
        assert crowdsim("run", path) == 2
        assert not (workplace / "output").exists()


@pytest.mark.parametrize("name", ALLOWED)
def test_names_that_only_look_like_reserved_ones_are_allowed(workplace: Path, name: str, capsys) -> None:
    assert findings(write_scene(workplace / "four.yaml", name=name), capsys) == (0, "")


@pytest.mark.parametrize("file", ["CON.csv", "nul/points.csv", "points /a.csv", "dots./a.csv", "a?.csv"])
def test_files_that_runs_hold_too_have_names_that_windows_allows(workplace: Path, file: str, capsys) -> None:
    (workplace / file).parent.mkdir(exist_ok=True)
    (workplace / file).write_text("0,0\n1,1\n")
    group = {**scene()["groups"][0], "placement": {"kind": "points", "file": file}}
    code, report = findings(write_scene(workplace / "four.yaml", groups=[group, scene()["groups"][1]]), capsys)
    assert code == 2
    assert f"{file!r}, expected a name that Windows allows, since runs hold the file too" in report


@pytest.mark.parametrize("name", RESERVED)
def test_avatars_of_a_take_have_no_such_names(name: str) -> None:
    assert avatar_name_fault(["red_0", name]).startswith(f"avatar 1 is named {name!r}, expected letters, digits")
    assert avatar_name_fault(ALLOWED) == ""


def test_a_recipe_that_is_written_for_capture_has_no_such_name(workplace: Path, capsys) -> None:
    assert crowdsim("train", "--mocap", ".", "--name", "CON") == 2
    assert capsys.readouterr().err.startswith("--name CON: expected a name of letters, digits")
