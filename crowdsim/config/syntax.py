"""What is wrong with text that is no YAML, in words of the text instead of the parser's."""

from __future__ import annotations

import re

import yaml

_KEY = re.compile(r"\s*(?:- +)*(?:\"[^\"]*\"|'[^']*'|[^\s#'\"{}\[\],&*!|>%@`-][^#]*?)\s*:(\s|$)")
_NO_BLANK = re.compile(r"\s*(?:- +)*[\w.-]+:[^\s/]")
_DASHES = re.compile(r"\s*(?:- +)+")


def explain(error: yaml.MarkedYAMLError, text: str) -> tuple[int, int, str]:
    """Return line, column and a message for an error of PyYAML; lines and columns count from 1."""
    mark = error.problem_mark or error.context_mark
    if mark is None:
        return 1, 1, f"broken YAML: {error.problem or 'cannot be read'}"
    problem = str(error.problem or "cannot be read")
    lines = text.splitlines()
    here = (mark.line + 1, mark.column + 1)
    if error.context == "expected a single document in the stream":
        return *here, "another document begins, expected a single one in the file"
    if problem.startswith(("mapping values are not allowed", "expected <block end>")):
        wrong = _wrong_indentation(lines, mark.line)
        if wrong is not None:
            return mark.line + 1, _indentation(lines[mark.line]) + 1, wrong
    if problem == "expected <block end>, but found '-'":
        return *here, "broken YAML: a list item among keys, expected KEY: VALUE"
    if problem == "expected <block end>, but found '?'":
        return *here, "broken YAML: a key among the items of a list, expected '- '"
    if problem.startswith("mapping values are not allowed"):
        above = lines[mark.line - 1] if 0 < mark.line <= len(lines) else ""
        if _NO_BLANK.match(above):
            return mark.line, above.index(":") + 2, "broken YAML: no blank after the ':', expected KEY: VALUE"
        return *here, "broken YAML: a second ':' in a value, expected quotes around text that holds ': '"
    if problem == "could not find expected ':'" and error.context_mark is not None:
        start = error.context_mark
        word = lines[start.line][start.column :].strip() if start.line < len(lines) else ""
        return start.line + 1, start.column + 1, f"broken YAML: {word!r} has no ':', expected KEY: VALUE"
    if "'\\t'" in problem:
        problem += "; indent with spaces, not with tabs"
    context = f"{error.context}: " if error.context else ""
    return *here, f"broken YAML: {context}{problem}"


def _wrong_indentation(lines: list[str], number: int) -> str | None:
    """Return how far a line should be indented, or None where its indentation is not what is wrong."""
    if number >= len(lines):
        return None
    own = _indentation(lines[number])
    fitting: dict[int, int] = {}
    least = 10**9
    for above in range(number - 1, -1, -1):
        line = lines[above]
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        dashes, indentation = _DASHES.match(line), _indentation(line)
        if dashes is not None and dashes.end() < least and _KEY.match(line):
            fitting.setdefault(dashes.end(), above + 1)
        if indentation < least:
            fitting.setdefault(indentation, above + 1)
            least = indentation
        if least == 0:
            break
    if not fitting or own in fitting or (not _KEY.match(lines[number]) and not _DASHES.match(lines[number])):
        return None
    ways = [f"{spaces} as in line {line}" for spaces, line in sorted(fitting.items(), reverse=True)]
    expected = " or ".join([", ".join(ways[:-1]), ways[-1]] if len(ways) > 1 else ways)
    return f"wrong indentation of {own} space{'s'[: own != 1]}, expected {expected}"


def _indentation(line: str) -> int:
    return len(line) - len(line.lstrip(" "))
