"""What a scenario asks for in vain: conditions that cannot occur, ends that cannot come, ranges without effect."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from crowdsim.config.files import Finding
from crowdsim.scenario.description import Description
from crowdsim.scenario.distributions import limits
from crowdsim.scenario.fitness import LINGERS, CountEnd, Damage
from crowdsim.scenario.groups import Group

_NEEDS_DAMAGE = "expected 'damage' of their type"


def fight_findings(scenario: Description) -> Iterator[Finding]:
    """Yield ends and conditions of a valid scenario that cannot come, and ranges without effect."""
    yield from _end_findings(scenario)
    for name in sorted(scenario.used_types & set(scenario.types)):
        kept = _setting_of(scenario, name, "range")
        if _setting_of(scenario, name, "tempo") is None and kept is not None and limits(kept) != (0.0, 0.0):
            what = "has no effect, since avatars whose tempo is null do not rest between bursts, expected 0 or a tempo"
            yield Finding(("types", name, "range"), what)
    by_name = dict(zip(scenario.group_names, scenario.groups, strict=True))
    for i, event in enumerate(scenario.events):
        if event.kind == "leave" and event.health_below is not None:
            concerned = [group for name, group in by_name.items() if event.group in (None, name)]
            if concerned and not any(_hurt(scenario, group) for group in concerned):
                yield Finding(("events", i, "health_below"), f"nothing hurts these avatars, {_NEEDS_DAMAGE}")
        if event.kind == "heal":
            concerned = [group for name, group in by_name.items() if event.group in (None, name)]
            if concerned and not any(_hurt(scenario, group) or _tires(scenario, group) for group in concerned):
                what = f"nothing hurts or tires these avatars, {_NEEDS_DAMAGE}, or 'stamina'"
                yield Finding(("events", i, "kind"), what)
        when = event.when
        if when.kind == "ended" and (scenario.until is None or scenario.linger == 0):
            what = "never comes without 'until'" if scenario.until is None else "comes with the last frame"
            expected = "expected an 'until'" if scenario.until is None else "expected a 'linger' above 0"
            yield Finding(("events", i, "when"), f"{what}, {expected}")
        if when.kind not in ("down", "health_below") or (when.group is not None and when.group not in by_name):
            continue
        if when.kind == "down":
            groups = list(by_name.values()) if when.group is None else [by_name[when.group]]
            most = sum(_most_downs(scenario, group) for group in groups)
            if when.count > most:
                yield Finding(("events", i, "when", *(() if most == 0 else ("count",))), _too_many(when.count, most))
        elif when.kind == "health_below":
            given = [damage for damage in _damages(scenario, by_name[when.group]) if damage is not None]
            if not given:
                what = f"nothing hurts avatars of {when.group!r}, {_NEEDS_DAMAGE}"
                yield Finding(("events", i, "when", "group"), what)
            elif when.points > min(damage.health for damage in given):
                least = min(damage.health for damage in given)
                what = f"is {when.points:g}, but avatars of {when.group!r} start with less, expected at most {least:g}"
                yield Finding(("events", i, "when", "points"), what)


def _tires(scenario: Description, group: Group) -> bool:
    """Return whether avatars of a group tire."""
    return any(_setting_of(scenario, name, "stamina") is not None for name in group.types)


def _end_findings(scenario: Description) -> Iterator[Finding]:
    until = scenario.until
    if until is None and scenario.linger != LINGERS:
        yield Finding(("linger",), "has no effect without 'until', which ends a run before its duration")
    if until is None or (isinstance(until, CountEnd) and until.down is None):
        return
    most = sum(_hurt(scenario, group) for group in scenario.groups)
    if most == 0:
        yield Finding(("until",), f"no avatar can go down, {_NEEDS_DAMAGE}")
    elif isinstance(until, CountEnd) and until.down is not None and until.down > most:
        yield Finding(("until", "down"), f"is {until.down}, but {most} avatars can go down, expected at most that")
    elif until == "last_team" and len(scenario.teams) == 1:
        what = f"is 'last_team', but all avatars are of team {scenario.teams[0]!r}, expected a second team or "
        yield Finding(("until",), what + "'last_standing'")
    elif until == "last_standing" and scenario.avatar_count == 1:
        yield Finding(("until",), "is 'last_standing', but there is one avatar, expected a second one")


def _too_many(count: int, most: int) -> str:
    if most == 0:
        return f"no avatar can be knocked down, {_NEEDS_DAMAGE}"
    return f"is {count}, but there can be {most} knock-downs, expected at most that"


def _damages(scenario: Description, group: Group) -> list[Damage | None]:
    """Return the damage of each type that avatars of a group can have, through all that it extends."""
    return [_setting_of(scenario, name, "damage") for name in group.types]


def _setting_of(scenario: Description, name: str, key: str) -> Any:
    """Return a setting of a type, through all that it extends."""
    seen: set[str] = set()
    at: str | None = name
    while at is not None and at in scenario.types and at not in seen:
        seen.add(at)
        kind = scenario.types[at]
        if key in kind.model_fields_set or kind.extends is None:
            return getattr(kind, key)
        at = kind.extends
    return None


def _hurt(scenario: Description, group: Group) -> int:
    """Return how many avatars of a group can go down for good, at most."""
    return group.count if any(damage is not None for damage in _damages(scenario, group)) else 0


def _most_downs(scenario: Description, group: Group) -> int:
    """Return how often avatars of a group can be knocked down, at most."""
    return group.count * max((damage.downs for damage in _damages(scenario, group) if damage is not None), default=0)
