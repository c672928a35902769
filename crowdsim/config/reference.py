"""Reference pages of YAML files, written from their JSON Schema so that they cannot fall behind."""

from __future__ import annotations

import json
from typing import Any

_NO_LIMIT = 100_000  # bounds as wide as this only keep numbers sane and are not worth reading


def reference_page(schema: dict[str, Any], head: str) -> str:
    """Return a page of every key of a file with type, default and meaning, by the file's JSON Schema, behind a head."""
    root = str(schema["title"])
    definitions: dict[str, Any] = {**schema.get("$defs", {}), root: schema}
    order = [root]
    for name in order:
        order += [other for other in dict.fromkeys(_named(definitions[name])) if other not in order]
    sections = [_section(name, definitions[name], definitions, name == root) for name in order]
    return "\n".join([head, *sections])


def _named(part: Any) -> list[str]:
    """Return the definitions that a part of the schema refers to, in order, its own and no deeper."""
    if isinstance(part, dict):
        own = [part["$ref"].rsplit("/", 1)[1]] if "$ref" in part else []
        deeper = [name for key, value in part.items() if key not in ("$defs", "mapping") for name in _named(value)]
        return [*own, *deeper]
    return [name for value in part for name in _named(value)] if isinstance(part, list) else []


def _section(name: str, definition: dict[str, Any], definitions: dict[str, Any], root: bool) -> str:
    required = definition.get("required", [])
    title = "The file" if root else _title(name, definition)
    lines = [f"## {title}", ""]
    if not root:
        lines += [definition.get("description", "").split("\n")[0], ""]
    lines += ["| key | value | default | meaning |", "|---|---|---|---|"]
    for key, value in definition["properties"].items():
        default = "required" if key in required else _default(value)
        lines.append(f"| `{key}` | {_kind(value, definitions)} | {default} | {_meaning(value, definitions)} |")
    return "\n".join(lines) + "\n"


def _title(name: str, definition: dict[str, Any]) -> str:
    kind = definition["properties"].get("kind", {}).get("const")
    words = "".join(f" {letter.lower()}" if letter.isupper() else letter for letter in name).strip()
    base = "distribution" if kind == words else words.split()[-1]
    return f"{base}: `{kind}`" if kind else words


def _anchor(title: str) -> str:
    return title.lower().replace(" ", "-").translate(str.maketrans("", "", ":`"))


def _default(value: dict[str, Any]) -> str:
    if "default" not in value:
        return ""
    default = value["default"]
    return "" if default is None or default == "" else f"`{json.dumps(default)}`"


def _kind(value: dict[str, Any], definitions: dict[str, Any]) -> str:
    if "$ref" in value:
        name = value["$ref"].rsplit("/", 1)[1]
        title = _title(name, definitions[name])
        return f"[{title}](#{_anchor(title)})"
    for word in ("anyOf", "oneOf"):
        if word in value:
            kinds = [_kind(one, definitions) for one in value[word] if one.get("type") != "null"]
            return " or ".join(dict.fromkeys(kinds))
    if "const" in value:
        return f"`{value['const']}`"
    if "enum" in value:
        return ", ".join(f"`{word}`" for word in value["enum"])
    if value.get("type") == "array":
        if "prefixItems" in value:
            kinds = [_kind(one, definitions) for one in value["prefixItems"]]
            same = len(set(kinds)) == 1
            return f"list of {len(kinds)}: {kinds[0] if same else ', '.join(kinds)}"
        return f"list of ({_kind(value['items'], definitions)})"
    if value.get("type") == "object":
        inner = value.get("additionalProperties") or next(iter(value.get("patternProperties", {}).values()), None)
        return f"names, each with {_kind(inner, definitions)}" if isinstance(inner, dict) else "mapping"
    return _scalar(value)


def _scalar(value: dict[str, Any]) -> str:
    words = {"string": "text", "integer": "whole number", "number": "number", "boolean": "`true` or `false`"}
    text = words.get(str(value.get("type")), "value")
    signs = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}
    limits = [f"{sign} {value[key]:g}" for key, sign in signs.items() if abs(value.get(key, _NO_LIMIT)) < _NO_LIMIT]
    return f"{text} {', '.join(limits)}" if limits else text


def _meaning(value: dict[str, Any], definitions: dict[str, Any]) -> str:
    """Return the description, which a reference leaves out where it is the same as that of what it refers to."""
    named = definitions[value["$ref"].rsplit("/", 1)[1]] if "$ref" in value else {}
    text = str(value.get("description") or named.get("description", ""))
    return text.split("\n")[0].replace("|", "\\|")
