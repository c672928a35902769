"""Kernels as Python and as other kernels call them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numba
from numba import types
from numba.core.compiler_lock import global_compiler_lock

from crowdsim.jit.cache import KernelCache
from crowdsim.jit.compilers import KernelCompiler, PartCompiler


def build_dispatcher(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """Return what Python calls instead of a function; kernels that name it call its part (``compilers``).

    Args:
        function: The function.
        options: numba's options.
    """
    dispatcher: Any = numba.njit(pipeline_class=KernelCompiler, no_cfunc_wrapper=True, **options)(function)
    _keep(dispatcher, KernelCache(function, part=False))

    @cache
    def part() -> Any:
        one: Any = numba.njit(pipeline_class=PartCompiler, no_cfunc_wrapper=True, no_cpython_wrapper=True, **options)(
            function
        )
        one.add_overload = lambda result: one.overloads.update({tuple(result.signature.args): result})
        _keep(one, KernelCache(function, part=True))
        return one

    def get_call_template(args: Any, kws: Any) -> Any:
        plain = {name: types.unliteral(kind) for name, kind in kws.items()}
        return part().get_call_template(tuple(map(types.unliteral, args)), plain)

    dispatcher.get_call_template = get_call_template
    dispatcher.get_overload = lambda signature: part().get_overload(signature)
    return dispatcher


def _keep(dispatcher: Any, kept: KernelCache) -> None:
    """Keep what is compiled, and compile nothing that another process compiles at this moment.

    A process that holds a kernel waits for those that it calls, never the reverse, so none wait in a circle.
    """
    compile_now = dispatcher.compile

    def compile_once(signature: tuple[Any, ...]) -> Any:
        codegen = dispatcher.targetctx.codegen()
        # Threads wait here, before they hold a kernel.
        with global_compiler_lock:
            if tuple(signature) in dispatcher.overloads or kept.path(signature, codegen).is_file():
                return compile_now(signature)
            with kept.hold(signature, codegen):
                return compile_now(signature)

    dispatcher._cache = dispatcher.kept = kept
    dispatcher.compile_held = compile_now
    dispatcher.compile = compile_once
