"""Mutants: arrays and JSON documents, changed in one way or in a few, as a damaged or a hostile file may be."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

Rng = np.random.Generator
INTEGERS = (-1, 0, 1, 2, -2, 7, 255, 256, 65535, 65536, 2**31 - 1, -(2**31), 2**31, 2**62)
FLOATS = (np.nan, np.inf, -np.inf, 0.0, -0.0, -1.0, 1.0, 1e-300, 1e-38, 0.5, 1e3, -1e3, 1e6, 1e9, 1e30, -1e30, 1e308)
DTYPES = ("f4", "f8", "f2", "i4", "i8", "i2", "u1", "u4", "?", ">f4", ">i4", "U3", "c8")
VALUES: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2, 10**9, 10**30, -0.5, 0.5, 1e-300, 1e308, -1e308, "", "x", "../x", "a\nb", "\ud800",
    [], [[]], {}, {"a": 1}, [1, 2, 3], "nan", [None], 1.5, "q", "v", "0" * 64,
)  # fmt: skip


def mutate_array(rng: Rng, array: np.ndarray) -> np.ndarray:
    """Return an array changed in one way."""
    if array.size == 0:
        return np.zeros((int(rng.integers(0, 3)), *array.shape[1:]), array.dtype)
    change = CHANGES[int(rng.integers(len(CHANGES)))]
    if not array.ndim:
        changed = change(rng, array[None])
        return changed[0] if len(changed) else changed
    return change(rng, array)


def _entry(rng: Rng, array: np.ndarray) -> np.ndarray:
    """Set an entry to an extreme, to its neighbours' value, or somewhat higher or lower."""
    changed = array.copy()
    flat = changed.reshape(-1)
    at = int(rng.integers(flat.size))
    how = int(rng.integers(3))
    if how == 0:
        _put(flat, at, _extreme(rng, array))
    elif how == 1:
        flat[at] = flat[int(rng.integers(flat.size))]
    else:
        _put(flat, at, _number(flat[at]) + int(rng.integers(-3, 4)))
    return changed


def _bit(rng: Rng, array: np.ndarray) -> np.ndarray:
    changed = np.ascontiguousarray(array).copy()
    data = changed.reshape(-1).view(np.uint8)
    data[int(rng.integers(data.size))] ^= np.uint8(1 << int(rng.integers(8)))
    return changed


def _rows(rng: Rng, array: np.ndarray) -> np.ndarray:
    """Set some rows to an extreme, shuffle them, reverse them, or turn their signs."""
    changed = array.copy()
    low = int(rng.integers(len(changed)))
    some = changed[low : low + int(rng.integers(1, 20))]
    how = int(rng.integers(5))
    with np.errstate(all="ignore"):
        if how == 0:
            _put(some.reshape(-1) if some.flags.c_contiguous else some, slice(None), _extreme(rng, array))
        elif how == 1:
            rng.shuffle(changed)
        elif how == 2:
            some[...] = some[::-1].copy()
        elif how == 3 and array.dtype.kind in "if":
            some *= -1
        elif array.dtype.kind in "ifu":
            some += np.asarray(int(rng.integers(1, 4))).astype(array.dtype)
    return changed


def _whole(rng: Rng, array: np.ndarray) -> np.ndarray:
    """Set all entries to one number."""
    changed = array.copy()
    _put(changed.reshape(-1), slice(None), _extreme(rng, array))
    return changed


def _length(rng: Rng, array: np.ndarray) -> np.ndarray:
    """Cut an array, or repeat some of it, along one axis."""
    axis = int(rng.integers(array.ndim))
    count = array.shape[axis]
    return np.take(array, np.arange(int(rng.integers(0, count + 4))) % max(count, 1), axis=axis)


def _dtype(rng: Rng, array: np.ndarray) -> np.ndarray:
    kind = DTYPES[int(rng.integers(len(DTYPES)))]
    with np.errstate(all="ignore"):
        return array.astype("U3" if array.dtype.kind == "U" else kind)


def _shape(rng: Rng, array: np.ndarray) -> np.ndarray:
    how = int(rng.integers(4))
    if how == 0:
        return array.reshape(-1)
    if how == 1:
        return array[None]
    return array.T if how == 2 else np.asfortranarray(array)


CHANGES: tuple[Callable[[Rng, np.ndarray], np.ndarray], ...] = (
    _entry, _entry, _entry, _entry, _bit, _bit, _rows, _rows, _whole, _length, _dtype, _shape,
)  # fmt: skip


def _extreme(rng: Rng, array: np.ndarray) -> Any:
    if array.dtype.kind == "f":
        return FLOATS[int(rng.integers(len(FLOATS)))]
    sizes = (len(array), len(array) - 1, len(array) + 1, *INTEGERS)
    return sizes[int(rng.integers(len(sizes)))]


def _number(value: Any) -> Any:
    return value.item() if hasattr(value, "item") and not isinstance(value.item(), str) else 0


def _put(flat: np.ndarray, at: Any, value: Any) -> None:
    """Write a number as the type of the array has it, wrapped round where it is too large."""
    with np.errstate(all="ignore"):
        if flat.dtype.kind in "iu":
            bits = 8 * flat.dtype.itemsize
            value = int(value) % 2**bits
            value = value - 2**bits if flat.dtype.kind == "i" and value >= 2 ** (bits - 1) else value
        if flat.dtype.kind == "b":
            flat.view(np.uint8)[at] = int(value) % 256
        elif flat.dtype.kind == "U":
            flat[at] = str(value)
        else:
            flat[at] = np.float64(value).astype(flat.dtype) if flat.dtype.kind == "f" else value


def mutate_json(rng: Rng, data: Any) -> Any:
    """Return plain data changed in one place; what is not changed is shared."""
    if not isinstance(data, dict | list) or not data or rng.random() < 0.15:
        return _value(rng, data)
    if isinstance(data, dict):
        changed: Any = dict(data)
        key: Any = list(data)[int(rng.integers(len(data)))]
    else:
        changed = list(data)
        key = int(rng.integers(len(data)))
    how = rng.random()
    if how < 0.06:
        del changed[key]
    elif how < 0.1 and isinstance(data, dict):
        changed["unknown"] = VALUES[int(rng.integers(len(VALUES)))]
    elif how < 0.12 and isinstance(data, list):
        changed.append(changed[key])
    else:
        changed[key] = mutate_json(rng, data[key])
    return changed


def _value(rng: Rng, data: Any) -> Any:
    how = rng.random()
    if isinstance(data, bool) or not isinstance(data, int | float) or how < 0.5:
        return VALUES[int(rng.integers(len(VALUES)))]
    if how < 0.75:
        return data + int(rng.integers(-2, 3))
    return data * (-1, 0, 2, 1e9, 0.5, 1e-9, 1000)[int(rng.integers(7))]
