"""What is constant for each avatar over a run: name, team, body and temperament, which takes record."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from crowdsim.core.types import Array
from crowdsim.crowd.meshes import face_rods
from crowdsim.crowd.props import FACE, PROP
from crowdsim.errors import TakeError, nearest

_USUAL: dict[str, tuple[float, Any]] = {
    "girths": (1.0, np.float32),
    "legs": (1.0, np.float32),
    "arms": (1.0, np.float32),
    "tempos": (math.nan, np.float32),
    "aggressions": (1.0, np.float32),
    "ranges": (0.0, np.float32),
    "stances": (0, np.uint8),
}
"""What avatars are like whose take does not say."""
USUAL_BODY = ("male", "gloves")
"""Sex and hands of a body, likewise."""


def _unknown() -> Array:
    return np.zeros(0)


@dataclass(frozen=True)
class Cast:
    """What is constant for each avatar over a run; N avatars.

    Attributes:
        names: Name of each avatar. Shape (N,), str.
        types: Index into ``type_names``. Shape (N,), int16.
        teams: Index into ``team_names``. Shape (N,), int16.
        policies: Index into ``policy_names``. Shape (N,), int16.
        scales: Size of the body over its skeleton's. Shape (N,), float32.
        speeds: Motion frames in a control frame. Shape (N,), float32.
        type_names: Names of the avatar types.
        team_names: Names of the teams.
        policy_names: Names of the policies.
        colours: Colour of each type, red, green, blue in 0..1; NaN where the scenario gives none. Shape (types, 3).
        girths: How thick trunk and limbs are for their length. Shape (N,), float32.
        legs: How long thighs and shanks are for the size of the body. Shape (N,), float32.
        arms: How long upper arms and forearms are for it. Shape (N,), float32.
        tempos: Strikes a minute that the avatar can sustain, NaN for one that never tires. Shape (N,), float32.
        aggressions: How readily it strikes, as a factor. Shape (N,), float32.
        ranges: How much further than others it keeps from its opponent while it rests [m]. Shape (N,), float32.
        stances: 0 any, 1 orthodox, 2 southpaw. Shape (N,), uint8.
        groups: Index into ``group_names``. Shape (N,), int32, or (0,) where names of avatars begin with those of their
            groups.
        group_names: Names of the groups, or none, likewise.
        attachments: What avatars of each type carry, but for meshes. Shape (P,), ``PROP``.
        faces: Triangles of the meshes that they carry. Shape (T,), ``FACE``.
        bodies: Sex and hands of the body of each type, words of ``scenario.looks``.
    """

    names: Array
    types: Array
    teams: Array
    policies: Array
    scales: Array
    speeds: Array
    type_names: tuple[str, ...]
    team_names: tuple[str, ...]
    policy_names: tuple[str, ...]
    colours: Array
    girths: Array = field(default_factory=_unknown)
    legs: Array = field(default_factory=_unknown)
    arms: Array = field(default_factory=_unknown)
    tempos: Array = field(default_factory=_unknown)
    aggressions: Array = field(default_factory=_unknown)
    ranges: Array = field(default_factory=_unknown)
    stances: Array = field(default_factory=_unknown)
    groups: Array = field(default_factory=_unknown)
    group_names: tuple[str, ...] = ()
    attachments: Array = field(default_factory=lambda: np.zeros(0, PROP))
    faces: Array = field(default_factory=lambda: np.zeros(0, FACE))
    bodies: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        """Give all avatars of takes that do not record them the usual body and temperament."""
        for name, (usual, dtype) in _USUAL.items():
            if len(getattr(self, name)) == 0:
                object.__setattr__(self, name, np.full(len(self.names), usual, dtype))
        if not self.bodies:
            object.__setattr__(self, "bodies", (USUAL_BODY,) * len(self.type_names))

    @cached_property
    def held(self) -> Array:
        """What avatars of each type carry as capsules: ``attachments``, and rods on ``faces``. Shape (n,), ``PROP``."""
        found, of = face_rods(self.faces["corners"].astype(float))
        rods = np.empty(len(of), PROP)
        for name in ("type", "joint", "colour", "blocks"):
            rods[name] = self.faces[name][of]
        rods["start"], rods["end"], rods["radius"] = found[:, :3], found[:, 3:6], found[:, 6]
        return np.concatenate([self.attachments, rods])

    def number(self, avatar: int | str) -> int:
        """Return the number of an avatar that is given by its number or its name, with or without its leading zeros.

        Raises:
            TakeError: There is no such avatar; the message names near ones.
        """
        names = self.names
        if isinstance(avatar, str):
            group, _, number = avatar.rpartition("_")
            padded = [f"{group}_{int(number):0{width}d}" for width in range(1, 10) if number.isdecimal()]
            for name in (avatar, *padded):
                found = np.flatnonzero(names == name)
                if len(found):
                    return int(found[0])
            raise TakeError(f"there is no avatar {avatar!r}, expected a number, or {_names_like(avatar, names)}")
        if not isinstance(avatar, int | np.integer) or isinstance(avatar, bool):
            raise TakeError(f"avatar {avatar!r} is of type {type(avatar).__name__}, expected a number or a name")
        if not 0 <= avatar < len(names):
            raise TakeError(f"there is no avatar {avatar}, expected 0 to {len(names) - 1}, or its name")
        return int(avatar)

    def members(self, name: int | str) -> Array:
        """Return the numbers of the avatars that a number or name means: an avatar, a group, a team or a type.

        Raises:
            TakeError: There is none of these; the message names near ones.
        """
        if isinstance(name, str) and not (self.names == name).any():
            if not self.group_names:
                of_group = np.char.rpartition(np.asarray(self.names, str), "_")[:, 0] == name
                if of_group.any():
                    return np.flatnonzero(of_group)
            for known, each in (
                (self.group_names, self.groups),
                (self.team_names, self.teams),
                (self.type_names, self.types),
            ):
                if name in known:
                    return np.flatnonzero(np.asarray(each) == known.index(name))
        return np.array([self.number(name)])

    def numbers(self, avatars: ArrayLike | None) -> Array:
        """Return the numbers of avatars that are given by numbers or names, in any mixture; all when None.

        A name may be that of a group, a type or a team as well, see ``members``.

        Raises:
            TakeError: There is no such avatar; the message names near ones.
        """
        if avatars is None:
            return np.arange(len(self.names))
        given: Any = [avatars] if isinstance(avatars, str) or np.ndim(avatars) == 0 else avatars
        numbers = np.asarray(given)
        if numbers.dtype.kind in "iu" and ((numbers >= 0) & (numbers < len(self.names))).all():
            return numbers
        return np.concatenate([self.members(avatar) for avatar in given] or [np.zeros(0, np.int64)])

    def first(self, count: int) -> Cast:
        """Return what is constant for the first avatars."""
        each = ("names", "types", "teams", "policies", "scales", "speeds", "groups", *_USUAL)
        return replace(self, **{name: getattr(self, name)[:count] for name in each})

    @property
    def sexes(self) -> Array:
        """Sex of each avatar. Shape (N,), str."""
        return np.array([sex for sex, _ in self.bodies])[self.types]

    @property
    def bare(self) -> Array:
        """Which avatars have bare hands. Shape (N,), bool."""
        return np.asarray(np.array([hands == "bare" for _, hands in self.bodies], bool)[self.types])

    @cached_property
    def widths(self) -> Array:
        """How thick bodies are: sizes times girths. Shape (N,), float64."""
        return np.asarray(np.asarray(self.scales, float) * self.girths)

    @cached_property
    def stretches(self) -> Array:
        """How long bones of trunks, legs and arms are for the size of the body. Shape (N, 3), float64."""
        return np.stack([np.ones(len(self.legs)), self.legs, self.arms], axis=1).astype(float)


def _names_like(name: str, names: Array) -> str:
    """Return which names of avatars there are, by groups, and the one that may be meant by another name."""
    groups: dict[str, tuple[str, str]] = {}
    for one in names.tolist():
        stem, _, last = one.rpartition("_")
        group = stem if last.isdecimal() else one
        groups[group] = groups.get(group, (one, one))[0], one
    number = name.rpartition("_")[2]
    same = [f"{group}_{number.zfill(max(len(last) - len(group) - 1, 0))}" for group, (_, last) in groups.items()]
    firsts = [first for first, _ in groups.values()]
    ranges = [first if first == last else f"{first} to {last}" for first, last in groups.values()]
    more = [f"{len(ranges) - 5} more"] if len(ranges) > 5 else []
    near = nearest(name, [one for one in same if one in names]) or nearest(name, firsts)
    return f"{', '.join([*ranges[:5], *more])}{near}"
