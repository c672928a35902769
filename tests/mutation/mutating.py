"""Mutations of text, and the guard under which what was mutated is read."""

import os
import random
import re
import resource
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import deepcopy
from pathlib import Path
from time import process_time
from typing import Any

LONGEST = 2.0
"""How long an input may take [s]."""
MOST_MEMORY = 512 * 1024
"""By how much the memory of the process may grow [KiB]."""
MOST_BYTES = 20_000

_TOKEN = re.compile(rb"[A-Za-z_]+|[0-9.]+|\s+|.", re.DOTALL)
_FORBIDDEN = (
    "os.system", "os.exec", "os.posix_spawn", "os.fork", "subprocess.Popen", "pickle.find_class", "socket.connect",
)  # fmt: skip

NUMBERS = (
    b"0", b"-1", b"1e308", b"-1e308", b"1e-320", b"1e400", b".nan", b".inf", b"nan", b"-inf", b"1.#IND", b"0x7f",
    b"0o17", b"1_000", b"1000000000000", b"9" * 25, b"9" * 450, b"-0.0", b"2147483648", b"9223372036854775808", b"0.1e",
    b"1,5",
)  # fmt: skip
PATHS = (
    b"../up.csv", b"/etc/passwd", b"link.csv", b"../../etc/hostname.csv", b"rows.csv", b"rows.npy", b"pickled.npy",
    b"huge.npy", b"a" * 300 + b".csv",
)  # fmt: skip
WORDS = (
    *PATHS, b"null", b"~", b"yes", b"true", b"version", b"kind", b"groups", b"types", b"extends", b"points", b"file",
    b"a" * 300, b"ROOT", b"JOINT", b"End Site", b"MOTION", b"OFFSET", b"CHANNELS", b"Frames:", b"Frame Time:",
    b"Xrotation",
)  # fmt: skip
SYNTAX = (
    b"&a ", b"*a", b"<<: *a\n", b"? ", b": ", b"- ", b"\t", b"\r", b"\n", b"\n---\n", b"...\n", b"%YAML 9.9\n",
    b"!!binary ", b"!!python/object/apply:os.system ['echo canary']", b"!!python/name:os.system ", b"'", b'"',
    b'"\\x00"', b"!<tag:yaml.org,2002:int> ", b'"\\ud800"', b"|\n", b">-\n", b"{", b"}", b"[", b"]", b"[" * 3000,
    b"- " * 3000, b"{a: " * 3000, b"#", b"@", b"`", b"\0", b"\xff", b"\xef\xbb\xbf", b"\xff\xfe", "\u2028".encode(),
    "\u0085".encode(), "ä".encode(), "\U0001f600".encode(),
)  # fmt: skip


def mutate(rng: random.Random, text: bytes, other: bytes) -> bytes:
    """Return text changed one to four times, in bytes, tokens or lines, or spliced with another one."""
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        text = rng.choice((_bytes, _tokens, _tokens, _lines, _lines, _inserted))(rng, text)
    if rng.random() < 0.05:
        lines, others = text.splitlines(True), other.splitlines(True)
        text = b"".join(lines[: rng.randrange(len(lines) + 1)] + others[rng.randrange(len(others) + 1) :])
    return text[:MOST_BYTES]


def _bytes(rng: random.Random, text: bytes) -> bytes:
    """Flip, remove, repeat or insert bytes."""
    start = rng.randrange(len(text) + 1)
    stop = min(len(text), start + rng.choice((1, 1, 1, 4, 50)))
    kind = rng.randrange(5)
    if kind == 0:
        return text[:start] + bytes(byte ^ 1 << rng.randrange(8) for byte in text[start:stop]) + text[stop:]
    if kind == 1:
        return text[:start] + text[stop:]
    if kind == 2:
        return text[:stop] + text[start:stop] * rng.choice((1, 2, 100)) + text[stop:]
    if kind == 3:
        return text[:start]
    return text[:start] + rng.randbytes(rng.choice((1, 2, 8))) + text[start:]


def _tokens(rng: random.Random, text: bytes) -> bytes:
    """Remove, repeat, swap or replace words, numbers and signs."""
    tokens = _TOKEN.findall(text)
    if not tokens:
        return text
    at, to = rng.randrange(len(tokens)), rng.randrange(len(tokens))
    kind = rng.randrange(6)
    if kind == 0:
        del tokens[at]
    elif kind == 1:
        tokens[at:at] = tokens[at : at + rng.choice((1, 3, 20))]
    elif kind == 2:
        tokens[at], tokens[to] = tokens[to], tokens[at]
    else:
        wanted = [i for i, token in enumerate(tokens) if token[:1].isdigit() if kind == 3] or [at]
        tokens[rng.choice(wanted)] = rng.choice((NUMBERS, NUMBERS, WORDS, SYNTAX)[kind - 3 if kind > 2 else 0])
    return b"".join(tokens)


def _lines(rng: random.Random, text: bytes) -> bytes:
    """Remove, repeat, swap or indent lines, and so keys and items."""
    lines = text.splitlines(True)
    if not lines:
        return text
    at, to = rng.randrange(len(lines)), rng.randrange(len(lines))
    kind = rng.randrange(5)
    if kind == 0:
        del lines[at]
    elif kind == 1:
        lines[at:at] = lines[at : at + rng.choice((1, 1, 5))] * rng.choice((1, 1, 30))
    elif kind == 2:
        lines[at], lines[to] = lines[to], lines[at]
    elif kind == 3:
        lines[at] = rng.choice((b" ", b"  ", b"    ", b"\t")) + lines[at]
    else:
        lines[at] = lines[at].lstrip(b" ")
    return b"".join(lines)


def _inserted(rng: random.Random, text: bytes) -> bytes:
    """Insert syntax, a number or a word."""
    at = rng.randrange(len(text) + 1)
    return text[:at] + rng.choice(rng.choice((SYNTAX, SYNTAX, NUMBERS, WORDS))) + text[at:]


def mutate_tree(rng: random.Random, data: Any) -> Any:
    """Return plain data with keys removed, repeated, swapped or renamed, and values replaced; mappings as pairs."""
    tree = _pairs(data)
    for _ in range(rng.choice((1, 1, 2, 4))):
        places = list(_places(tree))
        if not places:
            break
        # Files are the rarest of values, and what can do most harm.
        files = [(one, at) for one, at in places if isinstance(one, Pairs) and one[at][0] == "file"]
        holder, at = rng.choice(files if files and rng.random() < 0.1 else places)
        kind = rng.randrange(7)
        key, value = holder[at] if isinstance(holder, Pairs) else (None, holder[at])
        if kind == 0:
            del holder[at]
        elif kind == 1:
            holder.insert(at, holder[at])
        elif kind == 2:
            other, to = rng.choice(places)
            if to < len(other):
                swapped = deepcopy(other[to][1] if isinstance(other, Pairs) else other[to])
                holder[at] = (key, swapped) if isinstance(holder, Pairs) else swapped
        elif kind == 3 and key is not None:
            changed = key[: rng.randrange(len(key) + 1)] + rng.choice(("", "x", "é", "\0")) + key[1:]
            holder[at] = (rng.choice((changed, "kind", "<<", "", "a" * 500)), value)
        elif kind == 4:
            holder[at] = (key, [value]) if isinstance(holder, Pairs) else [value]
        else:
            choices = PATHS if key in ("file", "clips") else rng.choice((NUMBERS, WORDS, SYNTAX, (b"[]", b"{}", b"''")))
            fresh = Raw(rng.choice(choices))
            holder[at] = (key, fresh) if isinstance(holder, Pairs) else fresh
    return tree


class Pairs(list):
    """A mapping as a list of its pairs, which may have a key twice."""


class Raw(bytes):
    """Text that stands for itself."""


def _pairs(data: Any) -> Any:
    if isinstance(data, dict):
        return Pairs((str(key), _pairs(value)) for key, value in data.items())
    return [_pairs(item) for item in data] if isinstance(data, list) else data


def _places(tree: Any) -> Iterator[tuple[list, int]]:
    for at, item in enumerate(tree) if isinstance(tree, list) else ():
        yield tree, at
        yield from _places(item[1] if isinstance(tree, Pairs) else item)


def flow(tree: Any, depth: int = 0) -> bytes:
    """Return a tree as YAML: its outermost mapping in lines, all others in braces."""
    if isinstance(tree, Raw):
        return bytes(tree)
    if isinstance(tree, Pairs):
        items = [quote(key) + b": " + flow(value, depth + 1) for key, value in tree]
        return b"\n".join(items) if depth == 0 else b"{" + b", ".join(items) + b"}"
    if isinstance(tree, list):
        return b"[" + b", ".join(flow(item, depth + 1) for item in tree) + b"]"
    if isinstance(tree, str):
        return quote(tree)
    return b"null" if tree is None else str(tree).lower().encode()


def quote(text: str) -> bytes:
    return b'"' + text.encode("utf-8", "replace").replace(b"\\", b"\\\\").replace(b'"', b'\\"') + b'"'


class Guard:
    """Watches what reading does: it takes no longer than it may, runs nothing and opens nothing outside its roots.

    Args:
        roots: Folders in which files may be opened, beside those of Python and of the package.
    """

    def __init__(self, *roots: Path) -> None:
        own = (sys.prefix, sys.base_prefix, Path(__file__).parents[2], Path.home() / ".cache")
        self._roots = tuple(os.path.realpath(root) for root in (*roots, *own))
        self._base = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        self._is_on = False
        self.seen: list[str] = []
        sys.addaudithook(self._audit)

    def _audit(self, event: str, arguments: tuple[Any, ...]) -> None:
        if not self._is_on:
            return
        if event in _FORBIDDEN:
            self.seen.append(f"{event} {arguments!r}")
        elif event in ("open", "os.listdir", "os.scandir") and isinstance(arguments[0], str | bytes | os.PathLike):
            path = os.path.realpath(os.fsdecode(arguments[0]))
            if not path.startswith(self._roots):
                self.seen.append(f"{event} {path}")

    @contextmanager
    def watch(self, text: bytes) -> Iterator[None]:
        """Watch an input being read."""
        signal.signal(signal.SIGVTALRM, _too_long)
        signal.setitimer(signal.ITIMER_VIRTUAL, 3 * LONGEST)
        since, self._is_on = process_time(), True
        try:
            yield
        finally:
            self._is_on = False
            seconds = process_time() - since
            signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        assert seconds < LONGEST, f"{seconds:.1f} s for {text!r}"
        assert not self.seen, f"{self.seen} of {text!r}"

    def check_memory(self) -> None:
        """The process has not grown beyond what it may."""
        grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - self._base
        assert grown <= MOST_MEMORY, f"the memory has grown by {grown / 1024:.0f} MiB"


def _too_long(*_: Any) -> None:
    raise AssertionError("an input takes too long")


def check_batch(
    guard: Guard, seed: int, count: int, make: Callable[[random.Random], bytes], read: Callable[[bytes], None]
) -> None:
    """Read ``count`` inputs made from a seed; where one is wrong, say which."""
    rng = random.Random(seed)
    for number in range(count):
        text = make(rng)
        try:
            with guard.watch(text):
                read(text)
        except BaseException:
            print(f"seed {seed}, input {number}: {text!r}")
            raise
    guard.check_memory()
