"""The JSON Schema of batch files and their reference page."""

from __future__ import annotations

import json

from crowdsim.batch.description import Batch
from crowdsim.config.reference import reference_page

_HEAD = """# Batch files

Every key of a batch file, from the schema that checks it. Required keys have no default. [batch.md](batch.md) has an
example; `crowdsim batch FILE --dry-run` reports every error in a file, and lists its runs.

<!-- Written from the schema by crowdsim.batch.reference; do not edit. -->
"""


def batch_schema() -> str:
    """Return the JSON Schema of batch files as text; editors complete and check batches by it."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **Batch.model_json_schema()}
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def batch_reference() -> str:
    """Return docs/batch_files.md: every key of a batch file with its type, its default and its meaning."""
    return reference_page(json.loads(batch_schema()), _HEAD)
