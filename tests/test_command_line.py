"""What all commands have in common: help, verbosity, JSON, completion, exit codes."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from scenes import crowdsim, write_scene

from crowdsim import cli

COMMANDS = [
    "perform",
    "inspect",
    "train",
    "run",
    "export",
    "render",
    "view",
    "report",
    "profile",
    "validate",
    "schema",
    "verify",
    "status",
]
PROGRAM = "from crowdsim.cli import main; main()"
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
TYPES = r"(?i)<[a-z]|\b(str|int|float|bool|path|list|text|integer|filename)\b\s*(\]|>|range|\.\.\.|\s\s)|\[(str|list)"


@pytest.mark.parametrize("command", [None, *COMMANDS])
def test_help_has_no_python_types_and_states_the_exit_codes(command, capsys) -> None:
    assert crowdsim(*filter(None, [command]), "--help") == 0
    report = capsys.readouterr().out
    assert not re.search(TYPES, report), report
    assert "{" not in report
    codes = " ".join(report.split()).partition("Exit codes: ")[2]
    assert codes == "0 done, 1 a run failed, 2 invalid input, 130 interrupted, 143 terminated."
    if command is not None:
        assert "--quiet" in report
        assert "--verbose" in report


def test_the_documentation_states_the_exit_codes() -> None:
    text = (Path(__file__).parents[1] / "docs" / "commands.md").read_text(encoding="utf-8")
    for code, words in (
        (0, "done"),
        (1, "a run failed"),
        (2, "invalid input"),
        (130, "interrupted"),
        (143, "terminated"),
    ):
        assert f"| {code} | {words}" in text


@pytest.mark.parametrize(
    ("words", "expected"),
    [("crowdsim ru", "run"), ("crowdsim run brawl_30_", "brawl_30_cmu"), ("crowdsim train boxer_pa", "boxer_paper"),
     ("crowdsim validate arm", "armies_200"), ("crowdsim profile --avat", "--avatars")],
)  # fmt: skip
def test_shells_complete_commands_options_and_names(tmp_path, words, expected) -> None:
    settings = {"_CROWDSIM_COMPLETE": "complete_bash", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    program = f"import sys; sys.argv[0] = 'crowdsim'; {PROGRAM}; "
    done = subprocess.run(
        [sys.executable, "-c", program], env={**ENVIRONMENT, **settings}, cwd=tmp_path, capture_output=True, text=True,
        timeout=60, check=False,
    )  # fmt: skip
    assert done.stdout.split() == [expected], done.stderr


def test_json_is_the_whole_of_standard_output(workplace: Path, capsys) -> None:
    write_scene(workplace / "four.yaml", outputs={"bvh": {"fps": 30}})
    write_scene(workplace / "bad.yaml", duration=0)

    def report(code: int, *arguments: str) -> dict:
        assert crowdsim(*arguments, "--json") == code
        return json.loads(capsys.readouterr().out)

    trained = report(0, "train", "tiny")
    assert (trained["policy"], trained["trained"], len(trained["fingerprint"])) == ("tiny", False, 64)
    (run,) = report(0, "run", "four.yaml")["runs"]
    assert (run["state"], run["avatars"], run["control_frames"], run["seed"]) == ("done", 4, 40, 5)
    assert run["outputs"]["bvh"]["files"] == 5
    assert run["statistics"]["strikes_thrown"] >= 0
    assert run["seconds"]["control"] > 0
    (again,) = report(0, "run", "four.yaml")["runs"]
    assert again["state"] == "done before"
    assert again["seconds"] == run["seconds"]
    first, second = report(1, "run", "four.yaml", "bad.yaml")["runs"]
    assert (first["state"], second["state"]) == ("done before", "failed")
    assert second["error"].startswith("bad.yaml:4:11: duration: is 0")
    intact = report(0, "verify", "output/four")
    assert (intact["intact"], intact["findings"], intact["foreign"]) == (True, [], [])
    assert intact["files"] > 4
    (workplace / "output/four/bvh/red_0.bvh").write_text("")
    changed = report(1, "verify", "output/four")
    assert changed["intact"] is False
    assert changed["findings"][0].startswith("output/four/bvh/red_0.bvh: has 0 bytes")


def test_quiet_commands_print_only_errors(workplace: Path, capsys) -> None:
    write_scene(workplace / "four.yaml", outputs={"bvh": {"fps": 30}})
    write_scene(workplace / "bad.yaml", duration=0)
    for arguments in (
        ("train", "tiny"), ("validate", "four.yaml"), ("run", "four.yaml"), ("verify", "output/four"),
        ("export", "output/four", "--bvh", "--out", "again"),
        ("perform", "--seconds", "2", "--out", "clips"),
    ):  # fmt: skip
        assert crowdsim(*arguments, "--quiet") == 0
        assert capsys.readouterr() == ("", ""), arguments
    assert crowdsim("validate", "bad.yaml", "-q") == 2
    assert capsys.readouterr().err.startswith("bad.yaml:4:11: duration: is 0")
    assert crowdsim("verify", "output/four") == 0
    assert capsys.readouterr().out.startswith("output/four: ")


def test_verbose_commands_print_more_and_tracebacks(workplace: Path, capsys) -> None:
    write_scene(workplace / "four.yaml")
    assert crowdsim("run", "four.yaml", "-v") == 0
    assert "four: 4 avatars, " in capsys.readouterr().err
    assert crowdsim("verify", "nowhere") == 2
    assert "Traceback" not in capsys.readouterr().err
    assert crowdsim("verify", "nowhere", "-v") == 2
    report = capsys.readouterr().err
    assert "Traceback" in report
    assert report.splitlines()[-1].startswith("nowhere: ")


def test_frames_may_be_given_in_seconds_on_the_command_line(workplace: Path, capsys) -> None:
    write_scene(workplace / "four.yaml")
    assert crowdsim("run", "four.yaml", "--frames", "4s") == 0
    assert "control frames  60 (4.0 s)" in capsys.readouterr().out
    for words, frames in (("1s:2s", 60), ("30:1s", 30), ("3.9s:4s", 6)):
        assert (
            crowdsim("export", "output/four", "--bvh", "--frames", words, "--avatars", "0", "--out", "part", "--force")
            == 0
        )
        assert f"Frames: {frames}\n" in (workplace / "part/bvh/red_0.bvh").read_text()
    capsys.readouterr()
    assert crowdsim("export", "output/four", "--bvh", "--frames", "3s:5s") == 2
    assert capsys.readouterr().err == "frames '3s:5s': there are frames 0 to 239 at 60 fps, 4 s\n"
    command = ("render", "output/four", "--png", "--size", "64x48", "--fps", "10", "--out", "seen")
    assert crowdsim(*command, "--frames", "1s:1.5s") == 0
    assert len(list((workplace / "seen" / "frames").iterdir())) == 5
    capsys.readouterr()
    for command in ("run", "profile"):
        assert crowdsim(command, "four.yaml", "--frames", "many") == 2
        assert capsys.readouterr().err == (
            "frames 'many': expected a whole number of frames from 1, or seconds as in 20s\n"
        )


def test_an_interrupted_command_exits_130_and_a_terminated_one_143(workplace: Path) -> None:
    for number, code in ((signal.SIGINT, 130), (signal.SIGTERM, 143)):
        process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, "perform", "--seconds", "80000", "-o", "clips"], cwd=workplace,
            env=ENVIRONMENT, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        while not (workplace / "clips").exists():
            assert process.poll() is None
            time.sleep(0.05)
        process.send_signal(number)
        _, error = process.communicate(timeout=60)
        assert process.returncode == code, error
        assert "Traceback" not in error
        # On a busy machine a clip may be whole by then; none is half-written.
        assert all(path.suffix == ".bvh" for path in (workplace / "clips").iterdir())
        shutil.rmtree(workplace / "clips")


@pytest.mark.parametrize(("raised", "code"), [(SystemExit(143), 143), (KeyboardInterrupt(), 130)])
def test_a_signal_that_comes_while_a_class_is_made_sets_the_exit_code(
    monkeypatch: pytest.MonkeyPatch, raised: BaseException, code: int
) -> None:
    def interrupted(**_: object) -> None:
        raise RuntimeError("Error calling __set_name__") from raised

    monkeypatch.setattr(cli, "app", interrupted)
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    with pytest.raises(SystemExit) as found:
        cli.main()
    assert found.value.code == code


def test_progress_of_a_run_is_a_line_a_stage_without_a_terminal(workplace: Path) -> None:
    write_scene(workplace / "four.yaml", outputs={"bvh": {"fps": 30}})
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, "run", "four.yaml"], cwd=workplace, env={**ENVIRONMENT, "COLUMNS": "20"},
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    stages = [re.sub(r"\d+\.\d s$", "T", line) for line in done.stderr.splitlines() if not line.startswith("compiling")]
    assert stages == ["control: 40 of 40, T", "bvh: 4 of 4, T", "checksums: T"]
