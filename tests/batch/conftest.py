"""A scheduler with two workers that the tests of a module share, as a user would start them."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from batches import serving


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """Address of a scheduler with two workers of one thread; Dask's configuration has the certificates for it."""
    with serving(n_workers=2, threads_per_worker=1) as address:
        yield address
