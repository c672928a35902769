"""Kernels as Python and as other kernels call them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numba
from numba import types

from crowdsim.jit.cache import KernelCache
from crowdsim.jit.compilers import KernelCompiler, PartCompiler


def build_dispatcher(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """Return what Python calls instead of a function; kernels that name it call its part (``compilers``).

    Args:
        function: The function.
        options: numba's options.
    """
    dispatcher: Any = numba.njit(pipeline_class=KernelCompiler, no_cfunc_wrapper=True, **options)(function)
    dispatcher._cache = KernelCache(function, part=False)

    @cache
    def part() -> Any:
        one: Any = numba.njit(pipeline_class=PartCompiler, no_cfunc_wrapper=True, no_cpython_wrapper=True, **options)(
            function
        )
        one._cache = KernelCache(function, part=True)
        one.add_overload = lambda result: one.overloads.update({tuple(result.signature.args): result})
        return one

    def get_call_template(args: Any, kws: Any) -> Any:
        plain = {name: types.unliteral(kind) for name, kind in kws.items()}
        return part().get_call_template(tuple(map(types.unliteral, args)), plain)

    dispatcher.get_call_template = get_call_template
    dispatcher.get_overload = lambda signature: part().get_overload(signature)
    return dispatcher
