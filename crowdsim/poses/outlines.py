"""Where what strikes stays on bodies: with its surface on theirs, as their skin is, not in it and not off it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from crowdsim.core.types import Array
from crowdsim.motion.body import HEIGHT, PARTS, Body
from crowdsim.motion.strikers import HANDS
from crowdsim.poses.capsules import PosedBodies, capsule_order, place_capsules, swelling_capsules, trunk_capsules
from crowdsim.poses.guards import unit

GIVES = 0.012
"""How far outside of the skin the middles of fists stay before and after strikes that land [m]; gloves give way."""
WRIST_IN = 0.01
"""How deep the wrist behind a fist may be in trunk and head [m]."""
_FIT = {
    "pelvis": (0.0, 0.0, 0.0, 0.0),
    "trunk": (0.036, -0.006, -0.010, -0.010),
    "chest": (0.049, -0.014, 0.002, -0.008),
    "shoulders": (0.0, -0.007, -0.002, -0.002),
    "neck": (0.0, 0.0, 0.015, 0.015),
    "head": (0.0, 0.003, -0.014, -0.014),
    "upper arm": (0.0, 0.0, 0.005, -0.003),
}
"""How the skin of a man of 1.75 m differs from capsules: to both sides and ahead, and in radius at both ends [m]."""
_GLOVE, _BARE = 1.14, 0.7
"""Radius of gloves and of bare fists as skins show them, as a share of that of a striker."""
_LOWER_ARMS = ("left_elbow", "left_hand", "right_elbow", "right_hand")
"""Roles of the joints that forearms and hands hang on."""
_ROUNDS, _BESIDE, _ENOUGH = 60, 12, 1e-4
"""Rounds at most in which a point goes onto the surface, the first of them in which it also goes out of forearms and
hands, and distance from the surface that may be left [m]."""


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


def striker_radii(body: Body, limbs: Array, scales: Array, bare: Array) -> Array:
    """Return the radii of what strikes as skins show it: limbs, sizes and whether hands are bare (n,) [m]."""
    radii = body.strikers["radius"][limbs] * scales
    return np.asarray(np.where(np.isin(limbs, HANDS), radii * np.where(bare, _BARE, _GLOVE), radii))


def find_surface(bodies: PosedBodies, arms: Array | bool = True) -> Surface:
    """Return the skin of trunks, heads and upper arms at one time.

    Capsules of a trunk are round. Each of those that go up it stands for two, side by side, since a trunk is wider than
    it is deep. ``arms`` says which bodies (n,) have upper arms.
    """
    return find_outlines(bodies, arms)[0]


def find_outlines(bodies: PosedBodies, arms: Array | bool = True) -> tuple[Surface, Surface]:
    """Return what ``find_surface`` does, and the capsules of forearms and hands of bodies that have ``arms``."""
    body, order = bodies.body, capsule_order(bodies.body)
    kinds = _surface_kinds(body)[order]
    shown = kinds != ""
    capsules = place_capsules([bodies], 1, len(bodies.columns))
    starts, ends = (values[0].astype(float) for values in (capsules.starts, capsules.ends))
    lower = np.isin(body.capsule_joints[order], [body.roles[role] for role in _LOWER_ARMS])
    thick = np.where(np.reshape(arms, (-1, 1, 1)), capsules.radii[:, lower], -1.0)
    lower_arms = Surface(starts[:, lower], ends[:, lower] - starts[:, lower], thick)
    up, side = (unit((ends - starts)[:, order == one][:, 0]) for one in _upper_trunk(body))
    ahead, starts, kinds = np.cross(up, side), starts[:, shown], kinds[shown]
    axes = ends[:, shown] - starts
    fits = np.array([_FIT[kind] for kind in kinds])
    widths = np.where(swelling_capsules(body.capsule_parts[order[shown]]), np.asarray(bodies.girths)[:, None], 1.0)
    widths = widths * (np.asarray(bodies.scales, float) * body.height / HEIGHT)[:, None]
    radii = capsules.radii[:, shown] + fits[:, 2:] * widths[..., None]
    radii[np.ix_(~np.broadcast_to(arms, len(radii)), kinds == "upper arm")] = -1.0
    aside, forward = (fits[:, k, None] * widths[..., None] * way[:, None] for k, way in enumerate((side, ahead)))
    starts, twice = starts + forward, fits[:, 0] > 0.0
    surface = Surface(
        np.concatenate([starts - aside, (starts + aside)[:, twice]], axis=1),
        np.concatenate([axes, axes[:, twice]], axis=1),
        np.concatenate([radii, radii[:, twice]], axis=1),
    )
    return surface, lower_arms


def _surface_kinds(body: Body) -> Array:
    """Return what each capsule is in ``_FIT``, empty where skins are not looked for. Shape (K,), str."""
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


def upper_arms(body: Body) -> list[Array]:
    """Return which capsules of a body's surface are its left, and its right, upper arm."""
    order = capsule_order(body)
    kinds, joints = _surface_kinds(body)[order], body.capsule_joints[order]
    shown = kinds != ""
    sides = [joints == body.roles[f"{side}_shoulder"] for side in ("left", "right")]
    return [np.flatnonzero(((kinds == "upper arm") & side)[shown]) for side in sides]


def _upper_trunk(body: Body) -> tuple[int, int]:
    """Return the capsules of the chest and across the shoulders, which are one where a trunk has no other."""
    trunk = trunk_capsules(body)
    return int(trunk[-2:][0]), int(trunk[-1])


def touch_surface(
    points: Array, wrists: Array | None, radii: Array, surface: Surface, beside: Surface | None = None
) -> Array:
    """Return where the middles of spheres are that touch bodies, nearest to given points by going out or in.

    The wrist behind each goes along. Where it would be deeper than ``WRIST_IN``, the sphere goes around the body, as
    far as it still touches. It also stays out of ``beside``.

    Args:
        points: One for each body [m]. Shape (n, 3).
        wrists: Way from each to its wrist [m]; None without. Shape (n, 3).
        radii: Radii of the spheres [m]. Shape (n,).
        surface: The bodies.
        beside: What else the spheres stay out of; None without.
    """
    found, moving = points.copy(), np.flatnonzero(np.isfinite(points).all(axis=1))
    for step in range(_ROUNDS):
        here, own, before = found[moving], Surface(*(values[moving] for values in surface)), found[moving]
        if wrists is not None:
            gaps, out = own.gaps(here + wrists[moving])
            here = here + np.maximum(-WRIST_IN - gaps, 0.0)[:, None] * out
        if beside is not None and beside.radii.size and step < _BESIDE:
            gaps, out = Surface(*(values[moving] for values in beside)).gaps(here)
            here = here + np.maximum(radii[moving] - gaps, 0.0)[:, None] * out
        gaps, out = own.gaps(here)
        found[moving] = here = here + (radii[moving] - gaps)[:, None] * out
        moving = moving[np.linalg.norm(here - before, axis=1) > _ENOUGH]
        if not len(moving):
            break
    return found
