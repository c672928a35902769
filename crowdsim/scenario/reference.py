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
events each. Of more than 100 findings the first 100 are reported. Files of points and tables lie in the scenario's
folder or below it.

## Avatars from a table

A table names each avatar, and may give each one a heading, a type and a team. The names are those in lists, files,
labels and messages, and those that cameras and `--avatars` take. `cast.csv`:

```csv
name,x [m],z [m],heading [degrees],type,team
Anna,-1,0,90,quick,red
Cleo,-1.5,1.5,,quick,red
Ben,1,0,-90,heavy,blue
Dov,1.5,1.5,,,blue
```

```yaml
version: 1
name: cast
duration: 20s
types:
  quick: {policy: boxer, speed: 1.1}
  heavy: {policy: boxer, scale: 1.1, girth: 1.2}
groups:
- {name: four, type: heavy, placement: {kind: table, file: cast.csv}}
opponents: {kind: other_team}
outputs:
  bvh: {avatars: [Anna, blue]}
```

Columns have any order, and may have a unit behind their name. An empty cell is as the group says: Dov is of type
`heavy`, and avatars without a heading look at the middle of the group. The column `number`, from 0, says in which order
avatars are numbered; without it that is the order of rows. A `count` below the number of rows takes the first ones. No
avatar is called like a group, a team or a type, and names differ in more than capitals. `crowdsim validate` reports
what is wrong with line and column of the table too.

## Entrances and exits

The avatars of a group with `enter` appear one by one at the start of a path, walk or run along it, and then fight. An
event of kind `leave` lets avatars go away along a path, at whose end they leave the scene.

```yaml
version: 1
name: door
duration: 40s
types: {boxer: {policy: boxer_crowd, damage: {}}}
groups:
- {name: red, team: red, type: boxer, count: 3, placement: {kind: line, start: [-1.5, 0], end: [1.5, 0]}}
- {name: blue, team: blue, type: boxer, count: 3, enter: {path: [[-2, -8], [0, -4.5], [0, -2.5]], rate: 1}}
- name: late
  team: blue
  type: boxer
  count: 4
  waits: true
  enter: {path: [[9, 4], [5, 4]], rate: 2, gait: run, until: end}
  placement: {kind: grid, centre: [3, 4]}
opponents: {kind: other_team}
events:
- {kind: add, group: late, when: {kind: seconds, seconds: 10}}
- {kind: leave, group: blue, health_below: 40, path: [[0, -4.5], [-2, -8]], when: {kind: frame, frame: 0}}
- {kind: leave, group: red, path: [[-8, 0]], gait: run, when: {kind: seconds, seconds: 30}}
```

An avatar enters when its time has come, at `rate` avatars per second, and the start is free; until then it waits, and
the others behind it. It looks along the path. A group that has a `placement` too goes on to that from the end of its
path, each avatar to its own position. A path leads straight from point to point; avatars go around bodies on the
floor and avoid one another, and cross the border of an arena. On its way an avatar has no opponent and throws no
strikes, but others may fight it: by default one that enters fights back from then on (`until: attacked`), and one
that leaves does not (`until: end`). Those that are knocked down go on when they are up, and those that stay down
stay. Without a `group` all leave that can, so that on the condition `ended` the winners do. Opponents of avatars that
leave follow them; an event of kind `rest` or `watch` keeps them back. Avatars travel by the motion that their policy
has, in their guard: `crowdsim validate` warns where that is clearly slower than the gait.

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
