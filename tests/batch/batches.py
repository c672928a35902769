"""Batches of small scenarios, and what is compared of their runs."""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml
from scenes import write_scene

# What differs from time to time: when and how fast runs were, and the command.
CHANGING = {"manifest.json"}


def write_batch(folder: Path, scene: dict[str, Any] | None = None, **keys: Any) -> Path:
    """Write the scenario ``four`` and a batch of it into a folder."""
    write_scene(folder / "four.yaml", **(scene or {}))
    data = {"version": 1, "name": "trial", "scenarios": ["four.yaml"], **keys}
    path = folder / "trial.yaml"
    path.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    return path


def digests(folder: Path) -> dict[str, dict[str, str]]:
    """Return checksums of all files of all runs of a batch, by run, but of those that differ from time to time."""
    return {
        run.name: {
            path.relative_to(run).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in sorted(run.rglob("*"))
            if path.is_file() and path.name not in CHANGING
        }
        for run in sorted((folder / "runs").iterdir())
    }


def results(folder: Path) -> dict[str, dict[str, Any]]:
    """Return what came of the runs of a batch, by id."""
    return {path.stem: json.loads(path.read_text()) for path in sorted((folder / "results").glob("*.json"))}


@contextmanager
def serving(**workers: Any) -> Iterator[str]:
    """Give the address of a scheduler with some workers; Dask's configuration has the certificates for it."""
    import dask
    from distributed import LocalCluster, Security

    security = Security.temporary()
    own = {
        "ca-file": security.tls_ca_file,
        "client.cert": security.tls_client_cert,
        "client.key": security.tls_client_key,
    }
    with (
        LocalCluster(dashboard_address=None, silence_logs=logging.CRITICAL, security=security, **workers) as cluster,
        dask.config.set({f"distributed.comm.tls.{key}": value for key, value in own.items()}),
    ):
        yield cluster.scheduler_address
