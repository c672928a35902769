"""The reference page of scenario files, and the table of outputs in that of commands."""

from __future__ import annotations

import json
import re

from crowdsim.config.reference import reference_page
from crowdsim.scenario.output import Extent, Series
from crowdsim.scenario.outputs import REGISTRY

_HEAD = """# Scenario files

Every key of a scenario, from the schema that checks it. Lengths are in metres, times in seconds or control frames as
stated, angles in degrees; x points to the left and z ahead of an avatar with heading 0. Required keys have no default.
Avatars and targets are at most 4,000 m from the origin along x and z: takes and exports have single precision, whose
steps are a quarter of a millimetre there, and further away they would show.
`crowdsim validate FILE` reports every error in a file; `--set groups[0].count=12` changes a key for one run.
A file has at most 1 MiB of UTF-8, 100,000 values, 64 levels, 10,000 keys in a mapping, and 10,000 types, groups and
events each. Of more than 100 findings the first 100 are reported. Files of points lie in the scenario's folder or below
it.

<!-- Written from the schema by crowdsim.scenario.reference; do not edit. -->
"""


def scenario_reference() -> str:
    """Return docs/scenarios.md: every key of a scenario with its type, its default and its meaning."""
    from crowdsim.scenario.scenario import scenario_schema

    return reference_page(json.loads(scenario_schema()), _HEAD)


def with_outputs(page: str) -> str:
    """Return docs/commands.md with its table of outputs made anew: keys, files, and the keys that each has."""
    lines = ["| output | | files | keys |", "|---|---|---|---|"]
    for name, output in REGISTRY.items():
        files = [
            f"`{one.names()[0]}`, ..." if isinstance(one, Series) else f"`{one}`"
            for one in output().files(Extent(1, 1, 15.0), ["NAME"])
        ]
        about = output.about.replace("|", "\\|")
        keys = ", ".join(f"`{key}`" for key in output.model_fields)
        lines.append(f"| `{name}` | {about} | {', '.join(files) or '`take.zarr`'} | {keys} |")
    table = "\n".join(lines)
    return re.sub(
        r"(<!-- outputs -->\n).*?(\n<!-- end -->)", lambda found: found[1] + table + found[2], page, flags=re.DOTALL
    )
