"""Mutants of kept kernels: none is unpickled or loaded, and each is reported and removed."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from on_disk import change_bytes

from crowdsim.jit import cache, store

pytestmark = pytest.mark.filterwarnings("ignore:.*the kernel is compiled again:RuntimeWarning")
SOURCE = """from crowdsim.jit import kernel


@kernel
def leaf(x):
    return x + 1


@kernel
def twice(x):
    return 2 * leaf(x)
"""


class Kept:
    """The file of a kernel, and what reads it.

    Args:
        cache: What has been compiled of a kernel.
        signature: The signature that the file is of.
        context: numba's context.
    """

    def __init__(self, cache: Any, signature: tuple[Any, ...], context: Any) -> None:
        self._cache, self._signature, self._context = cache, signature, context
        self.path: Path = cache.path(signature, context.codegen())
        self.sound = self.path.read_bytes()

    def load(self) -> Any:
        """Load the kernel as a process does that has reported nothing yet."""
        store._reported.clear()
        return self._cache.load_overload(self._signature, self._context)

    def refuses(self) -> bool:
        """Whether the file is not loaded, and is removed; what is sound comes back."""
        refused = self.load() is None and bool(store._reported) and not self.path.exists()
        self.path.write_bytes(self.sound)
        return refused


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[Kept]]:
    """A kernel that Python calls, and one that it calls in turn."""
    from numba import config, types

    from crowdsim.jit.cache import KernelCache

    folder = tmp_path_factory.mktemp("kernels")
    (folder / "mutated.py").write_text(SOURCE)
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        patch.setattr(config, "CACHE_DIR", str(folder / "cache"))
        patch.setattr(store, "_reported", [])
        patch.syspath_prepend(folder)
        module = importlib.import_module("mutated")
        assert module.twice(1) == 4
        part, context = KernelCache(module.leaf.py_func, part=True), module.twice.targetctx
        yield [Kept(one, (types.int64,), context) for one in (module.twice.kept, part)]


@pytest.fixture
def unpickled(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """What is unpickled: a number of bytes each."""
    found: list[int] = []
    unpack = cache._unpack

    def note(data: Any) -> Any:
        found.append(len(data))
        return unpack(data)

    monkeypatch.setattr(cache, "_unpack", note)
    return found


def check_mutants(kept: list[Kept], seeds: range) -> None:
    for seed in seeds:
        one, rng = kept[seed % len(kept)], np.random.default_rng(seed)
        change_bytes(rng, one.path, len(one.sound) if seed % 3 else 64)
        assert one.path.read_bytes() == one.sound or one.refuses(), seed


def test_kernels_that_nothing_has_changed_are_loaded(kept: list[Kept], unpickled: list[int]) -> None:
    for one in kept:
        assert one.load() is not None
        assert store._reported == []
    assert len(unpickled) == len(kept)


def test_200_mutants_of_kernels_are_refused(kept: list[Kept], unpickled: list[int]) -> None:
    check_mutants(kept, range(200))
    assert unpickled == []


@pytest.mark.slow
def test_10000_mutants_of_kernels_are_refused(kept: list[Kept], unpickled: list[int]) -> None:
    check_mutants(kept, range(200, 10200))
    assert unpickled == []


def test_any_flipped_bit_of_a_checksum_is_found(kept: list[Kept], unpickled: list[int]) -> None:
    for one in kept:
        for bit in range(8 * 32):
            data = bytearray(one.sound)
            data[bit // 8] ^= 1 << bit % 8
            one.path.write_bytes(data)
            assert one.refuses(), bit
    assert unpickled == []
