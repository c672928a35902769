"""The lock of a run folder names its owner, and a stale one blocks no command."""

import json
import os
import subprocess
import sys
import time
from dataclasses import asdict, replace
from pathlib import Path

import pytest
from scenes import crowdsim, write_scene

from crowdsim.errors import OutputError
from crowdsim.runs import lock
from crowdsim.runs.lock import NAME, SILENCE, find_owner, hold_folder, read_owner, this_owner


def leave(folder: Path, owner: lock.Owner, age: float = 0.0) -> None:
    """Leave a lock as another process would."""
    folder.mkdir(exist_ok=True)
    (folder / NAME).write_text(json.dumps({"format": lock.FORMAT, **asdict(owner)}))
    os.utime(folder / NAME, (time.time() - age,) * 2)


def a_dead_process() -> int:
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


HERE = this_owner("crowdsim run brawl")
DEAD = replace(HERE, pid=a_dead_process(), started=1.0)
AWAY = replace(HERE, host="node17", machine="17", boot="b17")


def test_a_held_folder_names_its_owner_and_is_free_afterwards(tmp_path: Path) -> None:
    with hold_folder(tmp_path, "crowdsim run brawl") as before:
        assert before is None
        owner = find_owner(tmp_path)
        assert owner is not None
        assert (owner.pid, owner.command) == (os.getpid(), "crowdsim run brawl")
        assert str(owner) == f"process {os.getpid()} on {owner.host} since {owner.since} (crowdsim run brawl)"
        with pytest.raises(OutputError, match=f"is in use by process {os.getpid()} on "), hold_folder(tmp_path):
            pass
    assert find_owner(tmp_path) is None
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("owner", "age"),
    [
        (DEAD, 0.0),
        (replace(HERE, started=1.0), 0.0),
        (replace(HERE, boot="before"), 0.0),
        (AWAY, SILENCE + 1),
    ],
    ids=["a process that was killed", "another process of this number", "before a reboot", "silent on another machine"],
)
@pytest.mark.parametrize("decides", [True, False], ids=["local", "a file system without locks"])
def test_stale_locks_are_taken_over(tmp_path: Path, monkeypatch, owner: lock.Owner, age: float, decides: bool) -> None:
    if not decides:
        import fcntl

        def refuse(*_: int) -> None:
            raise OSError("no locks available")

        monkeypatch.setattr(fcntl, "flock", refuse)
    leave(tmp_path, owner, age)
    assert find_owner(tmp_path) is None
    with hold_folder(tmp_path) as before:
        assert before == owner
        now = read_owner(tmp_path)
        assert now is not None
        assert now.pid == os.getpid()
        assert lock.rebooted(owner) == (owner.boot != HERE.boot)
    assert list(tmp_path.iterdir()) == []


def test_a_lock_of_another_machine_that_shows_signs_of_life_is_respected(tmp_path: Path) -> None:
    leave(tmp_path, AWAY, SILENCE / 2)
    assert find_owner(tmp_path) == AWAY
    message = (
        r"is in use by process \d+ on node17 since .* after 60 s without a sign of life from node17 the folder is free"
    )
    with pytest.raises(OutputError, match=message), hold_folder(tmp_path):
        pass
    assert read_owner(tmp_path) == AWAY


def test_where_the_system_has_no_locks_the_process_is_looked_for(tmp_path: Path, monkeypatch) -> None:
    import fcntl

    def refuse(*_: int) -> None:
        raise OSError("no locks available")

    monkeypatch.setattr(fcntl, "flock", refuse)
    leave(tmp_path, HERE)
    with pytest.raises(OutputError, match="is in use by process"), hold_folder(tmp_path):
        pass


def test_the_owner_renews_the_lock(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(lock, "BEAT", 0.01)
    with hold_folder(tmp_path):
        os.utime(tmp_path / NAME, (1.0, 1.0))
        for _ in range(500):
            if (tmp_path / NAME).stat().st_mtime > 1.0:
                break
            time.sleep(0.01)
        assert (tmp_path / NAME).stat().st_mtime > 1.0


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"format": "crowdsim-lock"}', '{"format": "crowdsim-lock", "pid": "x"}']
)
def test_a_damaged_lock_names_nobody(tmp_path: Path, text: str) -> None:
    (tmp_path / NAME).write_text(text)
    assert read_owner(tmp_path) is None
    with hold_folder(tmp_path) as before:
        assert before is None


def test_exports_and_status_know_who_is_at_work(workplace: Path, capsys) -> None:
    write_scene(workplace / "four.yaml")
    assert crowdsim("run", "four.yaml") == 0
    folder = workplace / "output" / "four"
    leave(folder, AWAY)
    capsys.readouterr()
    assert crowdsim("export", "output/four", "--bvh") == 2
    assert "output/four: is in use by process" in capsys.readouterr().err
    assert crowdsim("status", "output/four", "--json") == 0
    assert json.loads(capsys.readouterr().out)["output/four"]["owner"]["host"] == "node17"
    assert crowdsim("status", "output/four") == 0
    assert f"process {AWAY.pid} on node17 since {AWAY.since} (crowdsim run brawl)" in capsys.readouterr().out
    leave(folder, AWAY, SILENCE + 1)
    assert crowdsim("export", "output/four", "--bvh") == 0
    assert not (folder / NAME).exists()
