"""What a worker is: versions and processor, on which bytes depend, and whether it sees the folder of a batch."""

from __future__ import annotations

import os
import platform
import socket
import uuid
from importlib import metadata
from pathlib import Path
from typing import Any

from crowdsim.errors import OutputError
from crowdsim.files import write_text
from crowdsim.runs.origin import origin_of

TOKEN = ".crowdsim-batch-token"


def describe_environment() -> dict[str, Any]:
    """Return what the results of this process depend on, beside scenarios and policies.

    Returns:
        ``versions`` of crowdsim, its sources, Python and packages, and the ``processor``.
    """
    document = origin_of("", ()).document()
    more = {"python": platform.python_version(), "distributed": metadata.version("distributed")}
    return {"versions": {**document["versions"], **more}, "processor": document["processor"]}


def place_token(folder: Path) -> str:
    """Write what a worker must find in the folder of a batch, and return it.

    Raises:
        OutputError: The folder cannot be written.
    """
    token = uuid.uuid4().hex
    write_text(folder / TOKEN, token)
    return token


def describe_worker(folder: str, token: str) -> dict[str, Any]:
    """Return what this process is, and how it sees the folder of a batch.

    Returns:
        The ``environment``, ``host``, and ``folder``: what is wrong with it, nothing where it is the right one.
    """
    path = Path(folder)
    try:
        found = (path / TOKEN).read_text(encoding="utf-8")
        wrong = "" if found == token else "is another folder"
        if not wrong:
            write_text(path / f"{TOKEN}-{socket.gethostname()}-{os.getpid()}", token)
            (path / f"{TOKEN}-{socket.gethostname()}-{os.getpid()}").unlink()
    except FileNotFoundError:
        wrong = "is not there"
    except (OSError, OutputError) as error:
        wrong = f"cannot be used: {error}"
    return {"environment": describe_environment(), "host": socket.gethostname(), "folder": wrong}
