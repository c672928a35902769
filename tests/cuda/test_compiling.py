"""Threads of a GPU compile without one, for several kinds, and are kept."""

import re
from unittest.mock import patch

import numpy as np
import pytest
from synthetic_policy import policy

pytest.importorskip("numba_cuda", reason="needs numba-cuda: pip install crowdsim[test-cuda]")

from numba import typeof
from on_device import CAPABILITIES, compile_thread, no_driver, work_of

from crowdsim.crowd.crowd import build_crowd
from crowdsim.crowd.cuda import binaries
from crowdsim.crowd.cuda.memory import aligned
from crowdsim.crowd.cuda.threads import THREADS, record_avatar
from crowdsim.crowd.kernels import records
from crowdsim.crowd.simulation import Simulation


@pytest.fixture(scope="module")
def work():
    rng = np.random.default_rng(0)
    crowd = build_crowd(*rng.normal(0, 3, (2, 12)), rng.uniform(-3, 3, 12), policies=[policy(0)], seed=1, variety=1.0)
    with Simulation(crowd) as simulation:
        yield work_of(simulation)


@pytest.mark.slow
@pytest.mark.parametrize("thread", THREADS, ids=lambda thread: thread.__name__)
def test_threads_compile_for_gpus_without_contraction(thread, work):
    compiled = compile_thread(thread, work)
    assert tuple(compiled) == CAPABILITIES
    for (major, minor), text in compiled.items():
        assert f".target sm_{major}{minor}" in text
        assert ".visible .entry" in text
        assert "fma.rn.f64" not in text
        # Without a rounding mode, what turns this into machine code may contract it.
        assert not re.search(r"\b(mul|add|sub)\.f(32|64)", text)
        assert not re.search(r"\bcall\b.*__nv_(exp|sin|cos|atan|pow|hypot)", text)


def test_fields_of_records_are_aligned_on_a_gpu():
    kinds = [kind for kind in vars(records).values() if isinstance(kind, np.dtype)]
    assert len(kinds) > 10
    for kind in kinds:
        of_gpu = aligned(kind)
        assert of_gpu.names == kind.names
        assert of_gpu.isalignedstruct
        for name in of_gpu.names:
            field, offset = of_gpu.fields[name][:2]
            assert offset % field.alignment == 0


def test_a_thread_is_kept_by_its_sources_its_argument_and_the_kind_of_gpu():
    paths = {
        binaries.ThreadCache(record_avatar, capability).path((kind,))
        for capability in CAPABILITIES
        for kind in (typeof(np.zeros(2)), typeof(np.zeros(2, np.int32)))
    }
    assert len(paths) == 2 * len(CAPABILITIES)
    assert all(re.fullmatch(r"threads-[0-9a-f]{16}", path.parent.name) for path in paths)


@pytest.mark.slow
def test_a_compiled_thread_is_kept_and_not_compiled_again(work, tmp_path, monkeypatch):
    monkeypatch.setattr("numba.config.CACHE_DIR", str(tmp_path))
    monkeypatch.setattr("numba.cuda.dispatcher._Kernel.bind", lambda self: self._codelibrary.get_cubin())
    monkeypatch.setattr("numba.cuda.codegen.CUDACodeLibrary._ensure_cc", lambda self, cc: (9, 0, "a"))
    binaries.prepare_compiler()
    kind, compiling = typeof(work), patch("numba.cuda.dispatcher.compile_cuda", side_effect=AssertionError("compiled"))
    with no_driver():
        first = binaries.compile_thread(record_avatar, kind, (9, 0))
        with compiling:
            again = binaries.compile_thread(record_avatar, kind, (9, 0))
        with compiling, pytest.raises(AssertionError, match="compiled"):
            binaries.compile_thread(record_avatar, kind, (12, 0))
    (before,), (after,) = first.overloads.values(), again.overloads.values()
    assert before is not after
    (code,), (kept,) = before._codelibrary._cubin_cache.values(), after._codelibrary._cubin_cache.values()
    assert code.code == kept.code
    assert code.code.startswith(b"\x7fELF")
    (file,) = tmp_path.rglob("*.nbc")
    assert file.stat().st_size < 2_000_000
