"""What a take on disk holds, read and checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from crowdsim.array_checks import ArrayFault, Column, check_shape
from crowdsim.core.types import Array
from crowdsim.crowd.props import FACE, PROP
from crowdsim.errors import TakeError
from crowdsim.scenario.names import NAME_RULE, avatar_name_fault, is_name
from crowdsim.take import checks
from crowdsim.take.layout import CAST, EVENTS, FORMAT, LATER_CAST, VERSION
from crowdsim.take.lazy_arrays import StoredColumn
from crowdsim.take.metadata import ArrayFacts, TakeAttributes, check_first_chunks, read_metadata, read_model
from crowdsim.take.take import VARIABLES, Cast, Events, Take

_LATER = ("limb", "outcome", "damage", "down")
"""Variables of strikes that older takes do not have."""


def read_take(folder: Path, cast: Cast | None = None) -> Take:
    """Return what the group in a folder holds, which has no links in it.

    Args:
        folder: The folder.
        cast: What is constant for each avatar, where this process has written it; read and checked when None.

    Raises:
        TakeError: It is damaged, foreign or of another version, or its names are none that a scenario could have.
    """
    attributes = _read_attributes(folder)
    names = _read_names(folder) if cast is None else cast.names
    sizes = {
        "N": len(names),
        "G": len(attributes["target_names"]),
        "types": len(attributes["type_names"]),
        "teams": len(attributes["team_names"]),
        "policies": len(attributes["policy_names"]),
        "groups": len(attributes.get("group_names", ())),
    }
    cast = cast or _read_cast(folder, attributes, names, sizes)
    frames = _open_frames(folder, sizes)
    targets = np.zeros((sizes["F"], 0, 3), np.float32)
    return Take(
        **frames,
        cast=cast,
        targets=open_column(folder / "target", checks.TARGET, sizes) if sizes["G"] else targets,
        target_names=tuple(attributes["target_names"]),
        events=_read_events(folder / "events", sizes),
        control_rate=float(attributes["control_rate"]),
        scenario=attributes["scenario"],
        seed=attributes["seed"],
        fingerprints=tuple(attributes["policy_fingerprints"]),
        status=attributes["status"],
        # Takes written before this attribute existed have reactions.
        reactions=attributes.get("reactions", True),
        collision_avoidance=attributes.get("collision_avoidance", True),
    )


def _read_cast(folder: Path, attributes: Mapping[str, Any], names: Array, sizes: dict[str, int]) -> Cast:
    constant = {
        CAST[name]: open_column(folder / name, column, sizes)[:]
        for name, column in checks.CAST.items()
        if (name not in LATER_CAST or (folder / name).is_dir()) and (name != "group" or attributes.get("group_names"))
    }
    colours = [[np.nan if c is None else c for c in row] for row in attributes["type_colours"]]
    cast = Cast(
        names=names,
        **constant,
        type_names=tuple(attributes["type_names"]),
        team_names=tuple(attributes["team_names"]),
        policy_names=tuple(attributes["policy_names"]),
        group_names=tuple(attributes.get("group_names", ())),
        colours=np.array(colours, float).reshape(-1, 3),
        attachments=_read_rows(attributes.get("attachments", ()), PROP),
        faces=_read_rows(attributes.get("faces", ()), FACE),
        bodies=tuple((body["sex"], body["hands"]) for body in attributes.get("type_bodies", ())),
    )
    _check_names(folder, cast)
    return cast


def _read_rows(given: Sequence[Mapping[str, Any]], dtype: np.dtype[Any]) -> Array:
    """Return rows of what avatars of each type carry. Shape (n,), of a dtype."""
    rows = np.zeros(len(given), dtype)
    for name in dtype.names or ():
        for row, one in enumerate(given):
            rows[name][row] = one[name]
    return rows


def _read_attributes(folder: Path) -> dict[str, Any]:
    attributes = read_metadata(folder, ".zattrs")
    if not isinstance(attributes, dict) or attributes.get("format") != FORMAT:
        found = attributes.get("format") if isinstance(attributes, dict) else None
        raise TakeError(f"{folder}: is no take: its format is {found!r}, expected {FORMAT!r}")
    if attributes.get("version") != VERSION:
        raise TakeError(f"{folder}: is a take of version {attributes.get('version')!r}, expected {VERSION}")
    return read_model(folder, ".zattrs", TakeAttributes)


def open_column(folder: Path, column: Column, sizes: dict[str, int]) -> StoredColumn:
    """Return an array of a take for reading; dimensions that are new are added to ``sizes``.

    Raises:
        TakeError: Its type or shape is another one.
    """
    facts = read_model(folder, ".zarray", ArrayFacts)
    shape, dtype = tuple(facts["shape"]), np.dtype(facts["dtype"])
    try:
        check_shape(folder.name, dtype, shape, column, sizes)
    except ArrayFault as fault:
        raise TakeError(f"{folder}: {fault.what}") from None
    return StoredColumn(folder, shape, tuple(facts["chunks"]), dtype, column, sizes)


def _open_frames(folder: Path, sizes: dict[str, int]) -> dict[str, Any]:
    """Return what is recorded for every control frame and avatar, for reading."""
    found = {name: open_column(folder / name, column, sizes) for name, column in checks.FRAMES.items()}
    for name in checks.ABSENT:
        found[name] = replace(found[name], action=found["action"])
    # Nobody is the opponent of itself: what an avatar 0 fights is no 0, and its chunks are never left out.
    check_first_chunks(folder / "opponent", found["opponent"].shape, found["opponent"].chunks)
    return {name: found[name] for name in VARIABLES}


def _read_names(folder: Path) -> Array:
    """Return the names of the avatars. Shape (N,), text."""
    path = folder / "name"
    facts = read_model(folder, "name/.zarray", ArrayFacts)
    dtype, shape = np.dtype(facts["dtype"]), tuple(facts["shape"])
    if dtype.kind != "U" or len(shape) != 1:
        raise TakeError(f"{path}: holds {dtype}{shape}, expected a name an avatar")
    if not shape[0]:
        raise TakeError(f"{folder}: has no avatars, expected one or more")
    if shape[0] > facts["chunks"][0]:
        raise TakeError(f"{path}: is cut into several chunks, expected one")
    names = StoredColumn(path, shape, tuple(facts["chunks"]), dtype, Column(str(dtype), ("N",)), {})[:]
    try:
        names.tolist()
    except ValueError as error:
        raise TakeError(f"{path}: is damaged: {error}") from None
    return names


def _read_events(folder: Path, sizes: dict[str, int]) -> Events:
    """Return the strikes of a take."""
    # Without limbs all strikes are of hands, without outcomes those that did not land missed.
    recorded = [name for name in EVENTS if name not in _LATER or (folder / name).is_dir()]
    stored = {name: open_column(folder / name, checks.EVENTS[name], sizes) for name in recorded}
    # A strike is never without speed.
    check_first_chunks(folder / "speed", stored["speed"].shape, stored["speed"].chunks)
    read = {name: column[:] for name, column in stored.items()}
    try:
        checks.check_strikes(read)
    except ArrayFault as fault:
        raise TakeError(f"{folder / fault.name}: {fault.what}") from None
    return Events(**read)


def _check_names(folder: Path, cast: Cast) -> None:
    """Refuse names that a scenario could not have.

    Files are called by avatars, policies are found by name, and spreadsheets take any text in a table for a formula.
    """
    fault = avatar_name_fault(list(map(str, cast.names.tolist())))
    if fault:
        raise TakeError(f"{folder}: {fault}")
    named = {"policy": cast.policy_names, "team": cast.team_names, "type": cast.type_names, "group": cast.group_names}
    for what, names in named.items():
        for name in names:
            if not is_name(str(name)):
                raise TakeError(f"{folder}: a {what} is named {name!r}, expected a name of {NAME_RULE}")
