"""What commands need of the system, what they show of text, and how they end when a signal comes."""

import io
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from scenes import crowdsim, write_scene

from crowdsim import assets
from crowdsim.commands import common, process
from crowdsim.runs import status

COMMAND = [sys.executable, "-m", "crowdsim"]
ENVIRONMENT = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
LONG = "n" * 256


def call(*words: str, code: str = "", **named) -> subprocess.CompletedProcess:
    """Run a command in a process of its own, as it is or after some lines of Python."""
    environment = {**ENVIRONMENT, **named.pop("environment", {})}
    command = [sys.executable, "-c", f"{code}\nfrom crowdsim.cli import main; main()"] if code else COMMAND
    return subprocess.run(
        [*command, *words], capture_output=True, text=True, encoding="utf-8", timeout=300, check=False,
        env=environment, **named,
    )  # fmt: skip


def limited(name: str, value: int):
    """What sets a limit of the system in a new process."""
    resource = pytest.importorskip("resource")
    return lambda: resource.setrlimit(getattr(resource, name), (value, value))


@contextmanager
def files_up_to(size: int) -> Iterator[None]:
    """Set the limit of file sizes of this process [bytes]."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    # Python writes a compiled module that is cut off as if it were whole.
    writes, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        sys.dont_write_bytecode = writes


@pytest.fixture
def finished(workplace: Path, finish, capsys) -> Path:
    """A finished run, ``output/four``, in the working folder."""
    write_scene(workplace / "four.yaml")
    finish(workplace, out="output/four")
    capsys.readouterr()
    return workplace / "output" / "four"


def test_the_package_can_be_called_as_a_module() -> None:
    done = call("--version")
    assert (done.returncode, done.stdout.split()[0]) == (0, "crowdsim")


# What the system refuses


def test_an_archive_beyond_the_limit_of_file_sizes_is_a_failure_and_leaves_nothing(finished: Path, capsys) -> None:
    with files_up_to(8192):
        assert crowdsim("pack", finished, "-o", "four.zip") == 1
    assert capsys.readouterr().err == "four.zip: cannot be written: File too large\n"
    assert not [path for path in Path().iterdir() if ".zip" in path.name]


@pytest.mark.parametrize(
    "words", [("render", "--png", "--contact-sheet", "2", "--size", "320x240"), ("inspect", "--plots")]
)
def test_no_picture_that_is_cut_off_has_its_final_name(finished: Path, words: tuple[str, ...], capsys) -> None:
    options = [*words[1:], *(["--out"] if words[0] == "render" else []), "drawn"]
    with files_up_to(4096):
        assert crowdsim(words[0], finished, *options) == 1
    assert capsys.readouterr().err.splitlines()[-1].startswith("drawn/")
    assert not [path for path in Path("drawn").rglob("*") if path.is_file() and path.name != "stage.json"]


@pytest.mark.parametrize(
    "words",
    [("run", LONG), ("validate", LONG), ("verify", LONG), ("render", LONG), ("inspect", LONG), ("train", LONG),
     ("run", "four.yaml", "--out", LONG), ("pack", "output/four", "-o", LONG),
     ("export", "output/four", "--bvh", "--out", LONG), ("perform", "--out", LONG)],
)  # fmt: skip
def test_a_name_too_long_for_a_file_is_invalid_input(finished: Path, words: tuple[str, ...], capsys) -> None:
    assert crowdsim(*words) == 2
    assert "name too long" in capsys.readouterr().err.lower()


def test_a_limit_of_open_files_is_reported_before_anything_is_done(finished: Path) -> None:
    done = call("run", "four.yaml", "--out", "other", preexec_fn=limited("RLIMIT_NOFILE", 20))
    assert done.returncode == 1
    assert done.stderr.startswith("crowdsim: only 1")
    assert done.stderr.endswith(" more files can be open at once, expected at least 64; ulimit -n sets the limit\n")
    assert not Path("other").exists()


START = "_start_joinable_thread" if hasattr(threading, "_start_joinable_thread") else "_start_new_thread"


@pytest.mark.parametrize("allowed", [0, 5])
def test_a_limit_of_threads_is_reported_before_anything_is_done(
    finished: Path, monkeypatch: pytest.MonkeyPatch, capsys, allowed: int
) -> None:
    begin, begun = getattr(threading, START), []

    def start(*values, **named):
        begun.append(1)
        if len(begun) > allowed:
            raise RuntimeError("can't start new thread")
        return begin(*values, **named)

    monkeypatch.setattr(threading, START, start)
    assert crowdsim("run", "four.yaml", "--out", "other") == 1
    expected = f"only {allowed - 1} more threads can be started" if allowed else "no more threads can be started"
    error = capsys.readouterr().err
    assert error.startswith(f"crowdsim: {expected}")
    assert error.endswith("ulimit -u sets the limit\n")
    assert not Path("other").exists()


def test_threads_that_cannot_be_started_in_the_middle_are_reported(
    finished: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    begin, begun = getattr(threading, START), []

    def start(*values, **named):
        begun.append(1)
        if len(begun) > 1:
            raise RuntimeError("can't start new thread")
        return begin(*values, **named)

    monkeypatch.setattr(common, "check_process", lambda: None)
    monkeypatch.setattr(threading, START, start)
    assert crowdsim("verify", str(finished)) == 1
    expected = "crowdsim: no more threads can be started; --threads takes fewer, ulimit -u sets the limit\n"
    assert capsys.readouterr().err == expected


def test_a_working_folder_that_has_been_deleted_is_reported(tmp_path: Path) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    # Python itself fails there where it is to look for modules in other places.
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    for words in (("run", "duel"), ("validate", "duel"), ("verify", "output"), ("status", "output"), ("perform",)):
        done = subprocess.run(
            ["sh", "-c", 'cd "$1"; rmdir "$1"; shift; exec "$@"', "sh", str(gone), *COMMAND, *words],
            capture_output=True, text=True, timeout=300, check=False, env=environment,
        )  # fmt: skip
        expected = "the working folder has been deleted, expected one that exists: cd elsewhere\n"
        assert (done.returncode, done.stderr) == (2, expected)
        gone.mkdir()


@pytest.mark.parametrize("program", ["nowhere/ffmpeg", "plain.txt"])
def test_a_missing_ffmpeg_is_reported_before_anything_is_simulated(
    finished: Path, monkeypatch: pytest.MonkeyPatch, capsys, program: str
) -> None:
    Path("plain.txt").write_text("no program")
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", program)
    write_scene(Path("film.yaml"), name="film", outputs={"render": {"size": [64, 48]}})
    expected = f"no video: {program} is no program that can be run; set IMAGEIO_FFMPEG_EXE to an ffmpeg, or ask for PNG"
    assert crowdsim("run", "film.yaml") == 2
    assert capsys.readouterr().err.splitlines()[-1] == expected
    assert not Path("output/film").exists()
    assert crowdsim("render", str(finished), "--mp4", "--size", "64x48") == 2
    assert capsys.readouterr().err.splitlines()[-1] == expected


# Where text goes


@pytest.mark.parametrize(
    ("closing", "code", "message"),
    [(">&-", 2, "standard output: closed"), ("2>&-", 2, "standard error: closed"), (">&- 2>&-", 2, ""),
     ("<&-", 0, "1 file checked")],
)  # fmt: skip
def test_closed_streams_are_reported_and_no_file_takes_their_place(
    workplace: Path, closing: str, code: int, message: str
) -> None:
    write_scene(workplace / "four.yaml")
    done = subprocess.run(
        ["sh", "-c", f'"$@" {closing}', "sh", *COMMAND, "validate", "four.yaml"],
        capture_output=True, text=True, timeout=300, check=False, env=ENVIRONMENT,
    )  # fmt: skip
    assert done.returncode == code
    assert (done.stdout + done.stderr).startswith(message)
    assert "Traceback" not in done.stdout + done.stderr


UNSHOWN = (("status", "ゆ"), 0), (("verify", "ゆ/ゆ"), 0), (("run", "ゆ/x.yaml"), 2), (("ゆ",), 2)


@pytest.mark.parametrize("encoding", ["cp1252", "ascii"])
def test_output_that_the_terminal_cannot_show_is_escaped(
    finished: Path, monkeypatch: pytest.MonkeyPatch, encoding: str
) -> None:
    shutil.copytree(finished, "ゆ/ゆ")
    for words, code in UNSHOWN:
        shown = io.BytesIO()
        stream = io.TextIOWrapper(shown, encoding)
        with monkeypatch.context() as patch:
            patch.setattr(sys, "stdout", stream)
            patch.setattr(sys, "stderr", stream)
            assert crowdsim(*words) == code
        stream.flush()
        assert b"\\u3086" in shown.getvalue()


def test_output_that_the_locale_of_a_process_cannot_show_is_escaped(finished: Path) -> None:
    shutil.copytree(finished, "ゆ/ゆ")
    for words, code in UNSHOWN:
        done = call(*words, environment={"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"})
        assert (done.returncode, "Traceback" in done.stderr) == (code, False), done.stderr
        assert "\\u3086" in done.stdout + done.stderr or "\\udce3" in done.stdout + done.stderr


@pytest.mark.parametrize("words", [("validate",), ("run",), ("verify",), ("inspect",), ("render",), ()])
def test_control_characters_of_strangers_are_escaped(workplace: Path, words: tuple[str, ...], capsys) -> None:
    assert crowdsim(*words, "a\x1b[31mb\x9b7m\rc\x07\u202e") == 2
    report = capsys.readouterr()
    assert "a\\x1b[31mb\\x9b7m\\rc\\x07\\u202e" in report.err
    assert not set(report.out + report.err) & set("\x1b\x9b\r\x07\u202e")


def test_control_characters_in_files_are_escaped(workplace: Path, capsys) -> None:
    write_scene(workplace / "four.yaml", name="four\x1b[2J")
    (workplace / "keys.yaml").write_text('"a\\e[2J": 1\ngroups: []\n')
    assert crowdsim("validate", "four.yaml", "keys.yaml") == 2
    assert crowdsim("run", "four.yaml", "-v") == 2
    report = capsys.readouterr()
    assert "\\x1b[2J" in report.err
    assert "\x1b" not in report.out + report.err


# Where policies and kernels are kept


NOBODY = """
import os, pwd
def unknown(number): raise KeyError(number)
pwd.getpwuid, may, package = unknown, os.access, {package!r}
os.access = lambda path, mode: not (mode & os.W_OK and str(path).startswith(package)) and may(path, mode)
"""


def test_a_user_without_a_name_or_a_home_needs_none(workplace: Path) -> None:
    """Whatever is compiled or trained goes to a folder of the user's own for temporary files."""
    write_scene(workplace / "four.yaml")
    code = NOBODY.format(package=str(Path(assets.__file__).parent))
    homeless = {key: value for key, value in ENVIRONMENT.items() if key not in ("HOME", "XDG_CACHE_HOME")}
    (workplace / "temporary").mkdir()
    for words in (("--help",), ("validate", "four.yaml"), ("status", "policies")):
        done = subprocess.run(
            [sys.executable, "-c", f"{code}\nfrom crowdsim.cli import main; main()", *words], capture_output=True,
            text=True, timeout=300, check=False, env={**homeless, "TMPDIR": str(workplace / "temporary")},
        )  # fmt: skip
        assert "Traceback" not in done.stderr
        assert done.returncode == (2 if "status" in words else 0), done.stderr
        assert f"kept in {workplace}/temporary/crowdsim-" in done.stderr


def test_a_policy_that_another_user_has_trained_is_found(
    workplace: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    """It lies beside its recipe, where this user may not write; once it is stale it is trained into the cache."""
    may = os.access
    closed = os.fspath(workplace / "policies")
    monkeypatch.setattr(
        os, "access", lambda path, mode: not (mode & os.W_OK and os.fspath(path).startswith(closed)) and may(path, mode)
    )
    monkeypatch.setattr(assets, "_cache", lambda: workplace / "cache")
    write_scene(workplace / "four.yaml")
    assert crowdsim("train", "tiny", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["trained"], found["folder"]) == (False, f"{closed}/tiny")
    assert crowdsim("run", "four.yaml") == 0
    assert "training" not in capsys.readouterr().err
    assert not (workplace / "cache").exists()
    recipe = workplace / "policies" / "tiny.yaml"
    recipe.write_text(recipe.read_text().replace("seconds: 24", "seconds: 25"))
    assert crowdsim("train", "tiny", "--json") == 0
    again = json.loads(capsys.readouterr().out)
    assert (again["trained"], again["folder"]) == (True, f"{workplace}/cache/tiny")
    assert assets.find_bundle("tiny") == workplace / "cache" / "tiny"


# Signals

STUCK = """
import ctypes, subprocess, sys
once, mutex, system = [1], ctypes.create_string_buffer(256), ctypes.CDLL(None)
def for_long(*_, **__):
    if once and once.pop():
        child = subprocess.Popen(["sleep", "300"], start_new_session=True)
        print("begun", child.pid, file=sys.stderr, flush=True)
    for _ in range(2):
        system.pthread_mutex_lock(mutex)
"""
POSING = "import crowdsim.poses.sampler as poses; poses.PoseSampler.sample = for_long"
MEASURING = "import crowdsim.take.quality as quality; quality.measure_take = for_long"
ENCODING = "import crowdsim.render.stage as stage; stage.Stage.picture = for_long"


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
@pytest.mark.parametrize(
    ("stretch", "words"),
    [(POSING, ("export", "four.zip", "--bvh", "--out", "motion")), (MEASURING, ("inspect", "four.zip")),
     (ENCODING, ("render", "four.zip", "--mp4", "--size", "64x48", "--out", "film"))],
    ids=["export", "inspect", "render"],
)  # fmt: skip
def test_a_signal_ends_a_command_in_the_middle_of_a_long_stretch(
    finished: Path, number: int, code: int, stretch: str, words: tuple[str, ...]
) -> None:
    """The stretch never ends, in compiled code of the main thread or of another one, which waits for itself."""
    assert crowdsim("pack", str(finished), "-o", "four.zip") == 0
    Path("temporary").mkdir()
    with open("said", "w") as said:
        running = subprocess.Popen(
            [sys.executable, "-c", f"{STUCK}{stretch}\nfrom crowdsim.cli import main; main()", *words],
            stderr=said, env={**ENVIRONMENT, "TMPDIR": os.path.abspath("temporary")},
        )  # fmt: skip
    try:
        while not (begun := re.search(r"^begun (\d+)$", Path("said").read_text(), re.MULTILINE)):
            assert running.poll() is None, Path("said").read_text()
            time.sleep(0.05)
        running.send_signal(number)
        sent = time.monotonic()
        assert running.wait(timeout=120) == code
        assert time.monotonic() - sent < 30.0
    finally:
        running.kill()
        running.wait()
    report = Path("said").read_text()
    assert {130: "interrupted\n", 143: "terminated\n"}[code] in report or "stopped in the middle" in report
    assert "Traceback" not in report
    child = Path(f"/proc/{begun[1]}/status")
    deadline = time.monotonic() + 30.0
    while child.exists() and "(zombie)" not in child.read_text():
        assert time.monotonic() < deadline, "a process that the command started goes on"
        time.sleep(0.05)
    assert not [path.name for path in Path("temporary").iterdir() if path.name.startswith("crowdsim-")]
    assert not Path("motion/bvh").exists()
    assert not Path("film/video.mp4").exists()


def test_a_process_that_goes_on_after_an_interrupted_command_is_left_alone(
    finished: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    ended: list[int] = []
    monkeypatch.setattr(process, "GRACE", 0.2)
    monkeypatch.setattr(process, "_leave", ended.append)
    monkeypatch.setattr(status, "describe_run", lambda _: signal.raise_signal(signal.SIGINT))
    assert crowdsim("status", str(finished)) == 130
    assert capsys.readouterr().err == "interrupted\n"
    for thread in threading.enumerate():
        if thread.name == "signals":
            thread.join()
    assert ended == []
