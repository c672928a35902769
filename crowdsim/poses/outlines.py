"""Where what strikes stays on bodies: with its surface on theirs, as their skin is, not in it and not off it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from crowdsim.core.types import Array
from crowdsim.core.workers import share
from crowdsim.motion import quaternion
from crowdsim.motion.body import HEIGHT, PARTS, Body
from crowdsim.motion.strikers import HANDS
from crowdsim.poses.capsules import PosedBodies, capsule_order, place_capsules, swelling_capsules, trunk_capsules
from crowdsim.poses.facing import face_direction
from crowdsim.poses.guards import unit
from crowdsim.poses.kernels.touching import touch_bodies
from crowdsim.poses.skins import ACROSS, BODIES, HAND_BALLS, PIECES

GIVES = 0.012
"""How far outside of the skin the middles of fists stay before and after strikes that land [m]; gloves give way."""
WRIST_IN = 0.01
"""How deep the wrist behind a fist may be in trunk and head around strikes [m]."""
GIVES_WAY, LIFTED = 0.002, 0.008
"""How deep cuffs and thumbs may be where fists touch, and how far off fists may be where they are deeper [m]."""
GLOVE_PADDING = 0.02
"""How much thicker gloves are than their capsules, by their thumbs most [m]."""
_LOWER_ARMS = ("left_elbow", "left_hand", "right_elbow", "right_hand")
"""Roles of the joints that forearms and hands hang on."""


class Surface(NamedTuple):
    """Skins of trunks, heads and upper arms as capsules; n bodies.

    Attributes:
        starts: One end of each axis [m]. Shape (n, K, 3).
        axes: Way from it to the other end [m]. Shape (n, K, 3).
        radii: Radius at both ends [m]. Shape (n, K, 2).
    """

    starts: Array
    axes: Array
    radii: Array

    def gaps(self, points: Array) -> tuple[Array, Array]:
        """Return how far points (n, 3) are outside, negative inside (n,) [m], and the way out (n, 3), of length 1."""
        squares = np.maximum(np.sum(self.axes * self.axes, axis=-1), 1e-12)
        way = points[:, None] - self.starts
        along = np.clip(np.sum(way * self.axes, axis=-1) / squares, 0.0, 1.0)
        out = way - along[..., None] * self.axes
        far = np.linalg.norm(out, axis=-1)
        gaps = far - self.radii[..., 0] - along * (self.radii[..., 1] - self.radii[..., 0])
        nearest = np.arange(len(points)), np.argmin(gaps, axis=1)
        return gaps[nearest], out[nearest] / np.maximum(far[nearest], 1e-9)[:, None]


class Balls(NamedTuple):
    """What strikes, as balls; n strikers of B.

    Attributes:
        offsets: Their middles, from that of the first, which is what lands [m]. Shape (n, B, 3).
        radii: Shape (n, B) [m].
    """

    offsets: Array
    radii: Array


def striker_radii(body: Body, limbs: Array, scales: Array, bare: Array) -> Array:
    """Return the radii of what strikes as skins show it: limbs, sizes and whether hands are bare (n,) [m]."""
    gloves, fists = (HAND_BALLS[kind][0, 3] * body.height / HEIGHT for kind in ("gloves", "bare"))
    radii = np.where(np.isin(limbs, HANDS), np.where(bare, fists, gloves), body.strikers["radius"][limbs])
    return np.asarray(radii * scales)


def hand_axes(body: Body, hinges: Array) -> Array:
    """Return along, front and outwards of both hands in their frames, as they hang at rest. Shape (2, 3, 3).

    Args:
        body: The body.
        hinges: Axes about which elbows bend, see ``Limbs``. Shape (2, 3).
    """
    along = unit(np.asarray(body.fist_offsets, float))
    front = unit(np.cross(hinges, along))
    return np.stack([along, front, np.cross(front, along) * [[1.0], [-1.0]]], axis=1)


def hand_balls(body: Body, hinges: Array, hands: Array, scales: Array, bare: Array) -> Balls:
    """Return fists with thumbs and wrists as balls, in the frames of hands.

    Args:
        body: The body.
        hinges: Axes about which elbows bend, see ``Limbs``. Shape (2, 3).
        hands: 0 left, 1 right. Shape (n,).
        scales: Sizes. Shape (n,).
        bare: Whether hands are bare. Shape (n,), bool.
    """
    balls = np.where(bare[:, None, None], HAND_BALLS["bare"], HAND_BALLS["gloves"])
    balls = balls * (scales * body.height / HEIGHT)[:, None, None]
    return Balls(balls[..., :3] @ hand_axes(body, hinges)[hands], balls[..., 3])


def find_surface(bodies: PosedBodies, sexes: Array, arms: Array | bool = True) -> Surface:
    """Return the skin of trunks, heads and upper arms at one time; arguments as of ``find_outlines``."""
    return find_outlines(bodies, sexes, arms)[0]


def find_outlines(
    bodies: PosedBodies, sexes: Array, arms: Array | bool = True, bare: Array | bool = True
) -> tuple[Surface, Surface]:
    """Return the skin of trunks, heads and upper arms at one time, and the capsules of forearms and hands.

    Args:
        bodies: Bodies at one time.
        sexes: Sex of each. Shape (n,), str.
        arms: Which bodies have arms. Shape (n,).
        bare: Which have no gloves, which are thicker than their capsules. Shape (n,).
    """
    body, order, girths = bodies.body, capsule_order(bodies.body), np.asarray(bodies.girths, float)
    pieces, widths = np.empty((len(girths), len(PIECES), 2, 4)), np.empty(len(girths))
    for sex in np.unique(sexes):
        own = np.flatnonzero(sexes == sex)
        known = np.array(list(BODIES[sex]))
        nearest = np.argmin(np.abs(girths[own, None] - known), axis=1)
        pieces[own], widths[own] = np.array(list(BODIES[sex].values()))[nearest], girths[own] / known[nearest]
    surface = lay_pieces(bodies, pieces, widths, arms)
    lower = np.isin(body.capsule_joints[order], [body.roles[role] for role in _LOWER_ARMS])
    capsules = place_capsules([bodies], 1, len(bodies.columns))
    starts, ends = (values[0][:, lower].astype(float) for values in (capsules.starts, capsules.ends))
    thick = capsules.radii[:, lower].astype(float)
    thick[:, body.capsule_parts[order[lower]] == PARTS.index("glove")] += np.where(
        np.reshape(bare, (-1, 1, 1)), 0.0, GLOVE_PADDING * np.reshape(bodies.scales, (-1, 1, 1))
    )
    thick = np.where(np.reshape(arms, (-1, 1, 1)), thick, -1.0)
    return surface, Surface(starts, ends - starts, thick)


def lay_pieces(bodies: PosedBodies, pieces: Array, girths: Array, arms: Array | bool = True) -> Surface:
    """Return the capsules that pieces of skin make on bodies.

    Args:
        bodies: Bodies at one time.
        pieces: Pieces of each. Shape (n, P, 2, 4).
        girths: Its girth over that for which they are. Shape (n,).
        arms: Which bodies have upper arms. Shape (n,).
    """
    body, order = bodies.body, capsule_order(bodies.body)
    kinds, capsules, own, signs = _lay_out(body)
    placed = place_capsules([bodies], 1, len(bodies.columns))
    starts, ends = (values[0].astype(float) for values in (placed.starts, placed.ends))
    chest, across = (int(np.flatnonzero(order == one)[0]) for one in _upper_trunk(body))
    up, side = (unit(ends[:, one] - starts[:, one]) for one in (chest, across))
    # A collar goes from the trunk to where an arm hangs, which moves in it.
    arm = np.flatnonzero(kinds[: len(order)] == "upper arm")
    right = (body.capsule_joints[order[arm]] == body.roles["right_shoulder"]).astype(int)
    inner = np.stack([starts[:, across], ends[:, across]], axis=1)[:, right]
    starts, ends = np.concatenate([starts, inner], axis=1), np.concatenate([ends, starts[:, arm]], axis=1)
    swells = swelling_capsules(body.capsule_parts[order])
    swells = np.append(swells, swells[arm])
    axes = np.stack([side, np.cross(up, side), up], axis=1)[:, None].repeat(len(own), axis=1)
    face, crown = face_direction(body), unit(np.asarray(body.head_offset, float))
    head = bodies.rotations[0][:, None, body.roles["head"]].astype(float)
    axes[:, kinds[capsules] == "head"] = quaternion.rotate(head, np.stack([np.cross(crown, face), face, crown]))[
        :, None
    ]
    upper = kinds[capsules] == "upper arm"
    axes[:, upper, 2] = unit((ends - starts)[:, capsules[upper]])
    numbers = pieces[:, own].astype(float)
    # What lies across a body has its other end on the other side.
    turned = (signs < 0.0) & np.isin(kinds[capsules], ACROSS)
    numbers[:, turned] = numbers[:, turned, ::-1]
    numbers[..., 0] *= signs[:, None]
    widths = np.where(swells[capsules], girths[:, None], 1.0)
    numbers *= (widths * (np.asarray(bodies.scales, float) * body.height / HEIGHT)[:, None])[..., None, None]
    offsets, radii = numbers[..., :3] @ axes, numbers[..., 3]
    radii[np.ix_(~np.broadcast_to(arms, len(radii)), upper)] = -1.0
    starts, ends = starts[:, capsules] + offsets[:, :, 0], ends[:, capsules] + offsets[:, :, 1]
    return Surface(starts, ends - starts, radii)


def _surface_kinds(body: Body) -> Array:
    """Return what each capsule is in ``PIECES``, empty where skins are not looked for. Shape (K,), str."""
    joints, parts = body.capsule_joints, np.array(PARTS)[body.capsule_parts]
    of_limbs = np.isin(joints, [joint for role, joint in body.roles.items() if role.startswith(("left", "right"))])
    upper_arms = np.isin(joints, [body.roles["left_shoulder"], body.roles["right_shoulder"]])
    names = {"trunks": "pelvis", "shirt": "trunk", "skin": "neck", "head": "head"}
    kinds = np.array([names.get(part, "") for part in parts], dtype="U9")
    kinds[of_limbs] = ""
    kinds[upper_arms & (parts == "skin")] = "upper arm"
    for one, kind in zip(_upper_trunk(body), ("chest", "shoulders"), strict=True):
        kinds[one] = kind
    return kinds


def _lay_out(body: Body) -> tuple[Array, Array, Array, Array]:
    """Return kinds of capsules, collars behind them (K,), and of each row of a surface capsule, piece and side (S,)."""
    order = capsule_order(body)
    kinds = _surface_kinds(body)[order]
    arm = np.flatnonzero(kinds == "upper arm")
    is_right = body.capsule_joints[order[arm]] == body.roles["right_shoulder"]
    sides = np.append(np.ones(len(kinds)), np.where(is_right, 1.0, -1.0))
    kinds = np.append(kinds, np.full(len(arm), "collar"))
    rows = [
        (capsule, piece, sign * sides[capsule])
        for piece, (kind, twice) in enumerate(PIECES)
        for capsule in np.flatnonzero(kinds == kind)
        for sign in ((1.0, -1.0) if twice else (1.0,))
    ]
    capsules, own, signs = (np.array(column) for column in zip(*rows, strict=True))
    return kinds, capsules, own, signs


def upper_arms(body: Body) -> list[Array]:
    """Return which rows of a body's surface are its left, and its right, upper arm."""
    kinds, capsules, _, _ = _lay_out(body)
    rows = np.flatnonzero(kinds[capsules] == "upper arm")
    joints = body.capsule_joints[capsule_order(body)][capsules[rows]]
    return [rows[joints == body.roles[f"{side}_shoulder"]] for side in ("left", "right")]


def _upper_trunk(body: Body) -> tuple[int, int]:
    """Return the capsules of the chest and across the shoulders, which are one where a trunk has no other."""
    trunk = trunk_capsules(body)
    return int(trunk[-2:][0]), int(trunk[-1])


def touch_surface(points: Array, balls: Balls, surface: Surface, beside: Surface | None = None) -> Array:
    """Return where the middles of strikers are that touch bodies, nearest to given points by going out or in.

    Their first balls touch. Where others would be deeper than ``GIVES_WAY``, strikers go around the body, as far as the
    first still touches; where that does not do, they go out, by ``LIFTED`` at the most. They also stay out of
    ``beside``.

    Args:
        points: Middle of the first ball, one for each body [m]. Shape (n, 3).
        balls: The strikers.
        surface: The bodies.
        beside: What else they stay out of; None without.
    """
    if beside is None:
        beside = Surface(*(values[:, :0] for values in surface))
    body, arms = (Surface(*(np.ascontiguousarray(values) for values in one)) for one in (surface, beside))
    found = np.array(points, dtype=float)
    share(len(found), touch_bodies, balls.offsets, balls.radii, GIVES_WAY, LIFTED, body, arms, found, threads=1)
    return found
