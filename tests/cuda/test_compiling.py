"""Kernels of control are one source for processors and GPUs: they compile for these as they are, without a GPU."""

import re

import numpy as np
import pytest
from synthetic_policy import policy

pytest.importorskip("numba_cuda", reason="needs numba-cuda: pip install crowdsim[test-cuda]")

from on_device import CAPABILITIES, THREADS, arguments_of, compile_threads

from crowdsim.crowd.crowd import build_crowd
from crowdsim.crowd.simulation import Simulation


@pytest.fixture(scope="module")
def arguments():
    rng = np.random.default_rng(0)
    crowd = build_crowd(*rng.normal(0, 3, (2, 12)), rng.uniform(-3, 3, 12), policies=[policy(0)], seed=1, variety=1.0)
    with Simulation(crowd) as simulation:
        yield arguments_of(simulation)


@pytest.mark.slow
@pytest.mark.parametrize("thread", THREADS, ids=lambda thread: thread.__name__)
def test_kernels_of_control_compile_for_gpus_without_contraction(thread, arguments):
    compiled = compile_threads(thread, arguments)
    assert tuple(compiled) == CAPABILITIES
    for (major, minor), text in compiled.items():
        assert f".target sm_{major}{minor}" in text
        assert ".visible .entry" in text
        assert "fma.rn.f64" not in text
        # Without a rounding mode, what turns this into machine code may contract it.
        assert not re.search(r"\b(mul|add|sub)\.f(32|64)", text)
        assert not re.search(r"\bcall\b.*__nv_(exp|sin|cos|atan|pow|hypot)", text)
