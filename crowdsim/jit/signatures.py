"""What kernels are called with: which arguments each one is compiled for, as text that ships with the package.

``signatures.json`` lists, in the order in which a first run needs them, the kernels that Python calls, what they are
needed for, and the types of their arguments. It lets kernels be compiled before they are needed; one that is missing
there, or called otherwise, is compiled when it is called.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Collection, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

FILE = Path(__file__).with_name("signatures.json")


class Listed(NamedTuple):
    """A kernel and what it is called with.

    Attributes:
        module: Name of its module.
        name: Its name.
        uses: What it is needed for.
        arguments: Types of its arguments, as text (``encode``).
    """

    module: str
    name: str
    uses: list[str]
    arguments: list[Any]


def listed(uses: Collection[str] = ()) -> list[Listed]:
    """Return the kernels that are needed for some of these uses, or all of them, in the order of need."""
    found = [Listed(**entry) for entry in json.loads(FILE.read_text(encoding="utf-8"))]
    return [one for one in found if not uses or set(one.uses) & set(uses)]


def write(entries: Collection[Listed], path: Path = FILE) -> None:
    """Write a list, a line for each kernel."""
    lines = ",\n".join(json.dumps(entry._asdict()) for entry in entries)
    path.write_text(f"[\n{lines}\n]\n", encoding="utf-8")


def encode(kind: Any) -> Any:
    """Return a type as text, as lists of text for tuples, or as a mapping for named tuples and arrays of records.

    Raises:
        TypeError: It is none that kernels are called with from Python.
    """
    from numba import types
    from numba.np.numpy_support import as_dtype

    if isinstance(kind, types.Array):
        access = "" if kind.mutable else " readonly"
        shape = f"{kind.ndim}{kind.layout}{access}"
        if isinstance(kind.dtype, types.Record):
            # What has no name lies between fields that are aligned.
            fields = [list(field) for field in as_dtype(kind.dtype).descr if field[0]]
            return {"record": fields, "shape": shape} | ({"aligned": True} if kind.dtype.aligned else {})
        return f"{kind.dtype} {shape}"
    if isinstance(kind, types.BaseNamedTuple):
        owner = kind.instance_class
        return {"class": f"{owner.__module__}:{owner.__qualname__}", "fields": [encode(one) for one in kind.types]}
    if isinstance(kind, types.BaseTuple):
        return [encode(one) for one in kind.types]
    if decode(str(kind)) != kind:
        raise TypeError(f"{kind} is no type of an argument from Python")
    return str(kind)


def digest(arguments: list[Any]) -> str:
    """Return a digest of the types of a kernel's arguments, as ``Listed`` has them."""
    return hashlib.sha256(json.dumps(arguments).encode()).hexdigest()[:12]


def decode(text: Any) -> Any:
    """Return the type of a text."""
    import numpy as np
    from numba import from_dtype, types

    if isinstance(text, list):
        return types.BaseTuple.from_types([decode(one) for one in text])
    if isinstance(text, dict) and "record" in text:
        record = np.dtype([tuple(field) for field in text["record"]], align=text.get("aligned", False))
        return _array(from_dtype(record), text["shape"])
    if isinstance(text, dict):
        module, name = text["class"].split(":")
        owner = getattr(import_module(module), name)
        return types.BaseTuple.from_types([decode(one) for one in text["fields"]], owner)
    scalar, _, shape = text.partition(" ")
    kind = getattr(types, {"bool": "boolean"}.get(scalar, scalar))
    return _array(kind, shape) if shape else kind


def _array(kind: Any, shape: str) -> Any:
    """Return the type of an array: its dimensions and layout, and whether it is read-only, as ``encode`` says."""
    from numba import types

    return types.Array(kind, int(shape[0]), shape[1], readonly=shape[2:] == " readonly")


def resolve(entries: Collection[Listed]) -> Iterator[tuple[Any, tuple[Any, ...]]]:
    """Give each kernel, and the types that it is called with."""
    for entry in entries:
        yield getattr(import_module(entry.module), entry.name), tuple(map(decode, entry.arguments))
