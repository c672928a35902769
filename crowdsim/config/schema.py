"""What a pydantic model expects at a place, found by following a key path through its types, and said in words."""

from __future__ import annotations

import re
import types
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo


@dataclass(frozen=True)
class Words:
    """Stands in an annotation and says what is expected there, instead of what follows from the type.

    Attributes:
        text: What is expected.
        besides: Whether that is expected beside what the type says, as another way to write it.
    """

    text: str
    besides: bool = False


@dataclass(frozen=True)
class Spot:
    """A place in a schema: its type without ``Annotated`` and ``None``, and the constraints that stand with it.

    A union has ``members``; it is ``tagged`` where a discriminator chooses among them.
    """

    kind: Any
    constraints: tuple[Any, ...] = ()
    members: tuple[Spot, ...] = ()
    tagged: bool = False

    @property
    def model(self) -> type[BaseModel] | None:
        """The model that stands here, if it is one."""
        return self.kind if isinstance(self.kind, type) and issubclass(self.kind, BaseModel) else None

    @property
    def words(self) -> tuple[Any, ...]:
        """Words that a literal accepts; empty for anything else."""
        return get_args(self.kind) if get_origin(self.kind) is Literal else ()

    @property
    def is_list(self) -> bool:
        """Whether items are counted here."""
        return (get_origin(self.kind) or self.kind) in (list, tuple)

    @property
    def is_pair_or_the_like(self) -> bool:
        """Whether a list of a fixed number of items stands here."""
        arguments = get_args(self.kind)
        return get_origin(self.kind) is tuple and bool(arguments) and arguments[-1] is not Ellipsis

    @property
    def keys(self) -> list[str]:
        """Keys that a mapping here may have; empty when any may stand here or it is no mapping."""
        return [] if self.model is None else list(self.model.model_fields)

    @property
    def renamed(self) -> dict[str, str]:
        """Keys that a mapping had here before, with their new names."""
        return getattr(self.model, "renamed", {})


def spot_of(annotation: Any, constraints: tuple[Any, ...] = (), tagged: bool = False) -> Spot:
    """Return the spot of a type annotation."""
    while get_origin(annotation) is Annotated:
        annotation, *more = get_args(annotation)
        constraints = (*more, *constraints)
    flat: list[Any] = []
    for constraint in constraints:
        tagged = tagged or getattr(constraint, "discriminator", None) is not None
        flat += constraint.metadata if isinstance(constraint, FieldInfo) else [constraint]
    if get_origin(annotation) in (Union, types.UnionType):
        members = [member for member in get_args(annotation) if member is not type(None)]
        if len(members) > 1:
            return Spot(Union, tuple(flat), tuple(spot_of(member) for member in members), tagged)
        return spot_of(members[0], tuple(flat), tagged)
    return Spot(annotation, tuple(flat))


def step(spot: Spot | None, part: Any) -> Spot | None:
    """Return the spot one key or index below, or None where the schema says nothing."""
    if spot is None:
        return None
    arguments, origin = get_args(spot.kind), get_origin(spot.kind)
    if spot.model is not None:
        info = spot.model.model_fields.get(part)
        return spot_of(info.annotation, tuple(info.metadata), info.discriminator is not None) if info else None
    if origin is list or (origin is tuple and arguments[-1] is Ellipsis):
        return spot_of(arguments[0])
    if origin is dict:
        return spot_of(arguments[1])
    return spot_of(arguments[part]) if origin is tuple and part in range(len(arguments)) else None


def member(spot: Spot, label: str) -> Spot | None:
    """Return the member of a union that pydantic calls ``label``: a tag, or the name of its type."""
    if label.startswith("tagged-union"):
        return next((choice for choice in spot.members if choice.tagged), None)
    for choice in spot.members:
        name = getattr(get_origin(choice.kind) or choice.kind, "__name__", "")
        if label.removeprefix("constrained-").partition("[")[0] == name.lower() or (
            choice.model is not None and name in re.findall(r"\w+", label)
        ):
            return choice
        if choice.model is not None and any(label in tags(info) for info in choice.model.model_fields.values()):
            return choice
    return None


def tags(info: FieldInfo) -> tuple[Any, ...]:
    """Return the words that a field of type ``Literal`` accepts."""
    return get_args(info.annotation) if get_origin(info.annotation) is Literal else ()


def chosen(spot: Spot | None, value: Any) -> Spot | None:
    """Return the member of a union that a value is meant for, or the spot itself when it is no union."""
    if spot is None or not spot.members:
        return spot
    common = discriminator(spot)
    if common and isinstance(value, dict) and common[0] in value:
        return member(spot, str(value[common[0]]))
    models = [choice for choice in spot.members if choice.model is not None]
    return models[0] if len(models) == 1 else None


def discriminator(spot: Spot | None) -> tuple[str, list[Any]] | None:
    """Return the key that chooses among the models of a union, with all its values; None where there is none."""
    models = [choice.model for choice in spot.members if choice.model is not None] if spot else []
    if not models or spot is None or len(models) < len(spot.members):
        return None
    for name in models[0].model_fields:
        words = [tags(model.model_fields[name]) if name in model.model_fields else () for model in models]
        if all(words):
            return name, [word for some in words for word in some]
    return None


def describe(spot: Spot | None) -> str:
    """Say what is expected at a spot: ``a whole number from 1 to 9``, ``'q' or 'v'``, ``a list``."""
    if spot is None:
        return "a value"
    said = next((constraint for constraint in spot.constraints if isinstance(constraint, Words)), None)
    if said is not None:
        rest = replace(spot, constraints=tuple(one for one in spot.constraints if one is not said))
        return join([*_ways(rest), said.text]) if said.besides else said.text
    if spot.members:
        common = discriminator(spot)
        if common:
            return f"a mapping with {common[0]}: {join([repr(word) for word in common[1]])}"
        return join(_ways(spot))
    if spot.model is not None:
        return f"a mapping with {join(spot.keys, 'and')}"
    kind = get_origin(spot.kind) or spot.kind
    if kind is Literal:
        return join([f"'{word}'" if isinstance(word, str) else str(word) for word in get_args(spot.kind)])
    if kind is bool:
        return "true or false"
    if kind is int:
        return "a whole number" + _range(spot)
    if kind is float:
        return "a number" + _range(spot)
    if kind in (list, tuple):
        arguments = get_args(spot.kind)
        if kind is tuple and arguments and arguments[-1] is not Ellipsis:
            each = [describe(spot_of(argument)) for argument in arguments]
            return f"a list of {len(each)}: {', '.join(each)}"
        if not arguments:
            return "a list"
        inner = spot_of(arguments[0])
        return "a list of mappings" if inner.model or discriminator(inner) else f"a list, each item {describe(inner)}"
    if kind is dict:
        return "a mapping"
    if kind is str:
        return "text"
    return "a value"


def _ways(spot: Spot) -> list[str]:
    """Say what each member of a plain union expects, or what the spot itself does."""
    plain = spot.members and not discriminator(spot)
    return [describe(choice) for choice in spot.members] if plain else [describe(spot)]


def join(words: list[str], last: str = "or") -> str:
    """Return words as in a sentence: ``a, b or c``."""
    words = list(dict.fromkeys(words))
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {last} {words[-1]}" if words else "nothing"


def _range(spot: Spot) -> str:
    limits: dict[str, Any] = {}
    for constraint in spot.constraints:
        for name in ("ge", "gt", "le", "lt"):
            if getattr(constraint, name, None) is not None:
                limits[name] = getattr(constraint, name)
    if "ge" in limits and "le" in limits:
        return f" from {limits['ge']} to {limits['le']}"
    if "gt" in limits and "le" in limits:
        return f" above {limits['gt']} and up to {limits['le']}"
    words = {"ge": "of at least", "gt": "above", "le": "of at most", "lt": "below"}
    return "".join(f" {'and ' if i else ''}{words[name]} {limits[name]}" for i, name in enumerate(limits))
