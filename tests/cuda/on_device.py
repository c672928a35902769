"""The threads of a GPU, compiled without one."""

from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
from numba import cuda, typeof, types

from crowdsim.crowd.cuda import memory, stages
from crowdsim.crowd.cuda.binaries import nothing_contracted, prepare_compiler

CAPABILITIES = ((8, 0), (9, 0), (12, 0))


def work_of(simulation):
    """Return what threads of a simulation are called with; arrays stay in the memory of the machine."""
    tree = stages.SortingIndex(simulation._workers)
    frame = stages.CudaStages(simulation.crowd, simulation.model, simulation.avatars, tree, simulation._workers)
    with (
        patch.object(memory.cuda, "to_device", lambda values: values.copy(order="K")),
        patch.object(stages, "free_memory", lambda: np.inf),
    ):
        frame._sort(simulation.present, np.zeros(0, np.int32))
        return frame._allocate(simulation._world_at(0, 2))


def compile_thread(thread, work):
    """Return the PTX of a thread for each of ``CAPABILITIES``: lowered once, generated for each, nothing contracted."""
    from numba.cuda.cudadrv import nvvm

    prepare_compiler()
    found = {}
    with nothing_contracted():
        generate = nvvm.compile_ir

        def generate_for_each(code, **options):
            for capability in CAPABILITIES:
                found[capability] = generate(code, **{**options, "arch": f"compute_{capability[0]}{capability[1]}"})
            return found[CAPABILITIES[0]]

        with no_driver(), patch.object(nvvm, "compile_ir", generate_for_each):
            kind = types.void(typeof(work))
            cuda.compile(thread, kind, device=False, cc=CAPABILITIES[0], output="ptx", abi="numba")
    return {capability: text.decode() if isinstance(text, bytes) else text for capability, text in found.items()}


def no_driver():
    """Resolve types for the first of ``CAPABILITIES``; without a driver there is no device."""
    device = SimpleNamespace(compute_capability=CAPABILITIES[0])
    return patch("numba.cuda.dispatcher.get_current_device", lambda: device)
