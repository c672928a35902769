"""The lock of a run folder names its owner, and a stale one blocks no command."""

import json
import os
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

import pytest
from scenes import crowdsim, write_scene

from crowdsim.errors import OutputError
from crowdsim.runs import lock
from crowdsim.runs.lock import NAME, find_owner, hold_folder, this_owner


def leave(folder: Path, owner: lock.Owner) -> None:
    """Leave a lock as another process would."""
    folder.mkdir(exist_ok=True)
    (folder / NAME).write_text(json.dumps({"format": lock.FORMAT, **asdict(owner)}))


def a_dead_process() -> int:
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


HERE = this_owner("crowdsim run brawl")
DEAD = replace(HERE, pid=a_dead_process(), started=1.0)
AWAY = replace(HERE, host="node17")


def test_a_held_folder_names_its_owner_and_is_free_afterwards(tmp_path: Path) -> None:
    with hold_folder(tmp_path, "crowdsim run brawl"):
        owner = find_owner(tmp_path)
        assert owner is not None
        assert (owner.pid, owner.command) == (os.getpid(), "crowdsim run brawl")
        assert str(owner) == f"process {os.getpid()} on {owner.host} since {owner.since} (crowdsim run brawl)"
        with pytest.raises(OutputError, match=f"is in use by process {os.getpid()} on "), hold_folder(tmp_path):
            pass
    assert find_owner(tmp_path) is None
    assert list(tmp_path.iterdir()) == []


def without_locks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the system have no locks on folders."""
    import fcntl

    def refuse(*_: int) -> None:
        raise OSError("no locks available")

    monkeypatch.setattr(fcntl, "flock", refuse)


@pytest.mark.parametrize(
    "owner",
    [DEAD, replace(HERE, started=1.0)],
    ids=["a process that was killed", "another process of this number"],
)
@pytest.mark.parametrize("decides", [True, False], ids=["local", "a file system without locks"])
def test_stale_locks_are_taken_over(tmp_path: Path, monkeypatch, owner: lock.Owner, decides: bool) -> None:
    if not decides:
        without_locks(monkeypatch)
    leave(tmp_path, owner)
    assert find_owner(tmp_path) is None
    with hold_folder(tmp_path):
        now = find_owner(tmp_path)
        assert now is not None
        assert now.pid == os.getpid()
    assert list(tmp_path.iterdir()) == []


def test_the_systems_lock_decides_about_an_owner_on_another_machine(tmp_path: Path, monkeypatch) -> None:
    leave(tmp_path, AWAY)
    assert find_owner(tmp_path) is None
    with hold_folder(tmp_path):
        leave(tmp_path, AWAY)
        assert find_owner(tmp_path) == AWAY
        with pytest.raises(OutputError, match=r"is in use by process \d+ on node17 since "), hold_folder(tmp_path):
            pass
    leave(tmp_path, AWAY)
    without_locks(monkeypatch)
    assert find_owner(tmp_path) == AWAY


def test_where_the_system_has_no_locks_the_process_is_looked_for(tmp_path: Path, monkeypatch) -> None:
    without_locks(monkeypatch)
    leave(tmp_path, HERE)
    with pytest.raises(OutputError, match="is in use by process"), hold_folder(tmp_path):
        pass


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"format": "crowdsim-lock"}', '{"format": "crowdsim-lock", "pid": "x"}']
)
def test_a_damaged_lock_names_nobody(tmp_path: Path, text: str) -> None:
    (tmp_path / NAME).write_text(text)
    assert find_owner(tmp_path) is None
    with hold_folder(tmp_path):
        assert find_owner(tmp_path) is not None


def test_a_lock_that_is_a_link_is_neither_read_nor_followed(tmp_path: Path) -> None:
    leave(tmp_path / "elsewhere", HERE)
    before = (tmp_path / "elsewhere" / NAME).read_text()
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / NAME).symlink_to(tmp_path / "elsewhere" / NAME)
    assert find_owner(tmp_path / "run") is None
    with hold_folder(tmp_path / "run"):
        pass
    assert (tmp_path / "elsewhere" / NAME).read_text() == before


def test_exports_and_status_know_who_is_at_work(workplace: Path, capsys) -> None:
    write_scene(workplace / "four.yaml")
    assert crowdsim("run", "four.yaml") == 0
    folder = workplace / "output" / "four"
    with hold_folder(folder, "crowdsim run brawl"):
        capsys.readouterr()
        assert crowdsim("export", "output/four", "--bvh") == 2
        assert "output/four: is in use by process" in capsys.readouterr().err
        assert crowdsim("status", "output/four", "--json") == 0
        assert json.loads(capsys.readouterr().out)["output/four"]["owner"]["pid"] == os.getpid()
        assert crowdsim("status", "output/four") == 0
        assert f"process {os.getpid()} on {HERE.host} since " in capsys.readouterr().out
    assert crowdsim("export", "output/four", "--bvh") == 0
    assert not (folder / NAME).exists()
