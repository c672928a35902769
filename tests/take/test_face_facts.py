"""Triangles that a take says avatars carry are checked before any is used."""

from copy import deepcopy
from typing import Any

import pytest

from crowdsim.config.documents import document_fault
from crowdsim.take.metadata import TakeAttributes

FACE = {"type": 0, "joint": 3, "corners": [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0]], "colour": [0.5] * 3,
        "blocks": False}  # fmt: skip
TAKE = {
    "format": "crowdsim-take", "version": 1, "scenario": "held", "seed": 1, "control_rate": 15.0, "status": "done",
    "frames_planned": 9,
    "type_names": ["boxer"], "team_names": ["red"], "policy_names": ["boxer"], "policy_fingerprints": ["0" * 64],
    "target_names": [], "type_colours": [[None, None, None]],
}  # fmt: skip


def test_triangles_that_a_run_writes_are_taken() -> None:
    assert document_fault(TakeAttributes, {**TAKE, "faces": [FACE]}) == ""
    assert document_fault(TakeAttributes, TAKE) == ""


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("type", 1),
        ("type", -1),
        ("joint", 1 << 20),
        ("corners", FACE["corners"][:2]),
        ("corners", [[1e9, 0.0, 0.0]] * 3),
        ("corners", [[float("nan"), 0.0, 0.0]] * 3),
        ("colour", [2.0, 0.0, 0.0]),
        ("blocks", 1),
    ],
)
def test_others_are_refused_by_where_they_are(key: str, value: Any) -> None:
    face = {**deepcopy(FACE), key: value}
    assert document_fault(TakeAttributes, {**TAKE, "faces": [FACE, face]}).startswith(f"faces[1].{key}")


def test_more_triangles_than_a_crowd_carries_are_refused() -> None:
    assert document_fault(TakeAttributes, {**TAKE, "faces": [FACE] * ((1 << 18) + 1)}).startswith("faces")
