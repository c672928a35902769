"""Memory of a GPU: copies of arrays, with fields of records aligned, which a GPU needs to read them at once.

In numba's simulator (``NUMBA_ENABLE_CUDASIM=1``) threads call the kernels that are compiled for processors, and memory
is numpy's.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import config, cuda

from crowdsim.core.types import Array

SIMULATED = bool(config.ENABLE_CUDASIM)  # type: ignore[attr-defined]
"""Whether numba's simulator takes the place of a GPU."""


def aligned(kind: np.dtype[Any]) -> np.dtype[Any]:
    """Return a type of records with fields at multiples of their sizes; other types as they are."""
    if kind.fields is None or kind.isalignedstruct or SIMULATED:
        return kind
    return np.dtype([(name, field[0]) for name, field in kind.fields.items()], align=True)


def to_device(values: Array) -> Any:
    """Return a copy of an array, in the order in which it is stored."""
    plain = values if values.flags.forc else np.ascontiguousarray(values)
    if SIMULATED:
        copy = np.array(plain, order="K")
        copy.flags.writeable = values.flags.writeable
        return copy
    return cuda.to_device(plain.astype(aligned(plain.dtype), order="K", copy=False))


def all_to_device(parts: Any) -> Any:
    """Return named tuples of arrays, which may be nested, with copies of these; numbers as they are."""
    if isinstance(parts, tuple):
        return type(parts)(*(all_to_device(part) for part in parts))  # type: ignore[call-arg]
    return to_device(parts) if isinstance(parts, np.ndarray) else parts


def empty(shape: tuple[int, ...], kind: Any) -> Any:
    """Return an array of zeros for threads, whose number is the first of ``shape``.

    On a GPU the entries that threads read at the same time lie side by side.
    """
    return to_device(np.zeros(shape, kind, order="C" if SIMULATED else "F"))


def write(device: Any, values: Array) -> None:
    """Copy an array over one of the same shape on the GPU."""
    if SIMULATED:
        device[...] = values
    elif values.size:
        device.copy_to_device(np.ascontiguousarray(values).astype(aligned(values.dtype), copy=False))


def read(device: Any, out: Array) -> None:
    """Copy an array of the GPU over a contiguous one of the same shape."""
    if SIMULATED:
        out[...] = device
    elif out.size:
        kind = aligned(out.dtype)
        if kind.itemsize == out.dtype.itemsize:
            device.copy_to_host(out.view(kind))
        else:
            out[...] = device.copy_to_host()


def free_memory() -> float:
    """Return how much memory of the GPU is free [bytes]."""
    return float(cuda.current_context().get_memory_info().free)


def size_of(parts: Any) -> int:
    """Return the memory of all arrays of named tuples, which may be nested [bytes]."""
    if isinstance(parts, tuple):
        return sum(size_of(part) for part in parts)
    return int(getattr(parts, "nbytes", 0))
