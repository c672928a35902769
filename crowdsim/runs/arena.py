"""The arena of a recorded run, which its take does not hold: pictures show its border."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from pydantic import TypeAdapter, ValidationError

from crowdsim.core.types import Array
from crowdsim.crowd.cast import pack_arena
from crowdsim.files import open_plain
from crowdsim.runs.folder import RESOLVED
from crowdsim.scenario.parts import Arena


def read_arena(folder: Path) -> Array:
    """Return the arena of the scenario that was run in a folder, see ``pack_arena``. Shape (5,).

    Ground is open where the scenario is not there any more or says nothing that can be read.
    """
    try:
        with open_plain(folder, RESOLVED) as file:
            scenario = yaml.safe_load(file.read())
        arena: Any = TypeAdapter(Arena).validate_python(scenario["arena"])
    except (OSError, ValueError, KeyError, TypeError, yaml.YAMLError, ValidationError):
        return np.zeros(5)
    return pack_arena(arena)
