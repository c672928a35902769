"""A scheduler with two workers that the tests of a module share, as a user would start them."""

from __future__ import annotations

import logging
from collections.abc import Iterator

import pytest


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """Address of a scheduler with two workers of one thread; Dask's configuration has the certificates for it."""
    import dask
    from distributed import LocalCluster, Security

    security = Security.temporary()
    own = {
        "ca-file": security.tls_ca_file,
        "client.cert": security.tls_client_cert,
        "client.key": security.tls_client_key,
    }
    with (
        LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=logging.CRITICAL, security=security
        ) as cluster,
        dask.config.set({f"distributed.comm.tls.{key}": value for key, value in own.items()}),
    ):
        yield cluster.scheduler_address
