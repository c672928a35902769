"""What must be true of a scenario beyond its single keys: names refer to something, and fights can take place."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from crowdsim.config.files import Finding
from crowdsim.config.schema import join
from crowdsim.errors import nearest
from crowdsim.scenario.description import Description
from crowdsim.scenario.groups import MAXIMUM_AVATARS, FixedOpponents, Opponents

MAXIMUM_BVH_FILES = 10_000
MAXIMUM_POINTS = 500_000_000


def name_findings(data: Any) -> list[Finding]:
    """Return names in a scenario's plain data that refer to nothing; what has the wrong shape is passed over."""
    data = _mapping(data)
    types = _mapping(data.get("types"))
    groups = [_mapping(group) for group in _list(data.get("groups"))]
    teams = [str(group.get("team", "one")) for group in groups]
    names = [str(group.get("name") or f"group{i + 1}") for i, group in enumerate(groups)]
    targets = _mapping(data.get("targets"))
    findings: list[Finding] = []

    def refer(path: tuple[str | int, ...], word: str, known: list[str]) -> None:
        name = _mapping_at(data, path)
        if isinstance(name, str) and name not in known:
            choice = f": {join(known)}{nearest(name, known)}" if known else ", and there are none"
            findings.append(Finding(path, f"is {name!r}, expected a {word}{choice}"))

    for name, kind in types.items():
        base = _mapping(kind).get("extends")
        refer(("types", name, "extends"), "type of this scenario", list(types))
        chain = [name]
        while isinstance(base, str) and base in types and base not in chain:
            chain.append(base)
            base = _mapping(types[base]).get("extends")
        if base == name:
            findings.append(
                Finding(("types", name, "extends"), f"goes round in a circle: {' -> '.join([*chain, name])}")
            )
    for i, group in enumerate(groups):
        refer(("groups", i, "type"), "type", list(types))
        for name in _mapping(group.get("mix")):
            if name not in types:
                choice = f"expected {join(list(types))}{nearest(name, types)}" if types else "and there are none"
                what = f"no such type, {choice}"
                findings.append(Finding(("groups", i, "mix", name), what))
        before = [other.casefold() for other in names[:i]]
        if names[i].casefold() in before:
            what = f"is {names[i]!r} like groups[{before.index(names[i].casefold())}], expected a name of its own"
            findings.append(Finding(("groups", i, "name"), what))
    for path in _opponents_paths(data):
        refer((*path, "group"), "group", names)
        refer((*path, "target"), "target of this scenario", list(targets))
    for i, item in enumerate(_list(data.get("events"))):
        event = _mapping(item)
        refer(("events", i, "group"), "group", names)
        refer(("events", i, "when", "group"), "group", names)
        refer(("events", i, "when", "to"), "group", names)
        refer(("events", i, "when", "team"), "team", list(dict.fromkeys(teams)))
        named = event.get("group")
        if event.get("kind") == "add" and named in names and groups[names.index(named)].get("waits", False) is False:
            what = f"is {named!r}, which is there from the start, expected a group with 'waits: true'"
            findings.append(Finding(("events", i, "group"), what))
    added = [
        _mapping(event).get("group") for event in _list(data.get("events")) if _mapping(event).get("kind") == "add"
    ]
    for i, group in enumerate(groups):
        if group.get("waits") is True and names[i] not in added:
            findings.append(Finding(("groups", i, "waits"), "no event adds the group, expected one of kind 'add'"))
    return findings


def sense_findings(scenario: Description) -> list[Finding]:
    """Return what a valid scenario requests in vain: no opponents, too many avatars or files."""
    findings: list[Finding] = []
    total = scenario.avatar_count
    if total > MAXIMUM_AVATARS:
        findings.append(Finding(("groups",), f"there are {total:,} avatars, expected at most {MAXIMUM_AVATARS:,}"))
    names = [group.name or f"group{i + 1}" for i, group in enumerate(scenario.groups)]
    for i, group in enumerate(scenario.groups):
        path = ("groups", i, "opponents") if group.opponents else ("opponents",)
        findings += _opponents_findings(scenario, i, group.opponents or scenario.opponents, names, path)
    for j, event in enumerate(scenario.events):
        if event.kind == "retarget":
            for i in range(len(scenario.groups)) if event.group is None else _indices(names, event.group):
                findings += _opponents_findings(scenario, i, event.opponents, names, ("events", j, "opponents"))
    findings += _search_findings(scenario)
    outputs = scenario.outputs
    if outputs.bvh is not None and outputs.bvh.avatars is None and total > MAXIMUM_BVH_FILES:
        what = f"asks for {total:,} files, expected at most {MAXIMUM_BVH_FILES:,}; choose some by 'avatars'"
        findings.append(Finding(("outputs", "bvh"), what))
    for key, output in (("bvh", outputs.bvh), ("ply", outputs.ply), ("pcd", outputs.pcd)):
        for i, avatar in enumerate((output.avatars if output else None) or ()):
            if avatar >= total:
                what = f"is {avatar}, expected an avatar from 0 to {total - 1}"
                findings.append(Finding(("outputs", key, "avatars", i), what))
    for key, cloud in (("ply", outputs.ply), ("pcd", outputs.pcd)):
        points = 0 if cloud is None else cloud.points * (total if cloud.avatars is None else len(cloud.avatars))
        if points > MAXIMUM_POINTS:
            what = f"asks for {points:,} points a frame, expected at most {MAXIMUM_POINTS:,}"
            findings.append(Finding(("outputs", key, "points"), what))
    camera = outputs.render.camera if outputs.render else "auto"
    if not isinstance(camera, str) and camera.kind == "follow" and camera.avatar >= total:
        what = f"is {camera.avatar}, expected an avatar from 0 to {total - 1}"
        findings.append(Finding(("outputs", "render", "camera", "avatar"), what))
    return list(dict.fromkeys(findings))


def _search_findings(scenario: Description) -> Iterator[Finding]:
    """All groups share one index: those that groups and events name must be the scenario's."""
    chosen = scenario.opponents.search
    paths: list[tuple[tuple[str | int, ...], Opponents | None]] = [
        *((("groups", i, "opponents"), group.opponents) for i, group in enumerate(scenario.groups)),
        *((("events", j, "opponents"), e.opponents) for j, e in enumerate(scenario.events) if e.kind == "retarget"),
    ]
    for path, opponents in paths:
        if opponents is not None and opponents.search not in ("auto", chosen):
            what = f"is {opponents.search!r}, expected {chosen!r} as in the scenario's own opponents, or no search here"
            yield Finding((*path, "search"), what)


def _opponents_findings(
    scenario: Description, group: int, opponents: Opponents, names: list[str], path: tuple[str | int, ...]
) -> Iterator[Finding]:
    own = scenario.groups[group]
    if opponents.kind == "other_team" and len(scenario.teams) == 1:
        what = f"is 'other_team', but all avatars are of team {own.team!r}, expected a second team or kind 'anyone'"
        yield Finding((*path, "kind"), what)
    if opponents.kind == "anyone" and scenario.avatar_count == 1:
        what = "there is one avatar without an opponent, expected a second avatar or a scripted target"
        yield Finding(path, what)
    if isinstance(opponents, FixedOpponents):
        for other in _indices(names, opponents.group):
            count = scenario.groups[other].count
            if other == group:
                what = f"is {opponents.group!r}, whose own avatars would fight themselves, expected another group"
                yield Finding((*path, "group"), what)
            elif opponents.member is not None and opponents.member >= count:
                what = f"is {opponents.member}, expected an avatar of {opponents.group!r} from 0 to {count - 1}"
                yield Finding((*path, "member"), what)
            elif opponents.member is None and count < own.count:
                what = (
                    f"{opponents.group!r} has {count} avatars for {own.count} to fight, expected as many, or 'member'"
                )
                yield Finding((*path, "group"), what)


def _indices(names: list[str], name: str) -> list[int]:
    return [i for i, other in enumerate(names) if other == name]


def _opponents_paths(data: dict[str, Any]) -> Iterator[tuple[str | int, ...]]:
    yield ("opponents",)
    for i in range(len(_list(data.get("groups")))):
        yield ("groups", i, "opponents")
    for i in range(len(_list(data.get("events")))):
        yield ("events", i, "opponents")


def _mapping(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _list(value: Any) -> list[Any]:
    return list(value) if isinstance(value, list | tuple) else []


def _mapping_at(data: Any, path: tuple[str | int, ...]) -> Any:
    for part in path:
        if isinstance(part, int):
            data = _list(data)[part] if part < len(_list(data)) else None
        else:
            data = _mapping(data).get(part)
    return data
