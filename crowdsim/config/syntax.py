"""What is wrong with text that is no YAML, in words of the text instead of the parser's."""

from __future__ import annotations

import re

import yaml

from crowdsim.config.schema import join

_KEY = re.compile(
    r"\s*(?:- +)*(?:\"[^\"]*\"\s*|'[^']*'\s*|[^\s#'\"{}\[\],&*!|>%@`:-][^#:]*(?::(?!\s|$)[^#:]*)*):(\s|$)"
)
_NO_BLANK = re.compile(r"\s*(?:- +)*[\w.-]+:[^\s/]")
_OF_LIBYAML = ("did not find expected key", "did not find expected '-' indicator")
_DASHES = re.compile(r"\s*(?:- +)+")


def explain(error: yaml.MarkedYAMLError, text: str) -> tuple[int, int, str]:
    """Return line, column and a message for an error of PyYAML; lines and columns count from 1."""
    mark, start = error.problem_mark or error.context_mark, error.context_mark
    problem = str(error.problem or "cannot be read")
    if mark is None:
        return 1, 1, f"broken YAML: {problem}"
    lines, here = text.splitlines(), (mark.line + 1, mark.column + 1)
    if problem.startswith(("mapping values are not allowed", "expected <block end>", *_OF_LIBYAML)):
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
    if problem == "could not find expected ':'" and start is not None:
        word = lines[start.line][start.column :].strip() if start.line < len(lines) else ""
        word = word if len(word) <= 60 else word[:57] + "..."
        return start.line + 1, start.column + 1, f"broken YAML: {word!r} has no ':', expected KEY: VALUE"
    if "'\\t'" in problem:
        problem += "; indent with spaces, not with tabs"
    context = f"{error.context}: " if error.context else ""
    return *here, f"broken YAML: {context}{problem}"


def _wrong_indentation(lines: list[str], number: int) -> str | None:
    """Return how far a line should be indented, or None where its indentation is not what is wrong."""
    if number >= len(lines) or not (_KEY.match(lines[number]) or _DASHES.match(lines[number])):
        return None
    own, fitting, least = _indentation(lines[number]), dict[int, int](), 10**9
    for above in range(number - 1, -1, -1):
        line = lines[above]
        if line.strip() and not line.lstrip().startswith("#"):
            dashes = _DASHES.match(line) if _KEY.match(line) else None
            for start in (dashes.end() if dashes else least, _indentation(line)):
                if start < least:
                    fitting.setdefault(start, above + 1)
            least = min(least, _indentation(line))
    if not fitting or own in fitting:
        return None
    choices = [f"{spaces} as in line {line}" for spaces, line in sorted(fitting.items(), reverse=True)]
    return f"wrong indentation of {own} space{'s'[: own != 1]}, expected {join(choices)}"


def _indentation(line: str) -> int:
    return len(line) - len(line.lstrip(" "))
