"""Every single bit of a finished run is under a checksum: ``verify`` finds any that has flipped."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from crowdsim.errors import TakeError
from crowdsim.runs.manifest import NAME, checksums, read_manifest, verify, write_manifest
from crowdsim.runs.manifest import Verdict as Intact

SMALL = 1000
"""Files of no more bytes may be gone through bit by bit."""
ALL = settings(deadline=None, phases=[Phase.generate], suppress_health_check=list(HealthCheck))


@pytest.fixture(scope="module")
def run(strangers: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of a finished run."""
    folder = tmp_path_factory.mktemp("flipped") / "run"
    shutil.copytree(strangers / "run", folder)
    return folder


def names_of(folder: Path) -> list[str]:
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def is_found(folder: Path, path: Path, whole: bytes, bit: int) -> bool:
    """Flip a bit of a file, verify the run that it is in, and flip it back."""
    data = bytearray(whole)
    data[bit // 8] ^= 1 << bit % 8
    path.write_bytes(data)
    try:
        return bool(verify(folder).findings)
    except TakeError:
        return True
    finally:
        path.write_bytes(whole)


def test_nothing_in_a_finished_run_is_without_a_checksum(run: Path) -> None:
    assert set(names_of(run)) - set(read_manifest(run)["files"]) == {NAME}
    assert verify(run) == Intact()


def check_random_bits(run: Path, count: int) -> None:
    names = names_of(run)
    contents = {name: (run / name).read_bytes() for name in names}

    @settings(ALL, max_examples=count)
    @given(st.sampled_from([name for name in names if contents[name]]), st.floats(0, 1, exclude_max=True))
    def check(name: str, place: float) -> None:
        bit = int(place * 8 * len(contents[name]))
        assert is_found(run, run / name, contents[name], bit), f"{name}, bit {bit}"

    check()
    assert verify(run) == Intact()


def test_a_flipped_bit_anywhere_in_a_run_is_found(run: Path) -> None:
    check_random_bits(run, 100)


@pytest.mark.slow
def test_1000_flipped_bits_anywhere_in_a_run_are_found(run: Path) -> None:
    check_random_bits(run, 1000)


def small_run(run: Path, name: str, folder: Path) -> tuple[Path, bytes]:
    """Make a run of only one of the files of another one."""
    (folder / name).parent.mkdir(parents=True)
    shutil.copy(run / name, folder / name)
    write_manifest(folder, {"status": "done"}, checksums(folder))
    return folder / name, (run / name).read_bytes()


@pytest.mark.slow
def test_every_flipped_bit_of_a_small_file_of_each_kind_is_found(run: Path, tmp_path: Path) -> None:
    sizes = {name: (run / name).stat().st_size for name in names_of(run) if name != NAME}
    # Of each kind the smallest: 60 of them would take minutes, and all are hashed alike.
    small: dict[str, str] = {}
    for name in sorted(sizes, key=lambda name: sizes[name]):
        if 0 < sizes[name] <= SMALL:
            small.setdefault(Path(name).name, name)
    assert set(small) >= {".zarray", ".zattrs", ".zgroup", "0", "0.0"}
    for number, name in enumerate(small.values()):
        folder = tmp_path / str(number)
        path, whole = small_run(run, name, folder)
        missed = [bit for bit in range(8 * len(whole)) if not is_found(folder, path, whole, bit)]
        assert not missed, f"{name}: {missed}"


@pytest.mark.slow
def test_every_flipped_bit_of_a_manifest_is_found(run: Path, tmp_path: Path) -> None:
    small_run(run, "take.zarr/.zgroup", tmp_path / "run")
    path = tmp_path / "run" / NAME
    whole = path.read_bytes()
    missed = [bit for bit in range(8 * len(whole)) if not is_found(tmp_path / "run", path, whole, bit)]
    assert not missed


def test_files_that_are_swapped_cut_or_empty_are_found(run: Path) -> None:
    names = [name for name in names_of(run) if name != NAME]
    rng = np.random.default_rng(4)
    for _ in range(20):
        one, other = (run / names[int(k)] for k in rng.choice(len(names), 2, replace=False))
        before = one.read_bytes(), other.read_bytes()
        for after in (before[::-1], (before[0][:-1], before[1]), (b"", before[1])):
            if after != before:
                one.write_bytes(after[0])
                other.write_bytes(after[1])
                assert verify(run).findings
        one.write_bytes(before[0])
        other.write_bytes(before[1])
    assert verify(run) == Intact()
