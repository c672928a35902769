"""`crowdsim inspect FILE.bvh`: exit codes, one JSON document on standard output, findings on standard error."""

from __future__ import annotations

import json
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

import pytest
from people import placed, together
from scenes import crowdsim

from crowdsim.bvh.io import write_bvh
from crowdsim.performer.session import perform, write_performance


@pytest.fixture(scope="module")
def clip(tmp_path_factory) -> Path:
    return write_performance(tmp_path_factory.mktemp("capture"), 4.0, 3)[0]


def _inspect(*words: object) -> subprocess.CompletedProcess[str]:
    """Run the command in this process."""
    said, wrong = StringIO(), StringIO()
    with redirect_stdout(said), redirect_stderr(wrong):
        code = crowdsim("inspect", *map(str, words))
    return subprocess.CompletedProcess(words, code, said.getvalue(), wrong.getvalue())


def test_json_is_the_whole_of_standard_output(clip):
    command = [sys.executable, "-c", "from crowdsim.cli import main; main()", "inspect", str(clip), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert (report["joints"], report["frames"], report["fps"]) == (22, 240, 60.0)
    assert report["unit_scale"] == 0.01
    assert report["up_axis"] == "y"
    assert report["findings"] == []
    assert done.stderr == ""


def test_text_is_for_people(clip):
    done = _inspect(clip)
    assert done.returncode == 0
    lines = done.stdout.splitlines()
    assert lines[0] == str(clip)
    assert lines[1:3] == ["  File", "    skeleton  22 joints, 5 end sites, 69 channels"]
    assert "    left_hand       LeftHand" in lines
    assert "    unit      0.01 m" in lines
    assert any(line.startswith("    fastest fist") and line.endswith(" m/s") for line in lines)
    assert done.stderr == ""


def test_wrong_numbers_go_to_standard_error_with_their_line_and_exit_two(clip, tmp_path):
    path = tmp_path / "odd.bvh"
    path.write_bytes(clip.read_bytes().replace(b"Frames: 240", b"Frames: 250"))
    done = _inspect(path)
    assert done.returncode == 2
    assert done.stderr == f"{path}:133:9: 240 rows of motion, Frames: says 250\n"
    report = json.loads(_inspect(path, "--json").stdout)
    assert report["frames"] == 240
    assert report["findings"] == ["line 133, column 9: 240 rows of motion, Frames: says 250"]


@pytest.mark.parametrize("text", ["", "not a capture\n", "HIERARCHY\nROOT a\n{\nOFFSET 0 0 zero\n"])
def test_what_is_no_bvh_exits_two_with_file_and_line(tmp_path, text):
    path = tmp_path / "other.bvh"
    path.write_text(text)
    done = _inspect(path, "--json")
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith(f"{path}:")
    assert "Traceback" not in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_missing_file_exits_two(tmp_path):
    done = _inspect(tmp_path / "none.bvh")
    assert done.returncode == 2
    assert "none.bvh" in done.stderr
    assert "Traceback" not in done.stderr


def test_an_unknown_unit_or_axis_exits_two_with_the_choices(clip):
    done = _inspect(clip, "--unit", "foot")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "unit 'foot' is unknown; expected m, dm, cm, mm, inch, cmu or metres as a number\n"
    assert _inspect(clip, "--up", "up").returncode == 2


def test_pictures_are_written_to_the_given_folder_beside_json(clip, tmp_path):
    done = _inspect(clip, "--json", "--plots", tmp_path / "a" / "b")
    assert done.returncode == 0
    json.loads(done.stdout)
    written = sorted((tmp_path / "a" / "b").glob("*.png"))
    assert [path.name for path in written] == [
        f"{clip.stem}_{part}.png" for part in ("figures", "path", "skeleton", "time")
    ]
    assert sorted(done.stderr.split()) == [str(path) for path in written]


def test_a_file_where_the_folder_of_pictures_should_be_exits_two(clip, tmp_path):
    (tmp_path / "plots").write_text("")
    done = _inspect(clip, "--plots", tmp_path / "plots")
    assert done.returncode == 2
    assert "is a file, expected a folder to write into" in done.stderr


def test_people_of_one_file_are_described_one_by_one_with_what_becomes_of_their_strikes(tmp_path):
    motion = perform(4.0, 3)[0].clip
    path = tmp_path / "pair.bvh"
    write_bvh(path, together([motion, placed(motion, 0.0, 1.0, 3.14159)], ["Red_", "Blue_"]))
    done = _inspect(path)
    assert done.returncode == 0, done.stderr
    assert f"{path}#1" in done.stdout.splitlines()
    assert f"{path}#2" in done.stdout.splitlines()
    assert f"{path}#2:" in done.stderr
    assert "  Between people" in done.stdout.splitlines()
    report = json.loads(_inspect(path, "--json").stdout)
    assert [one["joints"] for one in report["people"]] == [22, 22]
    assert len(report["encounters"]) == sum(one["strikes"] for one in report["people"]) > 0
    assert {one["attacker"] for one in report["encounters"]} == {"pair#1", "pair#2"}
    assert json.loads(_inspect(f"{path}#2", "--json").stdout) == report["people"][1]
    assert _inspect(f"{path}#3").returncode != 0
    assert "draws one person, expected" in _inspect(path, "--plots", tmp_path / "plots").stderr
