"""Scenarios and placement files that are made to do harm are refused in little time, at a position."""

from pathlib import Path
from time import process_time

import numpy as np
import pytest

from crowdsim import assets
from crowdsim.crowd.placement import place_groups
from crowdsim.errors import ScenarioError
from crowdsim.scenario.scenario import load_scenario

LONGEST = 3.0
"""How long a file of up to 1 MiB may take [s]: 2 s on a core of its own."""
BASE = """\
version: 1
name: a
duration: 60
types: {a: {policy: boxer}}
groups:
- {type: a, count: 2, placement: {kind: grid}}
"""
EVENTS = "events:\n"
EVENT = "- {kind: weights, when: {kind: frame, frame: 7}, temperature: 1}\n"
WRONG_EVENT = "- {kind: weights, when: {kind: frame, frame: -7}, temperature: x, group: 3}\n"


def chain(count: int, first: str) -> str:
    types = "".join(f"  t{i}: {{extends: t{i - 1}}}\n" for i in range(count - 1, 0, -1))
    return BASE.replace("{a: {policy: boxer}}", f"\n  a: {{policy: boxer}}\n{types}  t0: {{extends: {first}}}")


@pytest.fixture(autouse=True)
def folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setattr(assets, "policy_names", lambda: ["boxer"])
    monkeypatch.chdir(tmp_path)
    return tmp_path


def read(text: str) -> str:
    """Return what is wrong with a scenario; nothing where its avatars have been placed."""
    Path("s.yaml").write_text(text, encoding="utf-8")
    since, wrong = process_time(), ""
    try:
        place_groups(load_scenario("s.yaml"))
    except ScenarioError as error:
        wrong = str(error)
    assert process_time() - since < LONGEST
    return wrong


@pytest.mark.parametrize("text", [chain(9_999, "a"), BASE + EVENTS + EVENT * 9_998], ids=["chain", "events"])
def test_long_scenarios_are_read_in_little_time(text: str) -> None:
    assert read(text) == ""


@pytest.mark.parametrize(
    ("text", "first"),
    [
        (BASE + EVENTS + EVENT * 10_001, "s.yaml:8:1: events: has 10001 items, expected at most 10000"),
        (BASE + EVENTS + EVENT.replace("7", "-7") * 4000, "s.yaml:8:46: events[0].when.frame: is -7, expected a "),
        (
            BASE + "- {type: b, count: 1, placement: {kind: gird}}\n" * 4000,
            "s.yaml:7:10: groups[1].type: is 'b', expect",
        ),
        (
            BASE + EVENTS + WRONG_EVENT * 10_500,
            "s.yaml:8:46: events[0].when.frame: is -7, expected a whole number from",
        ),
        (
            BASE + EVENTS + "- {a: 1}\n" * 33_000,
            "s.yaml:8:3: events[0].kind: missing, expected 'weights', 'retarget', ",
        ),
        (BASE + EVENTS + "- {kind: 1}\n" * 70_000, "s.yaml:66666:3: the file holds more than 100,000 values, exp"),
        (BASE + "- {type: b, count: 0, waits: 3}\n" * 14_000, "s.yaml:7:10: groups[1].type: is 'b', expected a type"),
        (BASE + "".join(f"k{i}: 1\n" for i in range(9_000)), "s.yaml:7:1: k0: unknown key, expected version, name, "),
        (
            BASE + "".join(f"k{i}: 1\n" for i in range(90_000)),
            "s.yaml:1:1: a mapping of 90,005 keys, expected at most ",
        ),
        (
            BASE.replace("a: {", "".join(f"'#{i}': 1, " for i in range(60_000)) + "a: {"),
            "s.yaml:4:8: types: a mapping of 60,001 keys, expected at most 10,000",
        ),
        (
            BASE + "outputs: {render: {camera: {kind: path, keys: [" + "{at: [1, 2, 3]}, " * 15_000 + "]}}}",
            "s.yaml:7:48: outputs.render.camera.keys[0].seconds: missing, expected a number from 0 to 1000000",
        ),
        (BASE + "name: a\n" * 9_000, "s.yaml:7:1: name: duplicate key, expected it once; it is already in line 2"),
        (BASE + "x: " + "[" * 300_000, "s.yaml:7:68: nested too deeply, expected at most 64 levels"),
        (BASE + "x:\n" + "- !!python/none x\n" * 50_000, "s.yaml:8:3: x[0]: the tag '!!python/none' is not allowed"),
        (BASE + "k" * 900_000, "s.yaml:7:1: broken YAML: 'kkk"),
        (BASE.replace("count: 2", "count: " + "9" * 900_000), "s.yaml:6:20: groups[0].count: is '999"),
        (BASE.replace("count: 2", "count: 1000000000000"), "s.yaml:6:20: groups[0].count: is 1000000000000, expected"),
        (
            BASE.replace("{a: ", "{a: &a {x: &b {}, <<: [" + "*b, " * 200_000 + "]}, b: "),
            "s.yaml:4:799971: the file holds more than 100,000 values",
        ),
        (
            BASE + "events: [{kind: remove, group: group1, when: {kind: seconds, seconds: 1e308}}]",
            "s.yaml:7:71: events[0].when.seconds: is 1e+308, expected a number from 0 to 1000000",
        ),
    ],
)
def test_hostile_scenarios_are_refused_in_little_time(text: str, first: str) -> None:
    found = read(text).splitlines()
    assert found[0].startswith(first), found[0]
    assert len(found) <= 101


def test_a_long_circle_of_types_is_found_in_little_time() -> None:
    found = read(chain(3000, "t2999")).splitlines()
    assert found[0].endswith("-> t2992 -> t2991 -> t2990 -> ... -> t2999"), found[0]
    assert len(found) == 101


def header(shape: str, kind: str = "<f8") -> bytes:
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117).encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


@pytest.mark.parametrize(
    ("name", "content", "what"),
    [
        ("a.npy", header("(1000000000000, 2)") + bytes(64), "claims 1,000,000,000,000 rows, but holds 4, expected a"),
        ("a.npy", header("(-4, 2)") + bytes(64), "claims -4 rows, but holds 4, expected a complete file"),
        ("a.npy", header("(4,)") + bytes(64), "holds an array of shape (4,), expected rows of x, z and perhaps a"),
        ("a.npy", header("(4, 2)", "|O") + bytes(64), "holds object values, expected numbers: rows of x, z and"),
        ("a.npy", b"cos\nsystem\n(S'touch canary'\ntR.", "is no NPY file, expected an array as numpy.save writes it"),
        ("a.npy", b"PK\x03\x04 no archive", "is no NPY file, expected an array as numpy.save writes it"),
        ("a.csv", b"0,0\n1,nan\n", "row 2 is 1, nan, expected finite numbers up to 4000 m"),
        ("a.csv", b"1," * 5_000_000, "line 1: is longer than 1000 characters, expected x, z and perhaps a heading"),
        ("a.csv", b"0,0\n\xff,1\n", "line 1 is no UTF-8, expected a text file"),
        ("a.csv", b"z,x\n0,1\n", "line 1: names its columns z, x, expected x, z and perhaps heading"),
        ("a.csv", b"x,y,z\n0,1,2\n", "line 1: names its columns x, y, z, expected x, z and perhaps heading"),
        ("a.csv", b"0,0\n1,x\n", "line 2: could not convert string 'x' to float64"),
        ("a.csv", b"0,0\n1\n", "line 2: the number of columns changed from 2 to 1"),
        ("a.csv", b"", "0 of 2 avatars fit, for there are 0 points, expected 2 or more"),
    ],
)
def test_hostile_files_of_points_are_refused(folder: Path, name: str, content: bytes, what: str) -> None:
    (folder / name).write_bytes(content)
    found = read(BASE.replace("kind: grid", f"kind: points, file: {name}"))
    assert found.startswith("s.yaml:6:"), found
    assert what in found
    assert not (folder / "canary").exists()


def test_of_files_of_points_only_the_rows_that_are_needed_are_read(folder: Path) -> None:
    np.save(folder / "a.npy", np.asfortranarray(np.arange(30.0).reshape(10, 3)))
    (folder / "a.csv").write_text("x;z\n0;1\n3;4\n" + "6;7\n" * 100_000 + "broken")
    for name, expected in (("a.npy", [[0, 1], [3, 4]]), ("a.csv", [[0, 1], [3, 4]])):
        (folder / "s.yaml").write_text(BASE.replace("kind: grid", f"kind: points, file: {name}"))
        placed = place_groups(load_scenario("s.yaml"))
        np.testing.assert_array_equal(placed[:2].T, expected)


def test_a_name_that_is_too_long_for_a_file_is_a_finding() -> None:
    assert "holds no such file, expected a CSV or NPY file" in read(
        BASE.replace("kind: grid", f"kind: points, file: {'a' * 300}.csv")
    )
