"""Files in the folder of a batch, which may come from strangers: checked, and read only where they are not too long."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from crowdsim.config.documents import document_fault, parse_json
from crowdsim.errors import BatchError
from crowdsim.files import open_plain

MAXIMUM_BYTES = 8_000_000
"""Longest file that is read; the plan of 100,000 runs has about 6 MB."""


def read_bytes(folder: Path, name: str, most: int = MAXIMUM_BYTES) -> bytes:
    """Return what a regular file inside a folder holds; nothing where there is no such file.

    Raises:
        BatchError: It is no regular file inside the folder, longer than ``most`` bytes, or cannot be read.
    """
    try:
        with open_plain(folder, name) as file:
            data = file.read(most + 1)
    except FileNotFoundError:
        return b""
    except OSError as error:
        raise BatchError(f"{folder / name}: cannot be read: {error.strerror or error}") from None
    if len(data) > most:
        raise BatchError(f"{folder / name}: is too long, expected at most {most:,} bytes")
    return data


def read_document(folder: Path, name: str, model: type[BaseModel]) -> dict[str, Any]:
    """Return a JSON document that fits a model; nothing where the file is missing or empty.

    Raises:
        BatchError: It is no regular file inside the folder, too long, or damaged.
    """
    data = read_bytes(folder, name)
    if not data:
        # Empty is a file that was not on disk yet when the machine went down.
        return {}
    try:
        document = parse_json(data.decode("utf-8"))
        if b"\\u" in data:
            json.dumps(document, ensure_ascii=False).encode("utf-8")  # halves of letters cannot be written again
        fault = document_fault(model, document)
    except ValueError as error:
        fault = str(error)
    if fault:
        raise BatchError(f"{folder / name}: is damaged: {fault}")
    return dict(document)
