"""The cache of kernels may be damaged or removed at any time: they are compiled again, and one note says so."""

import errno
import fcntl
import importlib
import os
import pickle
import shutil
import signal
import stat
import subprocess
import sys
import time
import warnings
from pathlib import Path

import pytest
from scenes import write_scene

from crowdsim.jit import cache, folders, store
from crowdsim.jit.ahead import _is_compiled
from crowdsim.jit.environment import cache_limit, foreign_access
from crowdsim.jit.signatures import listed

SOURCE = """from crowdsim.jit import kernel


@kernel
def leaf(x):
    return x + 1


@kernel
def twice(x):
    return 2 * leaf(x)


@kernel
def thrice(x):
    return 3 * x
"""
LEAF, OTHER = "old-0123456789abcdef", "crowd_0123456789ab"


@pytest.fixture
def base(tmp_path, monkeypatch):
    """The folder of kernels of a test alone."""
    from numba import config

    # Numba reads its settings again when variables of the environment have changed, as by a test before this one.
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kernels"))
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "kernels"))
    monkeypatch.setattr(cache._Cache, "room", 0)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "adding.py").write_text(SOURCE)
    return tmp_path / "kernels"


@pytest.fixture
def call(base, monkeypatch):
    """Call a kernel with 1 as a new process does: what it returns, notes, and whether it was loaded."""

    def call(name="twice"):
        monkeypatch.setattr(store, "_reported", [])
        monkeypatch.delitem(sys.modules, "adding", raising=False)
        kernel = getattr(importlib.import_module("adding"), name)
        with warnings.catch_warnings(record=True) as notes:
            warnings.simplefilter("always")
            result = kernel(1)
        return result, [str(note.message) for note in notes], bool(kernel.stats.cache_hits)

    return call


def files(base, pattern="*.nbc"):
    return sorted(base.rglob(pattern))


def file_of(base, name="twice"):
    """The file of what Python calls."""
    (path,) = [path for path in files(base, f"{name}.*.nbc") if ".part." not in path.name]
    return path


def flip(path, place):
    data = bytearray(path.read_bytes())
    data[int(place * len(data))] ^= 4
    path.write_bytes(data)


def make_folder(path):
    path.unlink()
    path.mkdir()
    (path / "file").write_text("in the way")


def make_pipe(path):
    path.unlink()
    os.mkfifo(path)


def make_link(path):
    shutil.move(path, path.with_suffix(".moved"))
    path.symlink_to(path.with_suffix(".moved"))


def make_dangling_link(path):
    path.unlink()
    path.symlink_to("nowhere")


def make_file_of_the_folder(path):
    shutil.rmtree(path.parent)
    path.parent.write_text("in the way")


def take_that_of_another_kernel(path):
    shutil.copy(file_of(path.parent, "thrice"), path)


def take_that_of_a_part(path):
    shutil.copy(next(path.parent.glob("leaf.part.*.nbc")), path)


DAMAGE = {
    "empty": lambda path: path.write_bytes(b""),
    "cut to half": lambda path: os.truncate(path, path.stat().st_size // 2),
    "cut to its checksum": lambda path: os.truncate(path, 32),
    "without its last byte": lambda path: os.truncate(path, path.stat().st_size - 1),
    "longer by a byte": lambda path: path.write_bytes(path.read_bytes() + b"\0"),
    "of 10 GB": lambda path: os.truncate(path, 10**10),
    "a bit flipped in the checksum": lambda path: flip(path, 0),
    "a bit flipped in the middle": lambda path: flip(path, 0.5),
    "a bit flipped at the end": lambda path: flip(path, 0.9999),
    "a folder": make_folder,
    "a pipe": make_pipe,
    "a link": make_link,
    "a link to nowhere": make_dangling_link,
    "its folder a file": make_file_of_the_folder,
    "that of another kernel": take_that_of_another_kernel,
    "that of a part": take_that_of_a_part,
    "writable by others": lambda path: path.chmod(0o666),
    "another class, checksum right": lambda path: store.write_entry(path, pickle.dumps(Path("x"))),
    "an unknown class, checksum right": lambda path: store.write_entry(path, b"cnowhere\nThing\n."),
    "no pickle, checksum right": lambda path: store.write_entry(path, b"kernel"),
}


def test_a_process_that_finds_its_kernels_compiled_loads_no_declarations(base, tmp_path):
    code = "import adding, sys; adding.twice(1); print('numba.cpython.numbers' in sys.modules)"
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    loaded = [
        subprocess.run(
            [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True, timeout=300
        ).stdout.strip()
        for _ in range(2)
    ]
    assert loaded == ["True", "False"]


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_a_damaged_file_is_noted_compiled_again_and_replaced(damage, call, base):
    assert [call(name) for name in ("twice", "thrice")] == [(4, [], False), (3, [], False)]
    path = file_of(base)
    damage(path)
    result, notes, loaded = call()
    assert (result, len(notes), loaded) == (4, 1, False)
    assert str(path.parent) in notes[0]
    assert notes[0].endswith(" compiled again")
    assert call() == (4, [], True)


@pytest.mark.parametrize("damage", ["a bit flipped in the middle", "cut to half", "a folder"])
def test_a_damaged_part_is_noted_compiled_again_and_replaced(damage, call, base):
    call()
    (part,) = files(base, "leaf.part.*.nbc")
    file_of(base).unlink()
    DAMAGE[damage](part)
    result, notes, _ = call()
    assert (result, len(notes)) == (4, 1)
    assert str(part) in notes[0]
    assert call() == (4, [], True)


def test_several_damaged_files_are_noted_once(call, base):
    call()
    for path in files(base):
        flip(path, 0.5)
    result, notes, _ = call()
    assert (result, len(notes)) == (4, 1)
    assert call() == (4, [], True)


def test_a_note_says_what_is_wrong_and_what_was_expected(call, base):
    call()
    path = file_of(base)
    os.truncate(path, 10)
    assert call()[1] == [
        f"{path}: has 10 bytes, expected more than 32 and at most 67108864; the kernel is compiled again"
    ]
    path.chmod(0o664)
    assert call()[1] == [
        f"{path}: has mode 664, expected one in which others may not write; the kernel is compiled again"
    ]
    flip(path, 0.5)
    assert call()[1] == [f"{path}: does not have the checksum that it was written with; the kernel is compiled again"]
    make_folder(path)
    assert call()[1] == [f"{path}: is no regular file; the kernel is compiled again"]


class Attack:
    """An object that writes a file where it is unpickled."""

    def __init__(self, victim):
        self.victim = victim

    def __reduce__(self):
        return Path.write_text, (self.victim, "executed")


def test_nothing_is_unpickled_before_the_checksum_is_right(call, base, tmp_path):
    call()
    path, victim, attack = file_of(base), tmp_path / "victim", pickle.dumps(Attack(tmp_path / "victim"))
    sound = path.read_bytes()
    for content in (attack, sound[:32] + attack, bytes(32) + attack):
        path.write_bytes(content)
        assert call()[0] == 4
        assert not victim.exists()
    # With a checksum that is right it would be: that is why nobody else may write there.
    store.write_entry(path, attack)
    assert call()[0] == 4
    assert victim.read_text() == "executed"


def test_a_file_is_not_read_before_its_size_is_known(call, base, monkeypatch):
    call()
    os.truncate(file_of(base), 10**10)
    read = os.read

    def bounded(number, size):
        assert size <= store.MOST
        return read(number, size)

    monkeypatch.setattr(os, "read", bounded)
    assert call()[0] == 4


@pytest.mark.parametrize("levels", [0, 1, 2])
def test_a_folder_that_others_may_write_is_not_used(levels, call, base):
    call()
    places = [file_of(base).parent, file_of(base).parent.parent, base]
    before = {path: path.read_bytes() for path in files(base, "*.*")}
    for mode in (0o777, 0o775, 0o757):
        places[levels].chmod(mode)
        assert call() == (
            4,
            [
                f"compiled kernels are not kept in {places[0]}: {places[levels]} has mode {mode:o}, expected one in "
                "which others may not write; use chmod go-w or chown there, or set NUMBA_CACHE_DIR to another folder"
            ],
            False,
        )
    assert {path: path.read_bytes() for path in files(base, "*.*")} == before
    places[levels].chmod(0o755)
    assert call() == (4, [], True)


def test_nothing_is_compiled_ahead_for_a_folder_that_others_may_write(base):
    entry = listed()[0]
    assert not _is_compiled(entry)
    base.mkdir()
    base.chmod(0o777)
    assert _is_compiled(entry)


def test_kernels_are_kept_in_a_folder_for_temporary_files_of_all(call, base):
    base.mkdir()
    base.chmod(0o1777)
    assert call() == (4, [], False)
    assert call() == (4, [], True)


def test_files_and_folders_that_belong_to_others_are_those_of_neither_the_user_nor_root(monkeypatch):
    monkeypatch.setattr(os, "geteuid", lambda: 1000)

    def access(mode, user):
        return foreign_access(os.stat_result((mode, 0, 0, 1, user, 1000, 0, 0, 0, 0)))

    assert access(0o755, 1000) == access(0o755, 0) == access(0o600, 1000) == ""
    assert access(0o755, 1001) == "belongs to user 1001, expected user 1000 or root"
    assert access(0o775, 1000) == "has mode 775, expected one in which others may not write"
    assert access(0o702, 0) == "has mode 702, expected one in which others may not write"


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can give files away")
def test_a_folder_and_a_file_of_another_user_are_not_used(call, base):
    call()
    path = file_of(base)
    os.chown(path.parent, 12345, -1)
    result, notes, loaded = call()
    assert (result, loaded) == (4, False)
    assert f"{path.parent} belongs to user 12345, expected user {os.geteuid()} or root" in notes[0]
    os.chown(path.parent, 0, -1)
    os.chown(path, 12345, -1)
    result, notes, loaded = call()
    assert (result, loaded) == (4, False)
    assert "belongs to user 12345" in notes[0]


def test_what_is_created_can_be_written_by_the_user_alone(call, base):
    before = os.umask(0)
    try:
        call()
    finally:
        os.umask(before)
    created = [base, *base.rglob("*")]
    assert len(created) >= 5
    assert not [path for path in created if path.stat().st_mode & (stat.S_IWGRP | stat.S_IWOTH)]


def test_a_file_gets_its_name_when_all_of_it_is_on_disk(call, base, monkeypatch):
    synced, named, sync, replace = {}, [], os.fsync, os.replace

    def note_sync(number):
        synced[os.fstat(number).st_ino] = os.fstat(number).st_size
        sync(number)

    def note_name(fresh, path):
        assert synced[os.stat(fresh).st_ino] == os.stat(fresh).st_size
        named.append(path)
        replace(fresh, path)

    monkeypatch.setattr(os, "fsync", note_sync)
    monkeypatch.setattr(os, "replace", note_name)
    call()
    assert sorted(named) == files(base)


def test_a_full_disk_leaves_nothing_and_is_noted_once(call, base, monkeypatch):
    def fail(number):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", fail)
    result, notes, _ = call()
    assert (result, len(notes)) == (4, 1)
    assert notes[0].startswith("compiled kernels cannot be kept in ")
    assert notes[0].endswith("No space left on device")
    assert [path for path in base.rglob("*") if path.is_file()] == []


def test_a_kernel_too_large_to_be_read_is_not_kept(call, base, monkeypatch):
    monkeypatch.setattr(store, "MOST", 1000)
    result, notes, _ = call()
    assert (result, len(notes), files(base)) == (4, 1, [])
    assert "expected at most 1000" in notes[0]


@pytest.mark.parametrize("leave", [Path.touch, os.mkfifo, Path.mkdir, lambda path: path.symlink_to("nowhere")])
def test_a_lock_that_was_left_behind_stops_nothing(leave, call, base):
    call()
    path = file_of(base)
    path.unlink()
    leave(path.with_suffix(".lock"))
    assert call() == (4, [], False)
    assert call() == (4, [], True)


def test_a_lock_that_another_process_holds_for_long_stops_nothing(call, base, monkeypatch):
    call()
    path = file_of(base)
    path.unlink()
    monkeypatch.setattr(cache, "PATIENCE", 0.1)
    with open(path.with_suffix(".lock"), "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert call() == (4, [], False)
    assert call() == (4, [], True)


def test_what_was_compiled_with_other_versions_has_another_name(call, base, monkeypatch):
    call()
    count = len(files(base))
    for place in range(len(cache.VERSIONS)):
        versions = [*cache.VERSIONS]
        versions[place] = "0.0"
        with monkeypatch.context() as patch:
            patch.setattr(cache, "VERSIONS", tuple(versions))
            assert call() == (4, [], False)
        assert len(files(base)) == (place + 2) * count
    assert call() == (4, [], True)


def foreign(base, name, size, age):
    """A file of another installation, of a size [bytes] and an age [s]."""
    path = base / OTHER / LEAF / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"")
    os.truncate(path, size)
    os.utime(path, (time.time() - age,) * 2)
    return path


def test_the_oldest_kernels_go_where_all_take_more_than_the_limit(call, base, monkeypatch):
    monkeypatch.setenv("CROWDSIM_CACHE_MB", "1")
    old, older, oldest = (foreign(base, f"{age}.nbc", 400_000, age) for age in (10, 20, 30))
    assert call() == (4, [], False)
    assert [path.exists() for path in (old, older, oldest)] == [True, True, False]
    assert sum(path.stat().st_size for path in files(base)) <= 10**6
    assert call() == (4, [], True)


def test_what_is_written_counts_and_what_is_loaded_costs_nothing(call, base, monkeypatch):
    tidied = []
    monkeypatch.setattr(cache, "tidy", lambda: tidied.append(1) or 10**9)
    call()
    assert tidied == [1]
    size = sum(path.stat().st_size for path in files(base))
    assert 0 < 10**9 - cache._Cache.room < size
    assert call() == (4, [], True)
    monkeypatch.setattr(cache._Cache, "room", 10)
    call("thrice")
    assert tidied == [1, 1]


def test_tidying_removes_what_killed_processes_left_and_nothing_of_others(base, tmp_path):
    stale, young = foreign(base, "x.nbc.0.tmp", 10, 7200), foreign(base, "y.nbc.0.tmp", 10, 60)
    kernel = foreign(base, "x.nbc", 10, 10**8)
    former = folders._parent(folders.PACKAGE / "crowd") / LEAF / "x.nbc"
    others = [base / f"crowd_{'0' * 40}" / "x-1.nbc", base / "mine" / LEAF / "x.lock", tmp_path / "away" / "x.lock"]
    for path in (former, *others):
        path.parent.mkdir(parents=True)
        path.touch()
        os.utime(path, (0, 0))
    (base / OTHER / "link-0123456789abcdef").symlink_to(tmp_path / "away")
    assert folders.tidy() == 10**9 - 10
    assert [path.exists() for path in (stale, young, kernel, former)] == [False, True, True, False]
    assert not former.parent.exists()
    assert all(path.exists() for path in others)


def test_the_limit_is_a_number_of_megabytes(monkeypatch):
    assert cache_limit() == 10**9
    monkeypatch.setenv("CROWDSIM_CACHE_MB", "20")
    assert cache_limit() == 20 * 10**6
    monkeypatch.setenv("CROWDSIM_CACHE_MB", "1 GB")
    with pytest.warns(RuntimeWarning, match="CROWDSIM_CACHE_MB is '1 GB', expected a whole number of megabytes; 1000"):
        assert cache_limit() == 10**9


def run(base, program="", **environment):
    """Call the kernel in a process of its own, after a program."""
    return subprocess.run(
        [sys.executable, "-c", f"{program}\nimport adding; print(adding.twice(1))"],
        capture_output=True, text=True, timeout=120, check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(base.parent), *sys.path]), "NUMBA_CACHE_DIR": str(base)},
    )  # fmt: skip


def test_a_process_with_damaged_files_alone_ends_well_with_one_note(base):
    assert run(base).stderr == ""
    for damage in ("a bit flipped in the middle", "cut to half"):
        for path in files(base):
            DAMAGE[damage](path)
        done = run(base)
        assert (done.returncode, done.stdout) == (0, "4\n")
        assert done.stderr.count("RuntimeWarning") == 1
        assert run(base).stderr == ""


def test_a_process_that_is_killed_while_it_writes_leaves_no_kernel(base):
    program = f"import os; os.fsync = lambda number: os.kill(os.getpid(), {signal.SIGKILL.value})"
    assert run(base, program).returncode == -signal.SIGKILL
    assert files(base) == []
    assert len(files(base, "*.tmp")) == 1
    done = run(base)
    assert (done.returncode, done.stdout, done.stderr) == (0, "4\n", "")


@pytest.fixture(scope="module")
def compiled():
    """Where kernels are kept that commands have compiled: the setting, and the folder of each folder of sources."""
    sources = {path.parent for path in folders.PACKAGE.rglob("*.py")}
    return os.environ.get("NUMBA_CACHE_DIR", ""), {folder: folders._parent(folder) for folder in sources}


def crowdsim(kernels, folder, *words):
    """Call a command in a process of its own, which keeps kernels in a folder."""
    return subprocess.run(
        [sys.executable, "-c", "from crowdsim.cli import main; main()", *words],
        capture_output=True, text=True, timeout=1200, check=False, cwd=folder,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "NUMBA_CACHE_DIR": str(kernels)},
    )  # fmt: skip


def check_commands(commands, compiled, base, folder, every):
    """Commands write and print the same whether their kernels are loaded, or every n-th of them is damaged."""

    def outcome(kernels):
        """What is printed and written, and the number of notes of each command."""
        done = [crowdsim(kernels, folder, *words) for words in commands]
        assert [one.returncode for one in done] == [0] * len(commands), [one.stderr for one in done]
        written = {path: path.read_bytes() for path in sorted((folder / "output").rglob("*.bvh"))}
        return [one.stdout for one in done], written, [one.stderr.count("RuntimeWarning") for one in done]

    setting, places = compiled
    *whole, notes = outcome(setting)
    assert notes == [0] * len(commands)
    assert whole[1]
    for sources, place in places.items():
        for kept in place.glob("*-*") if place.is_dir() else ():
            if kept.is_dir():
                shutil.copytree(kept, folders._parent(sources) / kept.name)
    assert len(files(base)) > len(commands)
    for number, path in enumerate(files(base)[::every]):
        DAMAGE["a bit flipped in the middle" if number % 2 else "cut to half"](path)
    assert outcome(base) == (*whole, [1] * len(commands))
    assert outcome(base) == (*whole, [0] * len(commands))
    # Hundreds of megabytes.
    shutil.rmtree(base)


def test_commands_run_with_all_their_kernels_damaged(compiled, base, tmp_path):
    check_commands(
        [
            ["perform", "--seconds", "2", "--out", "output", "--force", "--quiet"],
            ["inspect", "output/performer_00.bvh", "--json"],
        ],
        compiled,
        base,
        tmp_path,
        every=1,
    )


@pytest.mark.slow
def test_a_run_goes_on_with_some_of_its_kernels_damaged(compiled, base, workplace):
    write_scene(workplace / "four.yaml", outputs={"bvh": {"fps": 15, "frames": [0, 3]}})
    command = ["run", "four.yaml", "--out", "output", "--force", "--threads", "1", "--quiet"]
    check_commands([command], compiled, base, workplace, every=5)
