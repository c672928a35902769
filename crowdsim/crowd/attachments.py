"""Attachments of types as capsules and triangles on joints, which takes record and poses carry along."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crowdsim.config.files import Finding
from crowdsim.core.types import Array
from crowdsim.crowd.meshes import THINNEST, MeshError, face_rods, read_obj
from crowdsim.crowd.props import FACE, PROP
from crowdsim.errors import nearest
from crowdsim.motion import quaternion
from crowdsim.motion.body import ROLES, Body
from crowdsim.motion.strikers import SIDES
from crowdsim.scenario.attachments import BoxAttachment, CapsulesAttachment, MeshAttachment

if TYPE_CHECKING:
    from crowdsim.crowd.cast import Cast
    from crowdsim.motion.database import MotionDatabase
    from crowdsim.policy.policy import Policy
    from crowdsim.scenario.scenario import Scenario

_Given = CapsulesAttachment | BoxAttachment | MeshAttachment
WOOD = (0.45, 0.29, 0.14)
_FARTHEST = 20.0
"""Greatest coordinate of props in the frames of their joints [m]."""
_EDGE = 0.02
"""Radius of the edges of boxes at the most [m]."""
_BUTT = 0.12
"""How far behind the hand the stick of a policy's own prop begins, over its length."""
_LONG = 0.2
"""How far a prop reaches beyond the fist that looks as if it strikes [m]."""
_SAME = 0.05
"""How far the end of a prop may be from the point that a policy strikes with [m]."""


def pack_attachments(scenario: Scenario, policies: Mapping[str, Policy]) -> tuple[Array, Array]:
    """Return what avatars of each type carry, those without ``attachments`` what their policy strikes with.

    Args:
        scenario: The scenario, resolved.
        policies: Its policies by name.

    Returns:
        Capsules (P,), ``PROP``, and triangles of meshes (T,), ``FACE``, both in the order of types.
    """
    rows, faces = list[Any](), list[Any]()
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
            if isinstance(one, MeshAttachment):
                vertices, triangles = read_obj(Path(scenario.folder or ".") / one.file)
                corners = _placed(one, one.scale * vertices)[triangles]
                faces += [(number, joint, face, colour, one.blocks) for face in corners]
                continue
            for start, end, radius in _capsules(one, scenario.folder):
                ends = _placed(one, np.array([start, end], float))
                rows.append((number, joint, *map(tuple, ends), radius, colour, one.blocks))
    return np.array(rows, PROP), np.array(faces, FACE)


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
            elif one.strikes and (what := _why_not_striking(one, scenario.folder, kind.policy, database)):
                findings.append(Finding((*key, "strikes"), f"is true, {what}"))
    return findings


def attachment_warnings(scenario: Scenario, policies: Mapping[str, Policy]) -> list[Finding]:
    """Return a finding for each prop that looks as if it strikes and does not, and for each that strikes unseen.

    Args:
        scenario: The scenario, resolved, whose attachments are right (``attachment_findings``).
        policies: Policies by name; types of others are passed over.
    """
    findings = []
    for name, kind in scenario.types.items():
        if name not in scenario.used_types or kind.policy not in policies or not kind.attachments:
            continue
        database = policies[kind.policy].database
        held: set[int | None] = set()
        for index, one in enumerate(kind.attachments):
            side = _hand_of(database, one.joint)
            if side is None:
                continue
            why = _why_not_striking(one, scenario.folder, kind.policy, database)
            if one.strikes is not None or not why:  # it strikes, or is meant not to
                held.add(_joint_of(database, one.joint))
                continue
            beyond = float(np.linalg.norm(_tip(one, scenario.folder, database, side)[0] - _fist(database, side)))
            if beyond >= _LONG and not one.blocks:
                held.add(_joint_of(database, one.joint))
                what = f"reaches {beyond:.2f} m out of the {SIDES[side]} fist and is only shown, {why}"
                findings.append(Finding(("types", name, "attachments", index), what))
        for prop in database.body.props:
            if int(prop["joint"]) not in held:
                what = (
                    f"hold nothing in the {SIDES[prop['side']]} hand that ends at {_shown(prop['offset'])}, the point "
                )
                what += f"with which policy {kind.policy!r} strikes; expected an attachment there that ends at it"
                findings.append(Finding(("types", name, "attachments"), what))
    return findings


def _why_not_striking(one: _Given, folder: Path | None, policy: str, database: MotionDatabase) -> str:
    """Return why the end of a prop strikes nothing, and what was expected; empty where it strikes."""
    side = _hand_of(database, one.joint)
    if side is None:
        return f"but {one.joint!r} is no hand; expected a hand"
    tip, radius = _tip(one, folder, database, side)
    learned = [prop["offset"] for prop in database.body.props if prop["side"] == side]
    if learned and float(np.linalg.norm(tip - learned[0])) <= _SAME + radius:
        return ""
    why = f"but policy {policy!r} has learned strikes "
    why += f"with the point {_shown(learned[0])} of a prop, which ends at {_shown(tip)}" if learned else "without it"
    row = f"{{hand: {SIDES[side]}, point: {_shown(tip)}, radius: {radius:.3g}}}"
    return (
        f"{why}, so that it would keep a wrong distance; expected a policy that is trained with it, by 'strikes: "
        f"{{limbs: [props], props: [{row}]}}' in its recipe, or 'strikes: false' here"
    )


def _hand_of(database: MotionDatabase, name: str) -> int | None:
    """Return the side of the hand that a joint is; None where it is none."""
    hands = _guard_joints(database.body)[2:]
    joint = _joint_of(database, name)
    return hands.index(joint) if joint in hands else None


def _fist(database: MotionDatabase, side: int) -> Array:
    return np.asarray(database.body.fist_offsets[side], float)


def _tip(one: _Given, folder: Path | None, database: MotionDatabase, side: int) -> tuple[Array, float]:
    """Return the end of a prop that is farthest from the fist, in the frame of the hand's joint, and its radius [m]."""
    capsules = _capsules(one, folder)
    ends = np.array([point for capsule in capsules for point in capsule[:2]], float)
    ends = _placed(one, ends)
    farthest = int(np.argmax(np.linalg.norm(ends - _fist(database, side), axis=1)))
    return ends[farthest], float(capsules[farthest // 2][2])


def _shown(point: Array | Sequence[float]) -> str:
    return f"[{', '.join(f'{round(float(value), 3) + 0.0:g}' for value in point)}]"


def shield_radii(cast: Cast, numbers: Array, body: Body) -> Array:
    """Return the radii of left and right forearm, and of left and right glove, that shields make, for scale 1 [m].

    Args:
        cast: All avatars.
        numbers: Numbers of some of them, of one policy. Shape (n,).
        body: The body of that policy.

    Returns:
        0 where there is no shield. Shape (n, 4), float32.
    """
    shields = cast.held[cast.held["blocks"]]
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


def _capsules(one: _Given, folder: Path | None) -> Sequence[Any]:
    """Return both ends and the radius of each capsule of a prop, in its own frame."""
    if isinstance(one, CapsulesAttachment):
        return [(capsule.start, capsule.end, capsule.radius) for capsule in one.capsules]
    if isinstance(one, BoxAttachment):
        return _box_capsules(np.asarray(one.size, float))
    vertices, triangles = read_obj(Path(folder or ".") / one.file)
    return [(rod[:3], rod[3:6], rod[6]) for rod in face_rods(one.scale * vertices[triangles])[0]]


def _farthest(one: _Given, folder: Path | None) -> float:
    """Return the greatest coordinate of a prop's points in the joint's frame [m]."""
    # Capsules are made of meshes only where that is small.
    with np.errstate(over="ignore", invalid="ignore"):
        if isinstance(one, MeshAttachment):
            points = one.scale * read_obj(Path(folder or ".") / one.file)[0]
        else:
            points = np.array([point for capsule in _capsules(one, folder) for point in capsule[:2]], float)
        found = np.abs(_placed(one, points))
    return float(np.nan_to_num(found, nan=np.inf, posinf=np.inf).max())


def _size_key(one: _Given) -> str:
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


def _placed(one: _Given, points: Array) -> Array:
    """Return points (n, 3) of a prop's frame in that of its joint: rotated about x, then y, then z, and moved."""
    x, y, z = (quaternion.from_rotation_vector(turn) for turn in np.diag(np.radians(one.rotation)))
    return np.asarray(quaternion.rotate(quaternion.multiply(z, quaternion.multiply(y, x)), points) + one.offset)


def _rgb(colour: str | None) -> tuple[float, ...]:
    return WOOD if colour is None else tuple(int(colour[place : place + 2], 16) / 255.0 for place in (1, 3, 5))
