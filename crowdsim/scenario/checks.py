"""What must be true of a scenario beyond its single keys: names refer to something, and fights can take place."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import replace
from itertools import chain, islice
from typing import Any

from crowdsim.config.files import MOST_FINDINGS, Finding
from crowdsim.config.findings import show
from crowdsim.config.schema import some
from crowdsim.errors import nearest
from crowdsim.scenario.cameras import KINDS, check_avatars, choice_findings, shot_findings
from crowdsim.scenario.description import Description
from crowdsim.scenario.fight_checks import fight_findings
from crowdsim.scenario.groups import MAXIMUM_AVATARS, FixedOpponents, Opponents, TablePlacement
from crowdsim.scenario.parts import Arena, CircleArena, RectangleArena

_MOST_OF_CIRCLE = 10


def name_findings(data: Any) -> list[Finding]:
    """Return names in a scenario's plain data that refer to nothing; what has the wrong shape is passed over.

    Of very many, there are no more than ``MOST_FINDINGS`` and one.
    """
    data = _mapping(data)
    types = _mapping(data.get("types"))
    groups = [_mapping(group) for group in _list(data.get("groups"))]
    names = [str(group.get("name") or f"group{i + 1}") for i, group in enumerate(groups)]
    found = chain(
        _type_findings(types), _group_findings(groups, names, types), _reference_findings(data, groups, names)
    )
    return list(islice(found, MOST_FINDINGS + 1))


def _refer(path: tuple[str | int, ...], name: Any, word: str, known: Collection[str]) -> Iterator[Finding]:
    """Yield a finding where a name is none of those known."""
    if isinstance(name, str) and name not in known:
        choice = f": {some(known)}{nearest(name, known)}" if known else ", and there are none"
        yield Finding(path, f"{show(name)}, expected a {word}{choice}")


def _type_findings(types: dict[str, Any]) -> Iterator[Finding]:
    bases = {name: _mapping(kind).get("extends") for name, kind in types.items()}
    for name, base in bases.items():
        yield from _refer(("types", name, "extends"), base, "type of this scenario", types)
    seen: set[str] = set()
    for start in bases:
        # Each type has one base: following them, what has not been seen before ends, or comes back to this walk.
        walk: dict[str, None] = {}
        at: Any = start
        while isinstance(at, str) and at in bases and at not in seen:
            seen.add(at)
            walk[at] = None
            at = bases[at]
        if isinstance(at, str) and at in walk:
            circle = list(walk)[list(walk).index(at) :]
            for i, one in enumerate(circle):
                way = [*circle[i:], *circle[:i]]
                words = " -> ".join([*(way[:_MOST_OF_CIRCLE]), *(["..."] if len(way) > _MOST_OF_CIRCLE else []), one])
                yield Finding(("types", one, "extends"), f"goes round in a circle: {words}")


def _group_findings(groups: list[dict[str, Any]], names: list[str], types: dict[str, Any]) -> Iterator[Finding]:
    before: dict[str, int] = {}
    for i, group in enumerate(groups):
        yield from _refer(("groups", i, "type"), group.get("type"), "type", types)
        for name in _mapping(group.get("mix")):
            if name not in types:
                choice = f"expected {some(types)}{nearest(name, types)}" if types else "and there are none"
                yield Finding(("groups", i, "mix", name), f"no such type, {choice}")
        other = before.setdefault(names[i].casefold(), i)
        if other != i:
            yield Finding(("groups", i, "name"), f"{show(names[i])} like groups[{other}], expected a name of its own")


def _reference_findings(data: dict[str, Any], groups: list[dict[str, Any]], names: list[str]) -> Iterator[Finding]:
    """Yield a finding for each group, team and target that is named by opponents and events but is none."""
    targets = _mapping(data.get("targets"))
    teams = dict.fromkeys(str(group.get("team", "one")) for group in groups)
    # Tables may have further teams (``_table_findings``).
    has_tables = any(_mapping(group.get("placement")).get("kind") == "table" for group in groups)
    known: dict[str, int] = {}
    for i, name in enumerate(names):
        known.setdefault(name, i)
    for path in _opponents_paths(data):
        opponents = _mapping(_at(data, path))
        yield from _refer((*path, "group"), opponents.get("group"), "group", known)
        yield from _refer((*path, "target"), opponents.get("target"), "target of this scenario", targets)
    added = set()
    for i, item in enumerate(_list(data.get("events"))):
        event = _mapping(item)
        when, named = _mapping(event.get("when")), event.get("group")
        yield from _refer(("events", i, "group"), named, "group", known)
        yield from _refer(("events", i, "type"), event.get("type"), "type", _mapping(data.get("types")))
        yield from _refer(("events", i, "when", "group"), when.get("group"), "group", known)
        yield from _refer(("events", i, "when", "to"), when.get("to"), "group", known)
        if not has_tables:
            yield from _refer(("events", i, "when", "team"), when.get("team"), "team", teams)
        if event.get("kind") == "add" and isinstance(named, str) and named in known:
            added.add(named)
            if groups[known[named]].get("waits", False) is False and not _goes_away(data, named):
                what = f"{show(named)}, which is there from the start, expected a group with 'waits: true'"
                yield Finding(("events", i, "group"), what)
    for i, group in enumerate(groups):
        if group.get("waits") is True and names[i] not in added:
            yield Finding(("groups", i, "waits"), "no event adds the group, expected one of kind 'add'")


def _goes_away(data: dict[str, Any], group: str) -> bool:
    """Return whether an event lets a group go away, or everyone."""
    events = [_mapping(item) for item in _list(data.get("events"))]
    return any(event.get("kind") in ("leave", "remove") and event.get("group") in (None, group) for event in events)


def sense_findings(scenario: Description) -> list[Finding]:
    """Return what a valid scenario requests in vain: no opponents, too many avatars or files.

    Of very many, there are no more than ``MOST_FINDINGS`` and one.
    """
    found = chain(
        _table_findings(scenario),
        _crowd_findings(scenario),
        _search_findings(scenario),
        _weights_findings(scenario),
        scenario.outputs.findings(scenario.avatar_count),
        _name_findings(scenario),
        _camera_findings(scenario),
        fight_findings(scenario),
    )
    return list(islice(dict.fromkeys(found), MOST_FINDINGS + 1))


def _table_findings(scenario: Description) -> Iterator[Finding]:
    """Yield types in tables that are none, names that something else has, teams alike, and teams that are none."""
    groups = list(zip(scenario.groups, scenario.group_names, strict=True))
    if not any(group.rows for group in scenario.groups):
        return
    taken: dict[str, str] = {}
    for word, words in (("group", scenario.group_names), ("team", scenario.teams), ("type", scenario.types)):
        taken |= {name.casefold(): f"{word} {name!r}" for name in words}
    for group, own in groups:
        if not group.rows:
            taken |= {name.casefold(): f"avatar {name!r} of group {own!r}" for name in group.avatar_names(own)}
    teams: dict[str, str] = {}
    for i, (group, own) in enumerate(groups):
        if not isinstance(group.placement, TablePlacement):
            teams.setdefault(group.team.casefold(), group.team)
            continue
        for row in group.rows:
            wrong = []
            if row.name.text.casefold() in taken:
                other = taken[row.name.text.casefold()]
                wrong += [(row.name, f"name is {row.name.text!r} like {other}, expected a name of its own")]
            if row.type.text and row.type.text not in scenario.types:
                choice = f"expected a type: {some(scenario.types)}{nearest(row.type.text, scenario.types)}"
                wrong += [(row.type, f"type is {row.type.text!r}, {choice}")]
            team = row.team.text or group.team
            alike = teams.setdefault(team.casefold(), team)
            if alike != team:
                wrong += [(row.team, f"team is {team!r}, which is {alike!r} but for capitals, expected one of these")]
            for cell, what in wrong:
                yield Finding(("groups", i, "placement", "file"), group.placement.describe(cell, what))
        taken |= {name.casefold(): f"avatar {name!r} of group {own!r}" for name in group.avatar_names(own)}
    for i, event in enumerate(scenario.events):
        yield from _refer(("events", i, "when", "team"), getattr(event.when, "team", None), "team", scenario.teams)


def _crowd_findings(scenario: Description) -> Iterator[Finding]:
    """Yield what is wrong with the number of avatars and with whom they are to fight."""
    total = scenario.avatar_count
    if total > MAXIMUM_AVATARS:
        yield Finding(("groups",), f"there are {total:,} avatars, expected at most {MAXIMUM_AVATARS:,}")
    crowd = _Crowd(scenario, total)
    for i, group in enumerate(scenario.groups):
        path = ("groups", i, "opponents") if group.opponents else ("opponents",)
        yield from _opponents_findings(crowd, i, group.opponents or scenario.opponents, path)
    everyone = range(len(scenario.groups))
    seen: set[tuple[Opponents, str | None, int | None]] = set()
    for j, event in enumerate(scenario.events):
        member = getattr(event, "member", None)
        if member is not None:
            yield from _member_findings(crowd, event.group, member, ("events", j))
        if event.kind == "place" and not _is_inside(scenario.arena, *event.point):
            what = f"is {event.point[0]:g}, {event.point[1]:g}, expected a point in the arena"
            yield Finding(("events", j, "point"), what)
        if event.kind == "retarget" and (event.opponents, event.group, member) not in seen:
            # Many events may do the same; the first one's finding will do.
            seen.add((event.opponents, event.group, member))
            of = everyone if event.group is None else crowd.indices.get(event.group, ())
            for i in of if isinstance(event.opponents, FixedOpponents) else of[:1]:
                yield from _opponents_findings(crowd, i, event.opponents, ("events", j, "opponents"), member)


def _weights_findings(scenario: Description) -> Iterator[Finding]:
    """Yield a finding for each event that gives weights to avatars of a type, where a group has none of that type."""
    for j, event in enumerate(scenario.events):
        if event.kind != "weights" or event.type not in scenario.types:
            continue
        named = zip(scenario.group_names, scenario.groups, strict=True)
        kinds = [group.types for name, group in named if event.group in (None, name)]
        if kinds and not any(event.type in types for types in kinds):
            where, known = (f"group {event.group!r}" if event.group else "the scenario"), dict.fromkeys(chain(*kinds))
            what = f"is {event.type!r}, but {where} has no avatars of it, expected one that it has: {some(known)}"
            yield Finding(("events", j, "type"), what)


def _name_findings(scenario: Description) -> Iterator[Finding]:
    """Yield a finding for each name among the avatars of an output that is none."""
    for output in scenario.outputs.wanted():
        for i, avatar in enumerate(getattr(output, "avatars", None) or ()):
            if isinstance(avatar, str) and scenario.members(avatar) is None:
                some_of = list(dict.fromkeys([*scenario.group_names, *scenario.teams]))
                known = list(dict.fromkeys([*some_of, *islice(scenario.avatar_names(), 200)]))
                what = f"{show(avatar)}, expected the number or name of an avatar, or "
                what += some(some_of) + nearest(avatar, known)
                yield output.place(Finding(("avatars", i), what))


def _camera_findings(scenario: Description) -> Iterator[Finding]:
    """Yield a finding for each camera that is named like a kind, and for cameras and avatars that there are not."""
    render, names = scenario.outputs.render, scenario.avatar_names() if scenario.cameras else []
    for name, camera in scenario.cameras.items():
        if name in KINDS:
            what = f"{show(name)}, which is a kind of cameras, expected another name"
            yield Finding(("cameras", name), what)
        for finding in check_avatars(camera, names):
            yield replace(finding, loc=("cameras", name, *finding.loc))
    if render is not None:
        names = scenario.avatar_names()
        for finding in choice_findings(render.camera, scenario.cameras, names):
            yield render.place(replace(finding, loc=("camera", *finding.loc)))
        for finding in shot_findings(render.shots, scenario.cameras, names):
            yield render.place(replace(finding, loc=("shots", *finding.loc)))
    glb = scenario.outputs.glb
    if glb is not None and glb.camera is not None:
        for finding in choice_findings(glb.camera, scenario.cameras, scenario.avatar_names()):
            yield glb.place(replace(finding, loc=("camera", *finding.loc)))


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


class _Crowd:
    """What checks of opponents look up in a scenario."""

    def __init__(self, scenario: Description, total: int) -> None:
        self.groups, self.total, self.team_count = scenario.groups, total, len(scenario.teams)
        self.indices: dict[str, list[int]] = {}
        for i, group in enumerate(scenario.groups):
            self.indices.setdefault(group.name or f"group{i + 1}", []).append(i)


def _is_inside(arena: Arena, x: float, z: float) -> bool:
    """Return whether a point lies in an arena."""
    if isinstance(arena, CircleArena):
        return math.hypot(x - arena.centre[0], z - arena.centre[1]) <= arena.radius
    if isinstance(arena, RectangleArena):
        (middle_x, middle_z), (wide, deep) = arena.centre, arena.size
        return abs(x - middle_x) <= wide / 2 and abs(z - middle_z) <= deep / 2
    return True


def _member_findings(crowd: _Crowd, group: str | None, member: int, path: tuple[str | int, ...]) -> Iterator[Finding]:
    """Yield a finding where an event concerns an avatar of a group that has no such avatar."""
    if group is None:
        yield Finding((*path, "member"), f"{show(member)}, expected the avatar's group too, as 'group'")
    for index in crowd.indices.get(group or "", ()):
        count = crowd.groups[index].count
        if member >= count:
            what = f"{show(member)}, expected an avatar of {group!r} from 0 to {count - 1}"
            yield Finding((*path, "member"), what)


def _opponents_findings(
    crowd: _Crowd, group: int, opponents: Opponents, path: tuple[str | int, ...], member: int | None = None
) -> Iterator[Finding]:
    """Yield what is wrong with the opponents of a group, or of one member of it."""
    own = crowd.groups[group]
    if opponents.kind == "other_team" and crowd.team_count == 1:
        what = f"is 'other_team', but all avatars are of team {own.teams[0]!r}, expected a second team or kind 'anyone'"
        yield Finding((*path, "kind"), what)
    if opponents.kind == "anyone" and crowd.total == 1:
        what = "there is one avatar without an opponent, expected a second avatar or a scripted target"
        yield Finding(path, what)
    if isinstance(opponents, FixedOpponents):
        for other in crowd.indices.get(opponents.group, ()):
            count = crowd.groups[other].count
            if other == group and member is not None and opponents.member not in (None, member):
                # One of a group is set on another one of it.
                if opponents.member >= count:
                    yield Finding((*path, "member"), f"{show(opponents.member)}, expected one from 0 to {count - 1}")
            elif other == group:
                what = f"is {opponents.group!r}, whose own avatars would fight themselves, expected another group"
                yield Finding((*path, "group"), what)
            elif opponents.member is not None and opponents.member >= count:
                what = f"{show(opponents.member)}, expected an avatar of {opponents.group!r} from 0 to {count - 1}"
                yield Finding((*path, "member"), what)
            elif opponents.member is None and count < own.count and member is None:
                what = (
                    f"{opponents.group!r} has {count} avatars for {own.count} to fight, expected as many, or 'member'"
                )
                yield Finding((*path, "group"), what)


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


def _at(data: dict[str, Any], path: tuple[str | int, ...]) -> Any:
    """Return what opponents are written at ``(key, "opponents")`` or ``(key, index, "opponents")``."""
    found: Any = data.get(str(path[0]))
    for part in path[1:]:
        found = found[part] if isinstance(part, int) else _mapping(found).get(part)
    return found
