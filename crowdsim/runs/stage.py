"""Folders in which commands write until all is whole; then the files take their places all together.

A stage lies in the folder that its files go to. Its note ``stage.json`` names what is written there by a key: the same
command goes on with it, and another one begins anew. Nothing outside a stage changes until it holds a list of all files
(``manifest``), which is written last. From then on its files are moved, those that they replace removed, and the list
comes last; where the process ends on the way, the next command that writes completes it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from os.path import lexists, realpath
from pathlib import Path
from time import perf_counter
from types import MappingProxyType
from typing import Any, NamedTuple

from crowdsim.config.documents import parse_json
from crowdsim.errors import OutputError, TakeError, under_way
from crowdsim.files import (
    NotPlainError,
    entries,
    exists_plain,
    is_folder,
    make_folder,
    make_inside,
    move_plain,
    read_plain,
    remove_plain,
    remove_tree,
    stat_plain,
    sync_disk,
    sync_folder,
    walk,
    write_plain,
)
from crowdsim.runs.lock import LOCKS, boot_id, find_owner, hold_folder
from crowdsim.runs.lock import NAME as LOCK
from crowdsim.runs.manifest import (
    NAME,
    NOTE,
    OUTPUTS,
    PICTURES,
    RUN,
    STAGES,
    ForeignManifestError,
    Ledger,
    checksum,
    checksums,
    is_unchanged,
    is_written,
    read_ledger,
    read_manifest,
    signed_text,
    write_manifest,
)
from crowdsim.scenario.output import Extent, Output, Series

FORMAT = "crowdsim-stage"
TAKE = "take.zarr"
_OLD = "old.zarr"
"""What a take that is replaced is called until its stage goes."""
_SLOW = 10.0
"""From how long on work is worth a wait for the disk [s]."""


@dataclass
class Plan:
    """Names of the files that a command may write into a folder.

    Attributes:
        files: Single files.
        series: Numbered files: their folder, numbers and suffix.
        trees: Folders that the command fills.
    """

    files: set[str] = field(default_factory=set)
    series: list[tuple[str, range, str]] = field(default_factory=list)
    trees: tuple[str, ...] = ()

    @classmethod
    def of(cls, outputs: Iterable[Output], extent: Extent, avatars: Sequence[str]) -> Plan:
        """Return the names of all files that outputs of a take may have; ``avatars`` are those of its avatars."""
        named = [one for output in outputs for one in output.files(extent, avatars)]
        series = [one for one in named if isinstance(one, Series)]
        return cls({one for one in named if not isinstance(one, Series)}, [*series])

    def __contains__(self, name: str) -> bool:
        """Whether a file is one of them."""
        above, _, last = name.rpartition("/")
        digits, _, suffix = last.partition(".")
        if name in self.files or any(name.startswith(f"{tree}/") for tree in self.trees):
            return True
        if not (digits.isascii() and digits.isdecimal()) or len(digits) > 12 or digits != f"{int(digits):06d}":
            return False
        return any((above, suffix) == (place, kind) and int(digits) in numbers for place, numbers, kind in self.series)

    def below(self, above: str) -> Plan:
        """Return the plan in a folder that holds its folder, by the name of that one."""
        if above in ("", "."):
            return self
        files = {f"{above}/{name}" for name in self.files}
        return Plan(files, [(f"{above}/{place}", *rest) for place, *rest in self.series], self.trees)  # type: ignore[misc]

    def counts(self) -> dict[str, int]:
        """Return the number of files by the top folder they are in, or their name without one."""
        found: dict[str, int] = {}
        for name in self.files:
            found[name.split("/")[0]] = found.get(name.split("/")[0], 0) + 1
        for place, numbers, _ in self.series:
            found[place.split("/")[0]] = found.get(place.split("/")[0], 0) + len(numbers)
        return found

    def obstacle(self, names: Iterable[str]) -> str | None:
        """Return what of some files is in the way of the planned ones: one of their names, or one of a folder."""
        planned = {place for place, _, _ in self.series} | set(self.trees)
        for name in [*self.files, *planned]:
            above = name.rpartition("/")[0]
            while above and above not in planned:
                planned.add(above)
                above = above.rpartition("/")[0]
        for name in names:
            parts = name.split("/")
            way = ("/".join(parts[:depth]) for depth in range(1, len(parts) + 1))
            found = next((part for part in way if part in self), None)
            if found is not None or name in planned:
                return found or name
        return None


class Stage(NamedTuple):
    """A folder in which a command writes.

    Attributes:
        base: The folder that its files go to.
        path: The folder itself.
        goes_on: Whether an earlier command has left it.
        since: When the command took it up [s].
    """

    base: Path
    path: Path
    goes_on: bool
    since: float

    def publish(self, report: Mapping[str, Any], files: Mapping[str, Mapping[str, Any]], name: str = NAME) -> None:
        """Put the files in their places, all or, should this process end before their list is written, none.

        Args:
            report: What the list says beside its files.
            files: All files of the folder from then on; others that its list names now are removed.
            name: Name of the list.

        Raises:
            OutputError: The list cannot be written, and nothing has changed; or files cannot be moved, which the next
                command does then.
        """
        if perf_counter() - self.since > _SLOW or self.goes_on:
            sync_disk(self.path)
        write_manifest(self.path, report, files, name)
        complete(self.base)


def open_stage(
    base: Path,
    name: str,
    key: str,
    report: Mapping[str, Any] | None = None,
    anew: bool = False,
    survives: Iterable[str] = (),
) -> Stage:
    """Return the stage of a command in a folder that this process holds, as an earlier process has left it, or anew.

    Args:
        base: The folder.
        name: Name of the stage.
        key: Checksum of all that the files depend on; what was left under another key is removed.
        report: What the note says besides.
        anew: Whether what was left is removed in any case.
        survives: What is kept where the machine has been started again since: all else may not have been on disk.

    Raises:
        OutputError: It cannot be made, or no command has made what is there.
    """
    path = base / name
    try:
        note = read_note(path)
        if note is None and lexists(path) and not _is_empty(base, name):
            raise OutputError(f"{path}: is in the way, and no command of crowdsim has made it; move it")
        goes_on = note is not None and note["key"] == key and not anew
        if note is not None and not goes_on:
            discard(base, name)
        elif note is not None and note["boot"] != boot_id():
            # Before the note says that it is of this boot.
            for entry in sorted(set(entries(path)) - {NOTE, *survives}):
                remove_tree(path, entry)
        make_inside(base, name)
        document = {"format": FORMAT, "key": key, "boot": boot_id(), **(report or {})}
        write_plain(path, NOTE, signed_text(document), lasts=True)
    except OSError as error:
        raise OutputError(f"{error.filename or path}: cannot be made: {error.strerror or error}") from None
    return Stage(base, path, goes_on, perf_counter())


def _is_empty(base: Path, name: str) -> bool:
    """Whether a stage holds nothing, or half of a note: its command was killed as it began or ended."""
    return is_folder(base, name) and all(held == f".{NOTE}.part" for held in walk(base / name))


def read_note(path: Path) -> dict[str, Any] | None:
    """Return the note of a stage; None where there is none, or it is damaged."""
    try:
        if path.is_symlink():
            return None
        document = parse_json(read_plain(path, NOTE, 1 << 22))
    except (OSError, ValueError):
        return None
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        return None
    texts = all(isinstance(document.get(name), str) for name in ("key", "boot"))
    return document if texts and document.get("checksum") == checksum(document) else None


def stages(base: Path) -> list[Path]:
    """Return the stages in a folder that commands have left or are at work in."""
    return [base / name for name in STAGES if is_folder(base, name) and read_note(base / name) is not None]


def is_complete(stage: Path) -> bool:
    """Whether all files of a stage are whole, and wait to be put in their places."""
    return any(exists_plain(stage, name) for name in (NAME, OUTPUTS))


def discard(base: Path, name: str) -> None:
    """Remove a stage; its note goes last.

    Raises:
        OSError: It cannot be removed.
    """
    path = base / name
    for entry in sorted(set(entries(path)) - {NOTE}):
        remove_tree(path, entry)
    remove_tree(base, name)


def complete(base: Path) -> list[str]:
    """Complete what waits to be put in its place in a folder that this process holds; return the names of the stages.

    Raises:
        TakeError: A list of files is damaged.
        OutputError: Files cannot be moved, or something is in their way.
    """
    found = []
    for name in _empty_stages(base):
        with suppress(OSError):
            remove_tree(base, name)
    for stage in stages(base):
        note = read_note(stage) or {}
        try:
            if is_complete(stage):
                _put_in_place(base, stage, note)
                found.append(stage.name)
            elif note.get("done"):
                discard(base, stage.name)
        except OSError as error:
            raise OutputError(f"{error.filename or base}: cannot be replaced: {error.strerror or error}") from None
    return found


def _empty_stages(base: Path) -> list[str]:
    return [name for name in STAGES if _is_empty(base, name)]


def complete_alone(base: Path) -> None:
    """Complete what a killed command has left in a folder, for a command that does not hold it and may write.

    Raises:
        TakeError: A list of files is damaged.
        OutputError: Files cannot be moved, or another process holds the folder.
    """
    left = any(is_complete(stage) or (read_note(stage) or {}).get("done") for stage in stages(base))
    if left or _empty_stages(base) or (exists_plain(base, LOCK) and find_owner(base) is None):
        with hold_folder(base):
            complete(base)


def _put_in_place(base: Path, stage: Path, note: Mapping[str, Any]) -> None:
    new, old = read_ledger(stage), read_ledger(base)
    staged = [name for name in new.files if exists_plain(stage, name)]
    takes = is_folder(stage, TAKE)
    for name in [
        *staged,
        *(f"{TAKE}/{name}" for name in (walk(base / TAKE) if takes and is_folder(base, TAKE) else ())),
    ]:
        if name not in old.files and exists_plain(base, name):
            raise OutputError(_in_the_way(base / name))
    for name in staged:
        if not name.startswith(f"{TAKE}/"):
            move_plain(stage, name, base)
    if takes:
        if is_folder(base, TAKE):
            move_plain(base, TAKE, stage, _OLD)
        move_plain(stage, TAKE, base)
    for name in sorted(set(old.files) - set(new.files)):
        # A name that any user's file may have, since a scenario reads it or the folder is a user's: the very file.
        with suppress(NotPlainError, FileNotFoundError):
            size = stat_plain(base, name).st_size
            by_us = size == old.files[name]["bytes"] and old.name == NAME and is_written(name)
            if by_us or is_unchanged(base, name, old.files[name]):
                remove_plain(base, [name])
    write_plain(stage, NOTE, signed_text({**note, "done": True}))
    move_plain(stage, new.name, base)
    if new.name == NAME:
        remove_plain(base, [OUTPUTS])
    sync_folder(base)
    discard(base, stage.name)


def _in_the_way(path: Path) -> str:
    what = "is in the way of what is to be written, and no run has written it"
    return f"{path}: {what}; move it, or name another folder with --out"


def refuse_others(base: Path, plan: Plan, ledger: Ledger) -> None:
    """Raise an error where a folder holds files that no command has written in the places of planned ones, or links.

    Raises:
        OutputError: There is one.
    """
    try:
        held = [name for name in walk(base) if name not in ledger.files and name.split("/")[0] not in STAGES]
        # A folder may be in the place of a file, even an empty one.
        held += [name for name in plan.files if is_folder(base, name)]
        held += [
            name for name in ledger.files if name in plan and not exists_plain(base, name) and lexists(base / name)
        ]
    except OSError as error:
        raise OutputError(f"{error.filename or base}: cannot be read: {error.strerror or error}") from None
    found = plan.obstacle(sorted(set(held) - {NAME, OUTPUTS, *LOCKS}))
    if found is not None:
        raise OutputError(_in_the_way(base / found))


def find_base(folder: Path) -> tuple[Path, str]:
    """Return the run folder that a folder is, or is in, without links, and its name there; itself where there is none.

    Raises:
        TakeError: There is one whose manifest is damaged.
    """
    here = Path(realpath(folder))
    for above in (here, *here.parents):
        if exists_plain(above, NAME):
            try:
                read_manifest(above)
            except ForeignManifestError:
                continue
            except TakeError:
                # Further up, files may belong to others.
                if above == here:
                    raise
                continue
        elif read_note(above / RUN) is None:
            continue
        return (folder if above == here else above), here.relative_to(above).as_posix().removeprefix(".")
    return folder, ""


class Wanted(NamedTuple):
    """What a command writes, by which the same command is recognised.

    Attributes:
        stage: Name of its stage.
        asked: What a reader should know of the files, by what they are: an output, or another word.
        plan: Names of the files; anything that the command writes when None.
        made_from: What else they depend on.
        replaces: Folders whose files before are removed.
    """

    stage: str
    asked: Mapping[str, Mapping[str, Any]]
    plan: Plan | None = None
    made_from: Mapping[str, Any] = MappingProxyType({})
    replaces: Sequence[str] = ()


class Writing(NamedTuple):
    """What a command that writes into a folder works with.

    Attributes:
        folder: Where its files go until they are whole.
        done: The files in their places where the same command has written them before, and nothing is to be done.
    """

    folder: Path
    done: tuple[Path, ...] = ()


@contextmanager
def write_together(
    out: Path, wanted: Wanted, run: Path | None = None, force: bool = False, threads: int = 1
) -> Iterator[Writing]:
    """Let a command write files that appear in a folder all together when this context ends, and are recorded there.

    Args:
        out: The folder.
        wanted: What is written.
        run: The run that the files are of; in its own folder they take the place of those before.
        force: Whether files that a command has written into another folder may be replaced.
        threads: Threads that sum up files.

    Raises:
        TakeError: A list of files is damaged.
        OutputError: The folder is in use, is another run's, holds files of these names, or cannot be written.
        RunError: A file cannot be written.
    """
    base, above = find_base(out)
    is_run = base != out or exists_plain(base, NAME) or read_note(base / RUN) is not None
    own = run is not None and is_run and realpath(run) == realpath(base)
    if run is not None and is_run and not own:
        raise OutputError(f"{out}: is in the folder of another run, {base}; expected another folder")
    stage, plan = wanted.stage, wanted.plan
    key = checksum({"asked": wanted.asked, "from": dict(wanted.made_from)})
    names = {f"{above}/{label}" if above else label: facts for label, facts in wanted.asked.items()}
    with hold_folder(base):
        complete(base)
        ledger = read_ledger(base)
        exports = ledger.document.get("exports", {})
        mine = plan and plan.below(above)
        before = [exports.get(name, {}) for name in names]
        if not force and all(facts.get("key") == key for facts in before):
            there = [name for name in ledger.files if name in (mine or before[0].get("files", ()))]
            if there and all(exists_plain(base, name) for name in there):
                if read_note(base / stage) is not None:
                    discard(base, stage)
                yield Writing(base / above, tuple(base / name for name in there))
                return
        if mine is not None:
            _refuse(base, mine, ledger, force or (own and not above))
        held = open_stage(base, stage, key)
        try:
            with under_way():
                make_folder(held.path / above)
                yield Writing(held.path / above)
        except BaseException:
            if mine is None:
                # Nothing goes on with it.
                discard(base, stage)
            raise
        written = sorted(name for name in walk(held.path) if (name in mine if mine else name != NOTE))
        if mine is None:
            try:
                _refuse(base, Plan(set(written)), ledger, force)
            except OutputError:
                discard(base, stage)
                raise
        gone = {f"{above}/{place}" if above else place for place in wanted.replaces}
        kept = {name: facts for name, facts in ledger.files.items() if name.rpartition("/")[0] not in gone}
        more = {"key": key, **({} if mine else {"files": written})}
        report = {**ledger.document, "exports": {**exports, **{name: {**names[name], **more} for name in names}}}
        with under_way():
            held.publish(report, {**kept, **checksums(held.path, written, threads)}, ledger.name)


def _refuse(base: Path, plan: Plan, ledger: Ledger, may_replace: bool) -> None:
    """Raise an error where planned files cannot take their places; what crowdsim has written may be replaced or not."""
    refuse_others(base, plan, ledger)
    there = None if may_replace else next((name for name in sorted(ledger.files) if name in plan), None)
    if there is not None:
        raise OutputError(f"{base / there}: is there already; --force replaces what crowdsim has written")


@contextmanager
def write_pictures(
    out: Path,
    planned: Sequence[Path],
    drawn: Mapping[str, Any],
    mark: str,
    run: Path | None = None,
    force: bool = False,
    threads: int = 1,
) -> Iterator[Writing]:
    """Let a rendering write into a folder, see ``write_together``.

    Args:
        out: The folder.
        planned: All files that it writes there.
        drawn: What a reader should know of them.
        mark: What the pictures depend on.
        run: The run that they are of; None for other sources.
        force: Whether pictures in another folder may be replaced.
        threads: Threads that sum up files.
    """
    names = {path.relative_to(out).as_posix() for path in planned}
    made_from = {"mark": mark, "files": sorted(names)}
    wanted = Wanted(PICTURES, {"pictures": drawn}, Plan(names), made_from)
    with write_together(out, wanted, run, force, threads) as writing:
        yield writing
