"""Type aliases that every package shares."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    from numpy.typing import NDArray

Array: TypeAlias = "NDArray[Any]"
"""A NumPy array; docstrings give shapes and units."""

Progress: TypeAlias = Callable[[str, int, int], None]
"""Called with (stage, done, total) as work goes on."""

FileName: TypeAlias = str | os.PathLike[str]
"""A path as callers may give it."""
