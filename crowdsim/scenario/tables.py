"""Tables of avatars: a CSV file with a row for each avatar of a group, of which nothing is taken for granted."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, TextIO

from crowdsim.config.schema import join
from crowdsim.config.tree import MOST_FINDINGS, shortened
from crowdsim.errors import nearest
from crowdsim.scenario.names import NAME_RULE, is_name
from crowdsim.scenario.parts import FARTHEST

REQUIRED = ("name", "x", "z")
OPTIONAL = ("heading", "type", "team", "number")
MOST_ROWS = 1_000_000
_COLUMNS = (*REQUIRED, *OPTIONAL)
_LONGEST_LINE = 10_000
_LARGEST_NUMBER = 10**9
_QUOTED = re.compile(r' *"((?:[^"]|"")*)" *')
_LISTED = "avatars"
"""The stem of the list of avatars that lies beside a file of each (``export.posed``)."""


class Cell(NamedTuple):
    """Text of a cell, and where it is: line and column from 1."""

    text: str
    line: int
    column: int


class Row(NamedTuple):
    """An avatar of a table.

    Attributes:
        name: Its name.
        x: Position [m].
        z: Likewise.
        heading: Heading [degrees]; None where the table gives none.
        type: Name of its type; an empty cell where the table gives none.
        team: Name of its team; likewise.
    """

    name: Cell
    x: float
    z: float
    heading: float | None
    type: Cell
    team: Cell


class TableError(ValueError):
    """A table is wrong in one place or several.

    Attributes:
        faults: Each as ``LINE:COLUMN: what is wrong, what was expected``.
    """

    def __init__(self, faults: Sequence[str]) -> None:
        super().__init__("; ".join(faults))
        self.faults = tuple(faults)


def at(cell: Cell, message: str) -> str:
    """Return a fault of a cell with its line and column."""
    return f"{cell.line}:{cell.column}: {message}"


def read_table(path: Path) -> tuple[Row, ...]:
    """Return the rows of a table by the numbers of their avatars, or else as they follow in the file.

    Raises:
        TableError: The file is no such table; every fault is in it, up to ``MOST_FINDINGS``.
        OSError: It cannot be read.
    """
    faults: list[str] = []
    rows: list[Row] = []
    numbers: list[Cell] = []
    with path.open(encoding="utf-8-sig", errors="surrogateescape") as file:
        lines = _lines(file, faults)
        first = next(lines, None)
        if first is None:
            raise TableError(faults or [f"1:1: the file is empty, expected columns {join(REQUIRED, 'and')}"])
        separator = next((one for one in ",;\t" if one in first[1]), ",")
        names = _columns(_split(first[1], first[0], separator, faults), faults)
        if faults:
            raise TableError(faults)
        for number, line in lines:
            cells = _split(line, number, separator, faults)
            if len(cells) != len(names):
                faults.append(f"{number}:1: the row has {len(cells)} cells, expected {len(names)} as the first line")
            else:
                row = dict(zip(names, cells, strict=True))
                rows.append(_read_row(row, number, faults))
                numbers += [row["number"]] if "number" in row else []
            if len(faults) >= MOST_FINDINGS or len(rows) > MOST_ROWS:
                break
    if len(rows) > MOST_ROWS:
        faults.append(f"{rows[-1].name.line}:1: a row more than {MOST_ROWS:,}, which is the most")
    if not rows and not faults:
        faults.append(f"{first[0] + 1}:1: the table has no rows, expected one for each avatar")
    order = _order(numbers, faults) if numbers and not faults else list(range(len(rows)))
    faults += [at(*fault) for fault in name_faults([row.name for row in rows])]
    if faults:
        raise TableError(faults[:MOST_FINDINGS])
    return tuple(rows[i] for i in order)


def name_faults(names: Sequence[Cell]) -> Iterator[tuple[Cell, str]]:
    """Yield a fault for each name that another avatar of a table has, whatever the case of its letters."""
    seen: dict[str, Cell] = {}
    for cell in names:
        other = seen.setdefault(cell.text.casefold(), cell)
        if other is not cell and cell.text:
            yield cell, f"name is {cell.text!r} like that in line {other.line}, expected a name of its own"


def _lines(file: TextIO, faults: list[str]) -> Iterator[tuple[int, str]]:
    """Yield lines that are not blank, with their numbers, to the first that cannot be read."""
    number = 0
    while True:
        number += 1
        line = file.readline(_LONGEST_LINE)
        if not line:
            return
        wrong = re.search("[\udc80-\udcff]", line)  # what "surrogateescape" makes of a byte
        if wrong is not None:
            byte = ord(wrong[0]) & 0xFF
            faults.append(f"{number}:{wrong.start() + 1}: byte 0x{byte:02x} is no UTF-8, expected a text file in UTF-8")
            return
        if len(line) == _LONGEST_LINE:
            faults.append(f"{number}:1: the line is longer than {_LONGEST_LINE:,} characters, expected a row of cells")
            return
        if line.strip():
            yield number, line.rstrip("\n")


def _split(line: str, number: int, separator: str, faults: list[str]) -> list[Cell]:
    """Return the cells of a line, without blanks around them; one that has a separator in it is in double quotes."""
    cells, start = [], 0
    while True:
        quoted = _QUOTED.match(line, start)
        if quoted is not None:
            end, text = quoted.end(), quoted[1].replace('""', '"')
            if line[end : end + 1] not in ("", separator):
                faults.append(f"{number}:{end + 1}: text behind a quoted cell, expected {separator!r}")
        else:
            end = line.find(separator, start)
            end = len(line) if end < 0 else end
            text = line[start:end]
            if text.lstrip().startswith('"'):
                faults.append(f"{number}:{start + 1}: a quote that is not closed in its line, expected '\"' at its end")
                text = text.replace('"', "")
        blank = len(line[start:end]) - len(line[start:end].lstrip()) if text.strip() else 0
        cells.append(Cell(text.strip(), number, start + blank + 1))
        start = line.find(separator, end) + 1
        if start == 0:
            return cells


def _columns(cells: list[Cell], faults: list[str]) -> list[str]:
    """Return the names of columns; each may have a unit: ``x [m]``."""
    names = [re.split(r"[\s(\[]", cell.text.lower())[0] for cell in cells]
    for i, (name, cell) in enumerate(zip(names, cells, strict=True)):
        if name not in _COLUMNS:
            what = f"no known column {shortened(cell.text)!r}, expected {join(_COLUMNS)}{nearest(name, _COLUMNS)}"
            faults.append(at(cell, what))
        elif name in names[:i]:
            faults.append(at(cell, f"a second column {name!r}, expected one"))
    missing = [name for name in REQUIRED if name not in names]
    if missing:
        what = f"no column {join(missing, 'and')}, expected {join(REQUIRED, 'and')} in the first line"
        faults.append(at(cells[0], what))
    return names


def _read_row(row: dict[str, Cell], line: int, faults: list[str]) -> Row:
    name = row["name"]
    if not is_name(name.text):
        faults.append(at(name, f"name is {shortened(name.text)!r}, expected one of {NAME_RULE}"))
    elif re.fullmatch(r"\d+(-\d+)?", name.text):
        faults.append(at(name, f"name is {name.text!r}, which means avatars by number, expected a letter in it"))
    elif name.text.casefold() == _LISTED:
        faults.append(at(name, f"name is {name.text!r}, as the list beside exported files, expected another one"))
    none = Cell("", line, 1)
    kind, team = row.get("type", none), row.get("team", none)
    for key, cell in (("type", kind), ("team", team)):
        if cell.text and not is_name(cell.text):
            faults.append(at(cell, f"{key} is {shortened(cell.text)!r}, expected a name of {NAME_RULE}"))
    x, z = (_number(row[key], key, FARTHEST, "metres", faults) for key in ("x", "z"))
    heading = row.get("heading", none)
    degrees = _number(heading, "heading", 360.0, "degrees", faults) if heading.text else None
    return Row(name, x, z, degrees, kind, team)


def _number(cell: Cell, key: str, most: float, unit: str, faults: list[str]) -> float:
    try:
        value = float(cell.text) if "_" not in cell.text else math.nan
    except ValueError:
        value = math.nan
    if not abs(value) <= most:
        what = f"{key} is {shortened(cell.text)!r}, expected {unit} from {-most:g} to {most:g}"
        faults.append(at(cell, what))
    return value


def _order(numbers: Sequence[Cell], faults: list[str]) -> list[int]:
    """Return which row comes first, second, and so on by the numbers in their cells: from 0 on, each once."""
    seen: dict[int, Cell] = {}
    rows: list[int] = [0] * len(numbers)
    for i, cell in enumerate(numbers):
        value = int(cell.text) if re.fullmatch(r"[0-9]{1,9}", cell.text) else _LARGEST_NUMBER
        if value >= len(numbers):
            what = f"number is {shortened(cell.text)!r}, expected whole numbers from 0 to {len(numbers) - 1}"
            faults.append(at(cell, f"{what}, each once"))
        elif seen.setdefault(value, cell) is not cell:
            faults.append(at(cell, f"number is {value} like that in line {seen[value].line}, expected each once"))
        else:
            rows[value] = i
    return rows
