"""The decorator of compiled kernels."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any


def kernel(
    function: Callable[..., Any] | None = None,
    *,
    inline: bool = False,
    allocates: bool = False,
    fastmath: Collection[str] = (),
    name: str = "",
) -> Any:
    """Compile a function with numba when it is first called, without the GIL, and keep the compiled code.

    The code is kept in a folder that is named by a digest of every source that the kernel depends on: its own file and,
    in turn, the files of this package that are imported there. A kernel may therefore call kernels of other files and
    use their constants: an edit recompiles what depends on the file, and nothing else.

    A kernel that is called by others becomes part of them before anything is optimised, so that each line is optimised
    once for each kernel that Python calls, and what is called by kernels alone needs no conversion of Python's objects
    (``compilers``). It has one signature for all values of a type: literals do not make another.

    Args:
        function: The function; without it, a decorator with these options is returned.
        inline: The compiled code becomes part of each caller, which saves passing arrays; it allocates nothing.
        allocates: Whether the kernel creates arrays. Then it counts references, which costs two atomic operations for
            every array that is passed to it or read from a named tuple; where most time is spent nothing is created.
        fastmath: LLVM's flags for faster arithmetic that the kernel permits.
        name: Its name, which must be the only one of a file, where the function is defined anew for each of several
            uses.
    """
    if function is None:
        return lambda wanted: kernel(wanted, inline=inline, allocates=allocates, fastmath=fastmath, name=name)
    if name:
        function.__name__ = function.__qualname__ = name
    from numba import config

    from crowdsim.jit.dispatchers import build_dispatcher

    options: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
    if fastmath:
        options["fastmath"] = set(fastmath)
    if inline or not allocates:
        options["_nrt"] = False
    if inline:
        options["forceinline"] = True
    if config.DISABLE_JIT:  # type: ignore[attr-defined]
        return function
    return build_dispatcher(function, options)
