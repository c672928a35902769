"""Which body an avatar has, and how rough its parts are."""

from __future__ import annotations

from crowdsim.body.anatomy import GIRTHS, Build
from crowdsim.body.parts import SKIN_PARTS
from crowdsim.crowd.cast import Cast

_ROUGHNESS = {
    "skin": 0.55,
    "lips": 0.45,
    "eyes": 0.3,
    "pupils": 0.15,
    "hair": 0.75,
    "brows": 0.8,
    "gloves": 0.35,
    "shoes": 0.5,
}
_USUAL_ROUGHNESS = 0.85


def usual_build(girth: float, sex: str = "male", hands: str = "gloves") -> Build:
    """Return the build of an avatar of a girth."""
    return Build(sex, min(GIRTHS, key=lambda kind: abs(GIRTHS[kind] - girth)), hands)


def build_of(cast: Cast, avatar: int) -> Build:
    """Return the build of an avatar: by its girth, and of the sex and with the hands of its type."""
    return usual_build(float(cast.girths[avatar]), *cast.bodies[cast.types[avatar]])


def roughness(part: int) -> float:
    """Return how rough a part is, 0 a mirror and 1 chalk."""
    return _ROUGHNESS.get(SKIN_PARTS[part], _USUAL_ROUGHNESS)
