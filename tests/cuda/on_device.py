"""Kernels of control as device functions: a thread for each avatar or decision, compiled without a GPU."""

import inspect
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
from numba import cuda, typeof, types
from numba.cuda.cudadrv import nvvm
from numba.cuda.extending import overload

from crowdsim.crowd.buffers import empty_record, empty_strikes
from crowdsim.crowd.kernels.advance import advance, switch
from crowdsim.crowd.kernels.choose import choose
from crowdsim.crowd.kernels.evaluate import evaluate
from crowdsim.crowd.kernels.kd_tree import everyone
from crowdsim.crowd.kernels.knock_downs import empty_room, knock_down
from crowdsim.crowd.kernels.layout import Observed
from crowdsim.crowd.kernels.observe import observe
from crowdsim.crowd.kernels.prefetch import prefetch
from crowdsim.crowd.kernels.record import write_record
from crowdsim.crowd.kernels.resolve import list_strikes, resolve

CAPABILITIES = ((8, 0), (9, 0), (12, 0))


@overload(prefetch)
def _prefetch_nothing(array, index):
    """A GPU hides latency by other threads."""
    return lambda array, index: None


def advance_avatar(model, avatars, world, now, due):
    i = cuda.grid(1)
    if i < now.present:
        advance(model, avatars, world, now.frame, i, i + 1, due, False)


def observe_one(model, avatars, world, now, due, counts, observed, scratch):
    q = cuda.grid(1)
    if q < counts[0]:
        some = Observed(observed.opponents[q:], observed.counts[q:], observed.neighbours[q:])
        observe(model, avatars, world, now, due[q:], 1, some, scratch)


def evaluate_one(model, avatars, world, now, due, counts, observed, scratch):
    q = cuda.grid(1)
    if q < counts[0]:
        some = Observed(observed.opponents[q:], observed.counts[q:], observed.neighbours[q:])
        evaluate(model, avatars, world, now, due[q:], 1, some, scratch)


def choose_one(model, avatars, world, now, due, counts, observed, scratch, chosen):
    q = cuda.grid(1)
    if q < counts[0]:
        some = Observed(observed.opponents[q:], observed.counts[q:], observed.neighbours[q:])
        counts[1] = choose(model, avatars, world, now, due[q:], 1, some, scratch, chosen[q:])


def switch_avatar(model, avatars, world, now, due, counts, chosen):
    q = cuda.grid(1)
    if q < counts[0]:
        switch(model, avatars, world, now.frame, due, chosen, q, q + 1)


def list_strikes_of_avatar(model, avatars, world, now, due, counts, strikes):
    i = cuda.grid(1)
    if i < now.present:
        counts[i] = list_strikes(model, avatars, world, now, i, i + 1, due, strikes, 0)


def resolve_strikes(model, avatars, world, now, counts, strikes, before):
    if cuda.grid(1) == 0:
        counts[1], counts[2] = resolve(model, avatars, world, now.frame, strikes, 0, counts[0], before)


def knock_down_avatars(model, avatars, world, now, counts, strikes, tree, observed, room):
    if cuda.grid(1) == 0:
        knock_down(model, avatars, world, now, strikes, 0, counts[2], tree, observed, room)


def record_avatar(model, avatars, now, record):
    i = cuda.grid(1)
    if i < now.present:
        write_record(model, avatars, record, 0, i, i + 1)


THREADS = (
    *(advance_avatar, observe_one, evaluate_one, choose_one, switch_avatar, list_strikes_of_avatar, resolve_strikes),
    *(knock_down_avatars, record_avatar),
)


def arguments_of(simulation):
    """Return what threads of a simulation are called with, by name."""
    count, most = simulation.crowd.count, simulation.crowd.crowding.most
    numbers = np.zeros(count, np.int32)
    return {
        "model": simulation.model,
        "avatars": simulation.avatars,
        "world": simulation._world,
        "now": simulation._now,
        "due": numbers,
        "chosen": numbers,
        "counts": numbers,
        "observed": Observed(numbers, numbers, np.zeros((count, most), np.int32)),
        "scratch": simulation._scratch,
        "record": empty_record(1, count),
        "strikes": empty_strikes(count),
        "before": np.zeros((count, 4)),
        "tree": everyone(simulation.avatars, count),
        "room": empty_room(simulation.model, most),
    }


def compile_threads(thread, arguments):
    """Return the PTX of a thread for each of ``CAPABILITIES``: lowered once, generated for each, nothing contracted."""
    kinds = [typeof(arguments[name]) for name in inspect.signature(thread).parameters]
    generate, found = nvvm.compile_ir, {}

    def generate_for_each(code, **options):
        for capability in CAPABILITIES:
            chosen = {**options, "fma": False, "arch": f"compute_{capability[0]}{capability[1]}"}
            found[capability] = generate(code, **chosen)
        return found[CAPABILITIES[0]]

    # Types are resolved for the device that there is; without a driver there is none.
    device = SimpleNamespace(compute_capability=CAPABILITIES[0])
    with (
        patch("numba.cuda.dispatcher.get_current_device", lambda: device),
        patch.object(nvvm, "compile_ir", generate_for_each),
    ):
        cuda.compile(thread, types.void(*kinds), device=False, cc=CAPABILITIES[0], output="ptx", abi="numba")
    return {capability: text.decode() if isinstance(text, bytes) else text for capability, text in found.items()}
