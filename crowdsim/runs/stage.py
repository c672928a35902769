"""Folders in which commands write until all is whole; then the files take their places all together.

A stage lies in the folder that its files go to. Its note ``stage.json`` names what is written there by a key: the same
command goes on with it, and another one begins anew. Nothing outside a stage changes until it holds a list of all files
(``manifest``), which is written last. From then on its files are moved, those that they replace removed, and the list
comes last; where the process ends on the way, the next command that writes completes it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from contextlib import AbstractContextManager, contextmanager
from os.path import lexists, realpath
from pathlib import Path
from time import perf_counter
from types import MappingProxyType
from typing import Any, NamedTuple

from crowdsim.config.documents import parse_json
from crowdsim.errors import OutputError, ScenarioError, TakeError, under_way
from crowdsim.files import (
    Writing,
    entries,
    exists_plain,
    is_folder,
    make_folder,
    make_inside,
    move_plain,
    read_plain,
    remove_plain,
    remove_tree,
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
    difference,
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
MOST_FILES = 200_000
"""Most files of outputs, so that a manifest can list them all."""
_SLOW = 10.0
"""From how long on work is worth a wait for the disk [s]."""


def planned_files(outputs: Iterable[Output], extent: Extent, avatars: Sequence[str], scenario: str) -> set[str]:
    """Return the names of all files that outputs of a take may have.

    Args:
        outputs: The outputs.
        extent: How much there is of the take.
        avatars: Names of its avatars.
        scenario: Name of its scenario, for messages.

    Raises:
        ScenarioError: There are too many for a list of them.
    """
    named = [one for output in outputs for one in output.files(extent, avatars)]
    count = sum(len(one.numbers) if isinstance(one, Series) else 1 for one in named)
    if count > MOST_FILES:
        raise ScenarioError(f"{scenario}: outputs are {count:,} files, expected at most {MOST_FILES:,}")
    return {name for one in named for name in (one.names() if isinstance(one, Series) else [one])}


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
        if note is None and lexists(path):
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


def discard(base: Path, name: str) -> None:
    """Remove a stage; its note goes last.

    Raises:
        OSError: It cannot be removed.
    """
    path = base / name
    for entry in sorted(set(entries(path)) - {NOTE}):
        remove_tree(path, entry)
    remove_tree(base, name)


def _state(base: Path, name: str) -> str:
    """Return how far a stage is: ``begun``, ``whole``, or ``over``, of which only rests are there; else nothing."""
    path = base / name
    if not is_folder(base, name):
        return ""
    note = read_note(path)
    if note is None:
        # Its command was killed as it began or ended, or it is no stage.
        return "over" if all(held == f".{NOTE}.part" for held in walk(path)) else ""
    if exists_plain(path, NAME) or exists_plain(path, OUTPUTS):
        return "whole"
    return "over" if note.get("done") else "begun"


def complete(base: Path) -> None:
    """Complete what waits to be put in its place in a folder that this process holds.

    Raises:
        TakeError: A list of files is damaged.
        OutputError: Files cannot be moved, or something is in their way.
    """
    try:
        for name in STAGES:
            state = _state(base, name)
            if state == "whole":
                _put_in_place(base, base / name)
            elif state == "over":
                discard(base, name)
    except OSError as error:
        raise OutputError(f"{error.filename or base}: cannot be replaced: {error.strerror or error}") from None


def complete_alone(base: Path) -> None:
    """Complete what a killed command has left in a folder, for a command that does not hold it and may write.

    Raises:
        TakeError: A list of files is damaged.
        OutputError: Files cannot be moved, or another process holds the folder.
    """
    left = any(_state(base, name) in ("whole", "over") for name in STAGES)
    if left or (exists_plain(base, LOCK) and find_owner(base) is None):
        with hold_folder(base):
            complete(base)


def _put_in_place(base: Path, stage: Path) -> None:
    new, old = read_ledger(stage), read_ledger(base)
    staged = [name for name in new.files if exists_plain(stage, name)]
    takes = is_folder(stage, TAKE)
    for name in [*staged, *(walk(base, TAKE) if takes and is_folder(base, TAKE) else ())]:
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
        # Any file of a user may have come in its place.
        if not difference(base, name, old.files[name]):
            remove_plain(base, [name])
    write_plain(stage, NOTE, signed_text({**(read_note(stage) or {}), "done": True}))
    move_plain(stage, new.name, base)
    if new.name == NAME:
        remove_plain(base, [OUTPUTS])
    sync_folder(base)
    discard(base, stage.name)


def _in_the_way(path: Path) -> str:
    what = "is in the way of what is to be written, and no run has written it"
    return f"{path}: {what}; move it, or name another folder with --out"


def refuse_others(base: Path, planned: Set[str], ledger: Ledger) -> None:
    """Raise an error where a folder holds files that no command has written in the places of planned ones, or links.

    Args:
        base: The folder.
        planned: Names of the files; ``TAKE`` stands for all that a take holds.
        ledger: What commands have written there.

    Raises:
        OutputError: There is one.
    """
    folders = {""}
    for name in planned:
        while (name := name.rpartition("/")[0]) not in folders:
            folders.add(name)
    try:
        held = {name for name in walk(base) if name not in ledger.files and name.split("/")[0] not in STAGES}
        # A folder may be in the place of a file, even an empty one; and a link in that of one of ours.
        held |= {name for name in planned - {TAKE} if is_folder(base, name)}
        held |= {
            name for name in planned & ledger.files.keys() if not exists_plain(base, name) and lexists(base / name)
        }
        # A file in place of a folder is an error, even one that crowdsim wrote.
        files = {name for name in folders - {""} if exists_plain(base, name)}
    except OSError as error:
        raise OutputError(f"{error.filename or base}: cannot be read: {error.strerror or error}") from None
    for name in sorted((held - {NAME, OUTPUTS, *LOCKS}) | files):
        if name in planned or name in folders or (TAKE in planned and name.startswith(f"{TAKE}/")):
            raise OutputError(_in_the_way(base / name))


def find_base(folder: Path) -> tuple[Path, str] | None:
    """Return the run folder that a folder is, or is in, without links, and its name there; None where there is none.

    Raises:
        TakeError: Its own manifest is damaged.
    """
    here = Path(realpath(folder))
    for above in (here, *here.parents):
        try:
            is_run = read_note(above / RUN) is not None or (exists_plain(above, NAME) and bool(read_manifest(above)))
        except TakeError as error:
            # It may belong to another program, and what is further up to others.
            if above == here and not isinstance(error, ForeignManifestError):
                raise
            continue
        if is_run:
            inside = here.relative_to(above).as_posix()
            return (folder, "") if inside == "." else (above, inside)
    return None


class Wanted(NamedTuple):
    """What a command writes, by which the same command is recognised.

    Attributes:
        stage: Name of its stage.
        asked: What a reader should know of the files, by what they are: an output, or another word.
        files: Their names; anything that the command writes when None.
        made_from: What else they depend on.
        replaces: Folders whose files before are removed.
    """

    stage: str
    asked: Mapping[str, Mapping[str, Any]]
    files: Set[str] | None = None
    made_from: Mapping[str, Any] = MappingProxyType({})
    replaces: Sequence[str] = ()


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
        OutputError: The folder is in use, is another run's or in a take, holds files of these names, or cannot be
            written.
        RunError: A file cannot be written.
    """
    found = find_base(out)
    base, above = found or (out, "")
    own = found is not None and run is not None and realpath(run) == realpath(base)
    if found is not None and run is not None and not own:
        raise OutputError(f"{out}: is in the folder of another run, {base}; expected another folder")
    if above.partition("/")[0] in (TAKE, *STAGES):
        raise OutputError(f"{out}: is inside a folder that crowdsim keeps in the run {base}; expected another folder")
    key = checksum({"asked": wanted.asked, "from": dict(wanted.made_from)})
    inside = f"{above}/" if above else ""
    asked = {f"{inside}{label}": facts for label, facts in wanted.asked.items()}
    mine = None if wanted.files is None else {f"{inside}{name}" for name in wanted.files}
    with hold_folder(base):
        complete(base)
        ledger = read_ledger(base)
        exports = ledger.document.get("exports", {})
        before = [exports.get(name, {}) for name in asked]
        is_same = not force and all(facts.get("key") == key for facts in before)
        there = [name for name in ledger.files if is_same and name in (mine or before[0].get("files", ()))]
        if there and all(exists_plain(base, name) for name in there):
            if read_note(base / wanted.stage) is not None:
                discard(base, wanted.stage)
            yield Writing(base / above, tuple(base / name for name in there))
            return
        if mine is not None:
            _refuse(base, mine, ledger, force or (own and not above))
        stage = open_stage(base, wanted.stage, key)
        try:
            with under_way():
                make_folder(stage.path / above)
                yield Writing(stage.path / above)
            written = sorted(name for name in walk(stage.path) if (name != NOTE if mine is None else name in mine))
            if mine is None:
                _refuse(base, set(written), ledger, force)
        except BaseException:
            if mine is None:
                # Nothing goes on with it.
                discard(base, wanted.stage)
            raise
        gone = {f"{inside}{place}" for place in wanted.replaces}
        kept = {name: facts for name, facts in ledger.files.items() if name.rpartition("/")[0] not in gone}
        more = {"key": key, **({"files": written} if mine is None else {})}
        report = {**ledger.document, "exports": {**exports, **{name: {**asked[name], **more} for name in asked}}}
        with under_way():
            stage.publish(report, {**kept, **checksums(stage.path, written, threads)}, ledger.name)


def _refuse(base: Path, planned: Set[str], ledger: Ledger, may_replace: bool) -> None:
    """Raise an error where planned files cannot take their places; what crowdsim has written may be replaced or not."""
    refuse_others(base, planned, ledger)
    there = None if may_replace else min(planned & ledger.files.keys(), default=None)
    if there is not None:
        raise OutputError(f"{base / there}: is there already; --force replaces what crowdsim has written")


def record_pictures(
    out: Path,
    planned: Sequence[Path],
    mark: str,
    facts: Mapping[str, Any],
    *,
    run: Path | None = None,
    force: bool = False,
    threads: int = 1,
) -> AbstractContextManager[Writing]:
    """Let a rendering write its files together (``render.batch.Record``); other arguments as of ``write_together``."""
    names = {path.relative_to(out).as_posix() for path in planned}
    wanted = Wanted(PICTURES, {"pictures": facts}, names, {"mark": mark, "files": sorted(names)})
    return write_together(out, wanted, run, force, threads)
