"""A small real bundle and a small real run, and a process that runs their mutants."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from runnable import Base
from scenes import crowdsim, write_scene
from worker import Worker

TARGET = {"ball": {"kind": "circle", "radius": 2, "speed": 1, "height": 1.5}}


@pytest.fixture(scope="session")
def strangers(tiny_policy: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the bundle ``policies/tiny`` and the finished run ``run`` of four avatars."""
    folder = tmp_path_factory.mktemp("strangers")
    shutil.copytree(tiny_policy.parent, folder / "policies", ignore=shutil.ignore_patterns("lock", ".*"))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.delenv("CROWDSIM_MOCAP", raising=False)
        write_scene(Path("four.yaml"), targets=TARGET, outputs={"bvh": {"fps": 15, "frames": [0, 3]}})
        assert crowdsim("run", "four.yaml", "--out", "run", "--threads", "1") == 0
    return folder


@pytest.fixture(scope="session")
def base(strangers: Path) -> Base:
    """What mutants are made from."""
    return Base(strangers)


@pytest.fixture(scope="session")
def worker(strangers: Path) -> Iterator[Worker]:
    """A process that runs mutants."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(strangers)
        process = Worker(strangers)
    yield process
    process.close()
