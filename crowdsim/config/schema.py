"""What a pydantic model expects at a location, from its JSON Schema, in words.

A *part* is the piece of the schema that holds at a location: a mapping, empty where the schema says nothing. Messages
come from the standard keywords; ``examples`` name texts of a pattern, and :class:`Expected` replaces what follows from
the type.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any

from pydantic import BaseModel, GetJsonSchemaHandler

Part = dict[str, Any]

_TYPES = {
    "boolean": "true or false",
    "integer": "a whole number",
    "number": "a number",
    "string": "text",
    "array": "a list",
    "object": "a mapping",
}
_MOST_WORDS = 20
_LIMITS = {"minimum": "of at least", "exclusiveMinimum": "above", "maximum": "of at most", "exclusiveMaximum": "below"}


@dataclass(frozen=True)
class Expected:
    """Says in an annotation what is expected there; editors show it too, as ``errorMessage``."""

    text: str

    def __get_pydantic_json_schema__(self, core: Any, handler: GetJsonSchemaHandler) -> Part:
        """Return the schema with the text in it."""
        return {**handler(core), "errorMessage": f"expected {self.text}"}


@cache
def schema_of(model: type[BaseModel]) -> Part:
    """Return the JSON Schema of a model without references and nulls; models must not contain themselves."""
    schema = model.model_json_schema()
    return _resolve(schema, schema.get("$defs", {}))


def _resolve(part: Any, definitions: Part) -> Any:
    if isinstance(part, list):
        return [_resolve(one, definitions) for one in part]
    if not isinstance(part, dict):
        return part
    part = {**definitions.get(part.get("$ref", "").rpartition("/")[2], {}), **part}
    part = {key: _resolve(value, definitions) for key, value in part.items() if key not in ("$ref", "$defs")}
    choices = members(part)
    if len(choices) != 1:
        return part
    # What a key means is said where it is, not by the model of its value.
    return {**choices[0], **part, "anyOf": choices[0].get("anyOf", [])}


def members(part: Part) -> list[Part]:
    """Return the members of a union; none of anything else."""
    return [choice for choice in part.get("anyOf") or part.get("oneOf") or [] if choice.get("type") != "null"]


def words(part: Part) -> list[Any]:
    """Return the words, or the one, that are to be chosen from; none where there is no such choice."""
    return [part["const"]] if "const" in part else part.get("enum", [])


def keys(part: Part) -> list[str]:
    """Return the keys that a mapping may have; none where any may be, or it is no mapping."""
    return list(part.get("properties", ()))


def step(part: Part, at: Any) -> Part:
    """Return the part one key or index below."""
    if "properties" in part or "prefixItems" in part:
        return dict(part.get("properties") or enumerate(part["prefixItems"])).get(at, {})
    named = list(part.get("patternProperties", {}).values())
    inner: Any = next(filter(None, (part.get("items"), part.get("additionalProperties"), *named)), {})
    return inner if isinstance(inner, dict) else {}


def discriminator(part: Part) -> tuple[str, dict[Any, Part]]:
    """Return the key that chooses among a union of mappings, and the member for each of its values; or no key."""
    choices = members(part)
    for key in keys(choices[0]) if choices else ():
        if all(key in keys(choice) and words(step(choice, key)) for choice in choices):
            return key, {tag: choice for choice in choices for tag in words(step(choice, key))}
    return "", {}


def chosen(part: Part, value: Any) -> Part:
    """Return the member of a union that a mapping is meant for, or is to be made for, empty if none; else the part."""
    key, tags = discriminator(part)
    if key and isinstance(value, dict) and key in value:
        return next((member for tag, member in tags.items() if tag == value[key]), {})
    mappings = [choice for choice in members(part) if choice.get("type") == "object" or members(choice)]
    return mappings[0] if len(mappings) == 1 else {} if members(part) else part


def describe(part: Part) -> str:
    """Say what is expected at a part: ``a whole number from 1 to 9``, ``'q' or 'v'``, ``a list``."""
    key, tags = discriminator(part)
    if "errorMessage" in part:
        return part["errorMessage"].removeprefix("expected ")
    if key:
        return f"a mapping with {key}: {quoted(tags)}"
    if members(part):
        return join(map(describe, members(part)))
    if keys(part):
        return f"a mapping with {join(keys(part), 'and')}"
    if words(part):
        return quoted(words(part))
    if "examples" in part:
        return f"text such as {join(part['examples'])}"
    if "prefixItems" in part:
        return f"a list of {len(part['prefixItems'])}: {', '.join(map(describe, part['prefixItems']))}"
    if part.get("items"):
        of_mappings = keys(part["items"]) or discriminator(part["items"])[0]
        return "a list of mappings" if of_mappings else f"a list, each item {describe(part['items'])}"
    if "minimum" in part and "maximum" in part:
        limits = f" from {part['minimum']} to {part['maximum']}"
    elif "exclusiveMinimum" in part and "maximum" in part:
        limits = f" above {part['exclusiveMinimum']} and up to {part['maximum']}"
    else:
        limits = " and".join(f" {words} {part[key]}" for key, words in _LIMITS.items() if key in part)
    return _TYPES.get(part.get("type", ""), "a value") + limits


def join(words: Iterable[str], last: str = "or") -> str:
    """Return words as in a sentence: ``a, b or c``."""
    words = list(dict.fromkeys(words))
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {last} {words[-1]}" if words else "nothing"


def some(words: Iterable[str]) -> str:
    """Return words as in a sentence, but only some of very many."""
    found = list(words)
    more = len(found) - _MOST_WORDS
    return join(found) if more <= 0 else f"one of {', '.join(found[:_MOST_WORDS])} and {more} more"


def quoted(words: Iterable[Any]) -> str:
    """Return words to choose from as in a sentence, text in quotes: ``'a' or 'b'``."""
    return join(repr(word) for word in words)
