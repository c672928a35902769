"""How kernels are compiled: each with all that it calls, at once.

numba optimises and compiles each function by itself, with what it calls, and again as a part of each caller. Here a
kernel that is called by others (a *part*) is kept as LLVM's intermediate code, neither optimised nor compiled, and
without the wrappers that convert Python's objects; the kernels that Python calls link it, and all is optimised once.
"""

from __future__ import annotations

import gc
import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import llvmlite.binding as llvm
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder, compile_result
from numba.core.environment import lookup_environment
from numba.core.itanium_mangler import mangle

_ENVIRONMENT = "_ZN08NumbaEnv"


class KernelLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Code of a kernel that Python calls."""

    def _optimize_functions(self, module: Any) -> None:
        """Simplify functions, those alone that are defined here; numba does as much for each that is called."""
        if not hasattr(self._codegen, "_pass_builder"):
            # Older versions of numba have one manager of passes for all functions.
            super()._optimize_functions(module)
            return
        module.data_layout = self._codegen._data_layout
        for function in module.functions:
            if not function.is_declaration:
                manager, builder = self._codegen._function_pass_manager()
                manager.run(function, builder)

    def finalize(self) -> None:
        """Optimise, compile, and give each part the environment that it was compiled in."""
        super().finalize()
        for variable in self._final_module.global_variables:
            if variable.name.startswith(_ENVIRONMENT):
                environment = lookup_environment(variable.name)
                if environment is not None:
                    self._codegen.set_env(variable.name, environment)

    def serialize_using_object_code(self) -> Any:
        """Return machine code and the names in it; kernels that call this one link its part instead."""
        name, kind, (machine_code, _) = super().serialize_using_object_code()
        module = self._final_module
        lines = [f'@"{one.name}" = global i8 0' for one in module.global_variables if not one.is_declaration]
        lines += [f'define void @"{one.name}"() {{ ret void }}' for one in module.functions if not one.is_declaration]
        return name, kind, (machine_code, llvm.parse_assembly("\n".join(lines)).as_bitcode())


class PartLibrary(KernelLibrary):
    """Code of a kernel for its callers."""

    def finalize(self) -> None:
        """Link what the kernel calls; nothing is compiled."""
        for library in dict.fromkeys(self._linking_libraries):
            getattr(self, "_reload_init", set()).update(getattr(library, "_reload_init", ()))
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        # numba does this to a copy of the module, which each part would then hold beside its own.
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == llvm.Linkage.external:
                function.linkage = llvm.Linkage.linkonce_odr
        self._finalized = True


class KernelCompiler(CompilerBase):  # type: ignore[misc]
    """Compiles a kernel that Python calls."""

    library = KernelLibrary

    def define_pipelines(self) -> list[Any]:
        """Return numba's own passes."""
        return [DefaultPassBuilder.define_nopython_pipeline(self.state)]

    def compile_extra(self, function: Any) -> Any:
        """Compile a function."""
        self.state.targetctx.mangler = _short_name
        self.state.library = self.library(self.state.targetctx.codegen(), function.__qualname__)
        self.state.library.enable_object_caching()
        with _no_garbage_collection():
            return super().compile_extra(function)


class PartCompiler(KernelCompiler):
    """Translates a kernel into a part of others."""

    library = PartLibrary

    def compile_extra(self, function: Any) -> Any:
        """Translate a function, and make it known to those that call it."""
        self.state.flags.no_compile = True
        result = super().compile_extra(function)._replace(entry_point=object())
        # Most of the memory that it took is in reference cycles. This frees them, and scans no older objects.
        gc.collect(0)
        result.target_context.insert_user_function(result.entry_point, result.fndesc, [result.library])
        return result


def _short_name(name: str, kinds: tuple[Any, ...], *, abi_tags: tuple[str, ...] = (), uid: int | None = None) -> str:
    """Return the name of a compiled function; numba's own spells out the types, which takes kilobytes for records."""
    kind = hashlib.sha256(" ".join(map(str, kinds)).encode()).hexdigest()[:16]
    return str(mangle(f"{name}.{kind}", (), abi_tags=abi_tags, uid=uid))


def pack_part(result: Any) -> tuple[Any, ...]:
    """Return a part in a form that can be pickled."""
    description = result.fndesc
    description.typemap = description.calltypes = None
    code = result.library._final_module.as_bitcode()
    return result.library.name, code, description, result.environment, result.signature, result.reload_init


def unpack_part(target_context: Any, payload: tuple[Any, ...]) -> Any:
    """Return a part that was packed."""
    name, code, description, environment, signature, reload_init = payload
    for initialise in reload_init:
        initialise()
    library = PartLibrary(target_context.codegen(), name)
    library._final_module = llvm.parse_bitcode(code)
    library._finalized = True
    return compile_result(
        typing_context=target_context.typing_context,
        target_context=target_context,
        entry_point=object(),
        library=library,
        signature=signature,
        objectmode=False,
        lifted=(),
        fndesc=description,
        environment=environment,
        reload_init=reload_init,
        referenced_envs=(),
    )


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """Pause garbage collection: most of what a compiler creates lives until it ends, and collecting takes a quarter."""
    before = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if before:
            gc.enable()
