"""JSON documents that hold their own checksum, so that any changed bit is found."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any


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
