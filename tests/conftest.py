"""Fixtures that all tests share."""

import hashlib
import os
import shutil
import signal
import sys
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # So it is in the background of a shell, and commands that tests interrupt would inherit it.
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Tests start hundreds of processes, and each would compile the sources of the whole package again.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# Folders of tests are in memory, where writing waits for no disk, if there is room for them and for programs.
MEMORY = "/dev/shm"
if os.path.isdir(MEMORY):
    room = os.statvfs(MEMORY)
    if room.f_bavail * room.f_frsize > 4 << 30 and not room.f_flag & os.ST_NOEXEC:
        os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", MEMORY)

settings.register_profile("ci", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow])
if os.environ.get("CI") == "true":
    settings.load_profile("ci")


NEEDED = ("training", "few float32", "bvh", "pictures", "clouds", "bodies")
"""What most tests need kernels for."""


def pytest_sessionstart(session: pytest.Session) -> None:
    """Let kernels that are missing be compiled while test processes wait for one another to train or compile."""
    workers = getattr(session.config.option, "numprocesses", None)
    if not isinstance(workers, int) or hasattr(session.config, "workerinput"):
        return
    from crowdsim.jit.ahead import compile_ahead

    compiling = ExitStack()
    compiling.enter_context(compile_ahead(NEEDED, workers))
    session.config.add_cleanup(compiling.close)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files whose few tests wait for processes: at the end they would leave a worker idle."""
    items.sort(key=lambda item: item.path.parent.name not in ("batch", "crash"))


@pytest.fixture(scope="session")
def mocap() -> Path:
    """Folder of real capture; tests that need it skip without one, and fail where CI should have had it."""
    folder = os.environ.get("CROWDSIM_MOCAP", "")
    if folder and Path(folder).is_dir():
        return Path(folder)
    reason = f"CROWDSIM_MOCAP names no folder with capture ({folder!r})"
    if os.environ.get("CI") == "true":
        pytest.fail(reason)
    pytest.skip(reason)


@pytest.fixture(scope="session")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of what is made once for all test processes."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "shared"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def tiny_policy(shared: Path) -> Path:
    """Folder of a small trained policy, its recipe ``tiny.yaml`` beside it; trained once for all test processes."""
    from crowdsim.training.train import train_recipe

    folder = shared / "policies"
    folder.mkdir(exist_ok=True)
    recipe = folder / "tiny.yaml"
    if not recipe.exists():
        fresh = folder / f"tiny-{os.getpid()}.txt"
        fresh.write_text((Path(__file__).parent / "tiny_policy.yaml").read_text(encoding="utf-8"))
        os.replace(fresh, recipe)
    return train_recipe(recipe, threads=2)[0]


@pytest.fixture
def workplace(tiny_policy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder in which the policy ``tiny`` can be found."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("CROWDSIM_MOCAP", raising=False)
    shutil.copytree(tiny_policy.parent, tmp_path / "policies", ignore=shutil.ignore_patterns("lock", ".*"))
    return tmp_path


@pytest.fixture(scope="session")
def finish(shared: Path) -> Callable[..., None]:
    """Let the scenario ``four.yaml`` of a working folder run; the same run is done once, and copied from then on.

    Runs are the same that have the same scenario and words, and whose takes have chunks of as many strikes.
    """
    from scenes import crowdsim

    from crowdsim.take import store

    base = shared / "finished"
    base.mkdir(exist_ok=True)

    def finish(workplace: Path, *words: str, out: str = "run") -> None:
        asked = (workplace / "four.yaml").read_bytes() + repr((words, out, store.EVENTS_A_CHUNK)).encode()
        kept = base / hashlib.sha256(asked).hexdigest()
        if kept.exists():
            shutil.copytree(kept, workplace / out)
            return
        assert crowdsim("run", "four.yaml", *words, "--out", out) == 0
        fresh = base / f"{kept.name}-{os.getpid()}"
        shutil.copytree(workplace / out, fresh)
        with suppress(OSError):  # another process has been faster
            os.rename(fresh, kept)

    return finish
