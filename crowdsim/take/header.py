"""Constants of a take, as its attributes hold them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from crowdsim.crowd.cast import USUAL_BODY, Cast
from crowdsim.take.layout import COORDINATES, FORMAT, VERSION


@dataclass(frozen=True)
class TakeHeader:
    """Constants of a take, known before its first frame; see ``TakeData``."""

    cast: Cast
    control_rate: float
    scenario: str
    seed: int
    fingerprints: tuple[str, ...]
    target_names: tuple[str, ...] = ()
    reactions: bool = True
    collision_avoidance: bool = True

    def attributes(self, frames: int) -> dict[str, Any]:
        """Return the attributes of the take while it grows, of which ``frames`` control frames are planned."""
        cast = self.cast
        props = {"attachments": cast.attachments, "faces": cast.faces}
        bodies = [{"sex": sex, "hands": hands} for sex, hands in cast.bodies]
        return {
            "format": FORMAT,
            "version": VERSION,
            "scenario": self.scenario,
            "seed": self.seed,
            "control_rate": self.control_rate,
            "status": "running",
            "frames_planned": frames,
            "type_names": list(cast.type_names),
            "team_names": list(cast.team_names),
            "policy_names": list(cast.policy_names),
            "policy_fingerprints": list(self.fingerprints),
            "target_names": list(self.target_names),
            **({"group_names": list(cast.group_names)} if cast.group_names else {}),
            "reactions": self.reactions,
            "collision_avoidance": self.collision_avoidance,
            # xarray reads coordinates that are no dimensions from here.
            "coordinates": " ".join(COORDINATES),
            "type_colours": [[None if math.isnan(c) else float(c) for c in row] for row in cast.colours],
            **({"type_bodies": bodies} if set(cast.bodies) - {USUAL_BODY} else {}),
            **{key: [_plain(row) for row in rows] for key, rows in props.items() if len(rows)},
        }


def _plain(row: Any) -> dict[str, Any]:
    """Return a row of what avatars carry as plain data."""
    return {name: row[name].tolist() for name in row.dtype.names}
