"""One kernel for all kinds of axes, or of reward terms: it calls that of the kind."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from crowdsim.jit import kernel


def for_kinds(cases: Iterable[tuple[int, str, Any]]) -> Any:
    """Return a kernel that takes a kind and calls the kernel of that kind with what follows.

    Args:
        cases: Each kind, a name for the compiled call, and the kernel. The first one also stands for all kinds that
            are not among them.
    """
    chosen = None
    for kind, name, own in cases:
        chosen = _either(kind, f"{name}_or_others", own, chosen)
    return chosen


def _either(kind: int, name: str, own: Any, others: Any) -> Any:
    def call(given, *arguments):  # type: ignore[no-untyped-def]
        if given == kind:
            return own(*arguments)
        return others(given, *arguments)

    def call_own(given, *arguments):  # type: ignore[no-untyped-def]
        return own(*arguments)

    return kernel(call_own if others is None else call, inline=True, name=name)
