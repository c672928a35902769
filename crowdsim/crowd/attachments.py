"""Attachments of types as capsules on joints, which takes record and poses carry along."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crowdsim.config.files import Finding
from crowdsim.core.types import Array
from crowdsim.crowd.meshes import THINNEST, MeshError, face_rods, read_obj
from crowdsim.crowd.props import PROP
from crowdsim.errors import nearest
from crowdsim.motion import quaternion
from crowdsim.motion.body import ROLES, Body
from crowdsim.scenario.attachments import BoxAttachment, CapsulesAttachment, MeshAttachment

if TYPE_CHECKING:
    from crowdsim.crowd.cast import Cast
    from crowdsim.motion.database import MotionDatabase
    from crowdsim.policy.policy import Policy
    from crowdsim.scenario.scenario import Scenario

WOOD = (0.45, 0.29, 0.14)
_FARTHEST = 20.0
"""Greatest coordinate of props in the frames of their joints [m]."""
_EDGE = 0.02
"""Radius of the edges of boxes at the most [m]."""
_BUTT, _POMMEL = 0.12, 0.02
"""How far behind the hand the stick of a policy's own prop begins, over its length, and its least radius [m]."""


def pack_attachments(scenario: Scenario, policies: Mapping[str, Policy]) -> Array:
    """Return what avatars of each type carry, those without ``attachments`` what their policy strikes with.

    Args:
        scenario: The scenario, resolved.
        policies: Its policies by name.

    Returns:
        Shape (P,), ``PROP``, in the order of types.
    """
    rows: list[Any] = []
    for number, (name, kind) in enumerate(scenario.types.items()):
        if name not in scenario.used_types:
            continue
        database = policies[kind.policy].database
        if kind.attachments is None:
            rows += [(number, *row) for row in _own_props(database)]
            continue
        for one in kind.attachments:
            joint = _joint_of(database, one.joint)
            assert joint is not None
            colour = _rgb(one.colour)
            turn = _rotation(one.rotation)
            for start, end, radius in _capsules(one, scenario.folder):
                ends = [quaternion.rotate(turn, np.asarray(point, float)) + one.offset for point in (start, end)]
                rows.append((number, joint, *map(tuple, ends), radius, colour, one.blocks))
    return np.array(rows, PROP)


def attachment_findings(scenario: Scenario, policies: Mapping[str, Policy]) -> list[Finding]:
    """Return a finding for each attachment at a joint that is not there, whose mesh cannot be read, or that is huge.

    Args:
        scenario: The scenario, resolved.
        policies: Policies by name; types of others are passed over.
    """
    findings = []
    for name, kind in scenario.types.items():
        if name not in scenario.used_types or kind.policy not in policies:
            continue
        database = policies[kind.policy].database
        for index, one in enumerate(kind.attachments or ()):
            key = ("types", name, "attachments", index)
            if _joint_of(database, one.joint) is None:
                names = [*database.body.roles, *database.skeleton.names]
                what = f"{one.joint!r}, which the skeleton of policy {kind.policy!r} lacks{nearest(one.joint, names)}; "
                what += (
                    f"expected a role, {', '.join(role for role in ROLES if role in database.body.roles)}, or a joint"
                )
                findings.append(Finding((*key, "joint"), what))
            elif one.blocks and _joint_of(database, one.joint) not in _guard_joints(database.body):
                what = f"is true at {one.joint!r}, which holds no shield, expected a hand or an elbow"
                findings.append(Finding((*key, "blocks"), what))
            if isinstance(one, MeshAttachment) and scenario.folder is None:
                continue
            try:
                far = _farthest(one, scenario.folder)
            except MeshError as error:
                assert isinstance(one, MeshAttachment)
                findings.append(Finding((*key, "file"), f"{one.file!r} {error}"))
                continue
            if far > _FARTHEST:
                what = f"leads to {far:.3g} m from the joint along an axis, expected at most {_FARTHEST:g} m"
                findings.append(Finding((*key, _size_key(one)), what))
    return findings


def shield_radii(cast: Cast, numbers: Array, body: Body) -> Array:
    """Return the radii of left and right forearm, and of left and right glove, that shields make, for scale 1 [m].

    Args:
        cast: All avatars.
        numbers: Numbers of some of them, of one policy. Shape (n,).
        body: The body of that policy.

    Returns:
        0 where there is no shield. Shape (n, 4), float32.
    """
    shields = cast.attachments[cast.attachments["blocks"]]
    radii = np.zeros((len(cast.type_names), 4), np.float32)
    for kind in np.unique(shields["type"]):
        for column, joint in enumerate(_guard_joints(body)):
            mine = shields[(shields["type"] == kind) & (shields["joint"] == joint)]
            if len(mine):
                ends, thick = np.concatenate([mine["start"], mine["end"]]), np.tile(mine["radius"], 2)[:, None]
                size = (ends + thick).max(axis=0) - (ends - thick).min(axis=0)
                radii[kind, column] = 0.5 * float(np.sort(size)[1])
    return radii[np.asarray(cast.types)[numbers]]


def _guard_joints(body: Body) -> list[int]:
    """Return left and right elbow, left and right hand."""
    return [body.roles[f"{side}_{role}"] for role in ("elbow", "hand") for side in ("left", "right")]


def _joint_of(database: MotionDatabase, name: str) -> int | None:
    """Return a joint by its role or its name; None where there is none."""
    roles, names = database.body.roles, database.skeleton.names
    if name in roles:
        return int(roles[name])
    return names.index(name) if name in names else None


def _own_props(database: MotionDatabase) -> list[tuple[Any, ...]]:
    """Return the sticks that lead from hands to the points of a policy's props that strike."""
    rows = []
    for prop in database.body.props:
        tip = np.asarray(prop["offset"], float)
        fist = database.body.fist_offsets[prop["side"]]
        butt = fist - _BUTT * (tip - fist)
        radius = max(float(prop["radius"]), 1e-3)
        rows.append((int(prop["joint"]), tuple(butt), tuple(tip), radius, WOOD, False))
    return rows


def _capsules(one: CapsulesAttachment | BoxAttachment | MeshAttachment, folder: Path | None) -> Sequence[Any]:
    """Return both ends and the radius of each capsule of a prop, in its own frame."""
    if isinstance(one, CapsulesAttachment):
        return [(capsule.start, capsule.end, capsule.radius) for capsule in one.capsules]
    if isinstance(one, BoxAttachment):
        return _box_capsules(np.asarray(one.size, float))
    vertices, triangles = read_obj(Path(folder or ".") / one.file)
    return [(rod[:3], rod[3:6], rod[6]) for rod in face_rods(one.scale * vertices, triangles)]


def _farthest(one: CapsulesAttachment | BoxAttachment | MeshAttachment, folder: Path | None) -> float:
    """Return the greatest coordinate of a prop's points in the joint's frame [m]."""
    # Capsules are made of meshes only where that is small.
    with np.errstate(over="ignore", invalid="ignore"):
        if isinstance(one, MeshAttachment):
            points = one.scale * read_obj(Path(folder or ".") / one.file)[0]
        else:
            points = np.array([point for capsule in _capsules(one, folder) for point in capsule[:2]], float)
        found = np.abs(quaternion.rotate(_rotation(one.rotation), points) + one.offset)
    return float(np.nan_to_num(found, nan=np.inf, posinf=np.inf).max())


def _size_key(one: CapsulesAttachment | BoxAttachment | MeshAttachment) -> str:
    """Return the key that says most about how large a prop is."""
    if isinstance(one, MeshAttachment):
        return "file" if one.scale == 1.0 else "scale"
    return "capsules" if isinstance(one, CapsulesAttachment) else "size"


def _box_capsules(size: Array) -> list[tuple[Array, Array, float]]:
    """Return capsules side by side in two of a box's three directions, along the longest of them."""
    along = int(np.argmax(size))
    others = [axis for axis in range(3) if axis != along]
    radius = min(0.5 * float(size[others].min()), max(_EDGE, 0.08 * float(size[others].max())))
    radius = max(radius, THINNEST)
    half = 0.5 * size - np.minimum(radius, 0.5 * size)
    steps = [np.linspace(-half[axis], half[axis], int(np.ceil(half[axis] / (0.7 * radius))) + 1) for axis in others]
    capsules = []
    for at in itertools.product(*steps):
        # What lies inside of others is not seen.
        if all(abs(value) < half[axis] - 1e-9 for axis, value in zip(others, at, strict=True)):
            continue
        start, end = np.zeros(3), np.zeros(3)
        start[others], end[others] = at, at
        start[along], end[along] = -half[along], half[along]
        capsules.append((start, end, radius))
    return capsules


def _rotation(angles: Sequence[float]) -> Array:
    """Return the rotation about x, then y, then z by angles [deg]."""
    turns = [quaternion.from_rotation_vector(np.radians(angle) * np.eye(3)[axis]) for axis, angle in enumerate(angles)]
    return np.asarray(quaternion.multiply(turns[2], quaternion.multiply(turns[1], turns[0])))


def _rgb(colour: str | None) -> tuple[float, ...]:
    return WOOD if colour is None else tuple(int(colour[place : place + 2], 16) / 255.0 for place in (1, 3, 5))
