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
    """Return a type as text, or as lists of text for tuples.

    Raises:
        TypeError: It is none that kernels are called with from Python.
    """
    from numba import types

    if isinstance(kind, types.Array):
        access = "" if kind.mutable else " readonly"
        return f"{kind.dtype} {kind.ndim}{kind.layout}{access}"
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
    from numba import types

    if isinstance(text, list):
        return types.BaseTuple.from_types([decode(one) for one in text])
    if isinstance(text, dict):
        module, name = text["class"].split(":")
        owner = getattr(import_module(module), name)
        return types.BaseTuple.from_types([decode(one) for one in text["fields"]], owner)
    scalar, *rest = text.split(" ")
    kind = getattr(types, {"bool": "boolean"}.get(scalar, scalar))
    if not rest:
        return kind
    return types.Array(kind, int(rest[0][0]), rest[0][1], readonly=rest[1:] == ["readonly"])


def resolve(entries: Collection[Listed]) -> Iterator[tuple[Any, tuple[Any, ...]]]:
    """Give each kernel, and the types that it is called with."""
    for entry in entries:
        yield getattr(import_module(entry.module), entry.name), tuple(map(decode, entry.arguments))
