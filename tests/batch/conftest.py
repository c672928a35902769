"""A scheduler with a worker that the tests of a module share, as a user would start them."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from batches import serving


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """Address of a scheduler with a worker of one thread; Dask's configuration has the certificates for it."""
    with serving(n_workers=1, threads_per_worker=1) as address:
        yield address
