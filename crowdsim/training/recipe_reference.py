"""The JSON Schema of recipe files and their reference page."""

from __future__ import annotations

import json

from crowdsim.config.reference import reference_page
from crowdsim.policy.axes.registry import AXES
from crowdsim.training.recipe import Recipe

_HEAD = """# Recipe files

Every key of a training recipe, from the schema that checks it. Lengths are metres, times seconds, angles radians. A key
without a default must be given. `crowdsim validate FILE` names everything that is wrong with a recipe, and
`crowdsim train FILE` trains it. The shipped recipes are examples: `boxer.yaml` of the embedded boxer, `boxer_cmu.yaml`
of capture, `boxer_defender.yaml` of a boxer that learns in fights to defend itself, `boxer_paper.yaml` of the paper's
method, `stick_fighter.yaml` of a performer with a stick. A file has at most 1 MiB of UTF-8, 100,000 values and 64
levels; names of clips cannot lead out of the folder of capture.

<!-- Written from the schema by crowdsim.training.recipe_reference; do not edit. -->
"""

_AXES = """
## What axes observe

A grid has a distance and up to four other axes. Control looks an axis up by what it observes in the fight. In training
nobody else acts, so each axis has a model of how the target develops while an action of the avatar runs: Q of an action
is its reward plus the value of what the axes measure at its end, and rewards see the target as it moves meanwhile. With
a `velocity` values are those of moving targets; without one control reads them for where a moving target will be some
time later. An `impact` changes what is learned with the reward `hit`, and when a behaviour counts with a `fade`.

| axis | control observes | in training |
|---|---|---|
"""


def recipe_schema() -> str:
    """Return the JSON Schema of recipe files as text; editors complete and check recipes by it."""
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **Recipe.model_json_schema()}
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def recipe_reference() -> str:
    """Return docs/recipes.md: every key of a recipe with its type, its default and its meaning, and what axes see."""
    rows = "".join(f"| `{kind.name}` | {kind.observed} | {kind.trained} |\n" for kind in AXES)
    return reference_page(json.loads(recipe_schema()), _HEAD) + _AXES + rows
