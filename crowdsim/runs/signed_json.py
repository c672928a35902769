"""JSON documents that hold their own checksum, so that any changed bit is found."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from crowdsim.errors import OutputError


def checksum(document: Mapping[str, Any]) -> str:
    """Return the SHA-256 of what a document says, without its own."""
    rest = {key: value for key, value in document.items() if key != "checksum"}
    return hashlib.sha256(json.dumps(rest, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def text_of(document: Mapping[str, Any]) -> str:
    """Return a document as it is written."""
    return json.dumps(document, indent=1) + "\n"


def signed_text(document: Mapping[str, Any]) -> str:
    """Return a document as it is written, with its checksum last."""
    rest = {key: value for key, value in document.items() if key != "checksum"}
    return text_of({**rest, "checksum": checksum(rest)})


def write_signed(path: Path, partial: Path, document: Mapping[str, Any]) -> None:
    """Write a document with its checksum to ``partial``, which is then renamed to ``path``.

    Raises:
        OutputError: It cannot be written; ``partial`` is removed.
    """
    try:
        with open(partial, "w", encoding="utf-8") as file:
            file.write(signed_text(document))
            file.flush()
            # What it says must be on disk before it has its name.
            os.fsync(file.fileno())
        os.replace(partial, path)
    except OSError as error:
        with suppress(OSError):
            partial.unlink(missing_ok=True)
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None
