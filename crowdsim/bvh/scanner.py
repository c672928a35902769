"""Walks over BVH text, and says where in it something is wrong."""

from __future__ import annotations

import math
import re

from crowdsim.errors import BvhError

_TOKEN = re.compile(rb"\s*([{}]|[^\s{}]+)")
_NUMBER = re.compile(rb"[+-]?(\d+[.,]?\d*|[.,]\d+)(e[+-]?\d+)?", re.IGNORECASE)
_BAD_NUMBER = re.compile(rb"([+-]?)(?:1\.#)?(nan|inf|infinity|qnan|snan|ind|j)\d*(\([a-z0-9]*\))?", re.IGNORECASE)
_LINE_END = re.compile(rb"\r\n|\r|\n")
_BLANKS = re.compile(rb"\s*")
_LONGEST_NAME = 256
_LONGEST_LINE = 1 << 20
_MOST_FINDINGS = 20


def read_number(token: bytes) -> float | None:
    """Return the number that a token spells, or None: '1.5', '1,5', '-2e-3', 'nan', '-inf', Windows' '-1.#IND'."""
    if _NUMBER.fullmatch(token):
        return float(token.replace(b",", b"."))
    bad = _BAD_NUMBER.fullmatch(token)
    if bad is None:
        return None
    if bad[2].lower().startswith((b"inf", b"j")):
        return -math.inf if bad[1] == b"-" else math.inf
    return math.nan


def show(token: bytes) -> str:
    """Return a token for a message: quoted, and shortened when it is long."""
    text = token[:200].decode("latin-1")
    return repr(text if len(text) <= 40 else text[:37] + "...")


class Scanner:
    """Walks over the tokens of BVH text: braces, and runs of anything else between white space and braces."""

    def __init__(self, data: bytes, path: str) -> None:
        self.data = data
        self.path = path
        self.at = 0
        self.start = 0
        self.frames_at = 0
        self.findings: list[str] = []
        self.faults: list[str] = []
        self._check_lines()

    def _check_lines(self) -> None:
        """Refuse text with a line that is too long to be one of a BVH."""
        start, size = 0, len(self.data)
        while size - start > _LONGEST_LINE:
            end = max(self.data.rfind(sign, start, start + _LONGEST_LINE) for sign in (b"\n", b"\r"))
            if end < 0:
                what = f"a line of more than {_LONGEST_LINE:,} bytes, expected shorter ones"
                raise BvhError(f"{self.where(start)}: {what}")
            start = end + 1

    def next(self) -> bytes:
        """Return the next token and step over it; empty at the end."""
        match = _TOKEN.match(self.data, self.at)
        if match is None:
            self.start = self.at = len(self.data)
            return b""
        self.start, self.at = match.start(1), match.end()
        return match[1]

    def peek(self) -> bytes:
        """Return the next token and stay before it."""
        match = _TOKEN.match(self.data, self.at)
        return b"" if match is None else match[1]

    def line_of(self, place: int) -> int:
        """Return the line of a place in the data, from 1."""
        data = self.data
        both = data.count(b"\r\n", 0, place)
        return 1 + data.count(b"\n", 0, place) + data.count(b"\r", 0, place) - both

    def where(self, place: int) -> str:
        """Return a place in the data for a message: ``PATH:LINE:COLUMN``, both from 1."""
        begin = max(self.data.rfind(b"\n", 0, place), self.data.rfind(b"\r", 0, place)) + 1
        column = len(self.data[begin:place].decode("utf-8", "replace")) + 1
        return f"{self.path}:{self.line_of(place)}:{column}"

    def error(self, expected: str, place: int | None = None) -> BvhError:
        """Return the error that the token at ``place``, by default the last one, is not what was expected."""
        place = self.start if place is None else place
        match = _TOKEN.match(self.data, place)
        found = f"found {show(match[1])}" if match else "the file ends"
        where = self.where(match.start(1) if match else len(self.data))
        return BvhError(f"{where}: {found}, expected {expected}")

    def find(self, what: str, place: int | None = None) -> None:
        """Note a finding about the token at ``place``, by default the last one, up to a limit."""
        if len(self.findings) < _MOST_FINDINGS:
            self.note(what, self.start if place is None else place)

    def note(self, what: str, place: int) -> None:
        """Note a finding about the token at ``place``, however many there are."""
        self.findings.append(f"{self.where(place)}: {what}")

    def fault(self, what: str, place: int) -> None:
        """Note a finding by which the motion is incomplete or wrong, about the token at ``place``."""
        self.note(what, place)
        self.faults.append(self.findings[-1])

    def name(self) -> bytes:
        """Return the text before the opening brace, and step over both.

        A name is one line and may hold blanks, colons, keywords and, where the opening brace is on a line below,
        braces.
        """
        blanks = _BLANKS.match(self.data, self.at)
        self.at = self.at if blanks is None else blanks.end()
        brace = self.data.find(b"{", self.at)
        line_end = _LINE_END.search(self.data, self.at, brace if brace >= 0 else len(self.data))
        if line_end is None and self._is_glued(brace):
            # A brace inside a word, as in hand{1}: part of the name when the line below opens the block.
            end = _LINE_END.search(self.data, brace, brace + _LONGEST_NAME)
            if end is not None and self._token_at(end.start()) == b"{":
                line_end = end
        stop = line_end.start() if line_end else brace if brace >= 0 else len(self.data)
        name = self.data[self.at : stop]
        if len(name.rstrip()) > _LONGEST_NAME:
            raise self.error(f"a name of at most {_LONGEST_NAME} bytes", self.at)
        self.at = stop
        if self.next() != b"{":
            raise self.error("'{'")
        return name.strip()

    def _is_glued(self, brace: int) -> bool:
        around = self.data[max(self.at, brace - 1) : brace] + self.data[brace + 1 : brace + 2]
        return brace > self.at and len(around) == 2 and not around[:1].isspace() and not around[1:].isspace()

    def _token_at(self, place: int) -> bytes:
        match = _TOKEN.match(self.data, place)
        return b"" if match is None else match[1]
