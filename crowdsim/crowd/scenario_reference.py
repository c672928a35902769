"""The reference page of scenario files."""

from __future__ import annotations

import json

from crowdsim.yaml_reference import reference_page

_HEAD = """# Scenario files

Every key of a scenario, from the schema that checks it. Lengths are metres, times seconds or control frames as said,
angles degrees; x points to the left and z ahead of an avatar with heading 0. A key without a default must be given.
`crowdsim validate FILE` names everything that is wrong with a file; `--set groups[0].count=12` changes a key for a run.

<!-- Written from the schema by crowdsim.crowd.scenario_reference; do not edit. -->
"""


def scenario_reference() -> str:
    """Return docs/scenarios.md: every key of a scenario with its type, its default and its meaning."""
    from crowdsim.crowd.scenario import scenario_schema

    return reference_page(json.loads(scenario_schema()), _HEAD)
