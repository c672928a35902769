"""Floor plans from SVG files."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

from crowdsim.config.tree import shortened
from crowdsim.places.sketch import Line, PlanError, Sketch

Matrix = tuple[float, float, float, float, float, float]
"""x' = a x + c y + e, y' = b x + d y + f."""

_UNIT: Matrix = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_PATH_ITEM = re.compile(r"[\s,]*([A-Za-z]|[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)")
_FLAG = re.compile(r"[\s,]*([01])")
_TRANSFORM = re.compile(r"[\s,]*(\w+)\s*\(([^()]*)\)")
_ARGUMENTS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}
_STEPS = 12
"""Straight pieces of a curve."""
_ARC = math.radians(15.0)
"""Straight pieces of an arc turn by no more than this [rad]."""
_UNSEEN = {"defs", "symbol", "clipPath", "mask", "pattern", "marker", "metadata", "style", "title", "desc"}
_MOST_DEPTH, _MOST_DRAWN = 100, 100_000
"""How deep elements are at the most, and how many are drawn, each clone anew."""


@dataclass
class _Drawing:
    """What is drawn of a file.

    Attributes:
        path: The file.
        named: Its elements that a `use` may refer to.
        sketch: What they draw.
        drawn: How many elements have been drawn.
    """

    path: Path
    named: dict[str, ElementTree.Element]
    sketch: Sketch = field(default_factory=Sketch)
    drawn: int = 0


def read_svg(path: Path, text: str) -> Sketch:
    """Return what an SVG file draws: lines and outlines are walls, filled rectangles solid, circles discs.

    Raises:
        PlanError: It is no SVG, or draws nothing that could be a wall.
    """
    if "<!ENTITY" in text:
        raise PlanError(f"{path}: defines entities, expected a plain SVG file")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise PlanError(f"{path}: line {error.position[0]}: is no XML, expected an SVG file") from None
    if _tag(root) != "svg":
        raise PlanError(f"{path}: is <{_tag(root)}>, expected an SVG file")
    _apply_classes(root)
    drawing = _Drawing(path, {f"#{one.get('id')}": one for one in root.iter() if one.get("id")})
    _draw(drawing, root, _UNIT, None, 0)
    if not drawing.sketch.points():
        tags = sorted({_tag(one) for one in root.iter()} - {"svg", "g"})
        what = f"{path}: is no floor plan: it holds {', '.join(tags[:8]) or 'nothing'}, "
        raise PlanError(what + "expected line, polyline, polygon, rect, circle or path")
    return drawing.sketch


def _tag(element: ElementTree.Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _apply_classes(root: ElementTree.Element) -> None:
    """Add what style sheets of a file say of classes to the styles of its elements, whose own comes first."""
    rules: dict[str, dict[str, str]] = {}
    for sheet in root.iter():
        if _tag(sheet) == "style":
            for rule in "".join(sheet.itertext()).split("}"):
                selectors, _, declared = rule.partition("{")
                said = {name: value for name in ("fill", "display") if (value := _declared(declared, name)) is not None}
                for name in re.findall(r"\.([\w-]+)", selectors):
                    rules.setdefault(name, {}).update(said)
    for one in root.iter():
        said = {key: value for name in one.get("class", "").split() for key, value in rules.get(name, {}).items()}
        if said:
            one.set("style", ";".join([one.get("style", ""), *(f"{key}:{value}" for key, value in said.items())]))


def _draw(drawing: _Drawing, element: ElementTree.Element, above: Matrix, fill: str | None, depth: int) -> None:
    """Add an element and those in it to a drawing; their transforms and ``fill`` are under those above."""
    path, sketch = drawing.path, drawing.sketch
    drawing.drawn += 1
    if depth > _MOST_DEPTH:
        raise PlanError(f"{path}: elements are more than {_MOST_DEPTH} deep, expected fewer")
    if drawing.drawn > _MOST_DRAWN:
        raise PlanError(f"{path}: draws more than {_MOST_DRAWN:,} elements, clones included, expected fewer")
    tag = _tag(element)
    if tag in _UNSEEN or _style(element, "display") == "none":
        return
    own = _style(element, "fill")
    fill = fill if own in (None, "inherit") else own
    where = f"{path}: <{tag}>"
    matrix = _times(above, _transform(path, element.get("transform", "none")))

    def number(name: str) -> float:
        text = element.get(name, "0").strip().removesuffix("px")
        if not _NUMBER.fullmatch(text):
            what = (
                f"{path}: {name} of a {tag} is {shortened(repr(element.get(name)))}, expected a number without a unit"
            )
            raise PlanError(what + ": lengths are in units of the file, of which 'scale' says how many metres each is")
        return float(text)

    def placed(points: Line) -> Line:
        a, b, c, d, e, f = matrix
        return [(a * x + c * y + e, b * x + d * y + f) for x, y in points]

    if tag == "line":
        sketch.walls.append((placed([(number("x1"), number("y1")), (number("x2"), number("y2"))]), False, {}, where))
    elif tag in ("polyline", "polygon"):
        values = [float(one) for one in _NUMBER.findall(element.get("points", ""))]
        points = list(zip(values[::2], values[1::2], strict=False))
        if len(points) > 1:
            sketch.walls.append((placed(points), tag == "polygon" and len(points) > 2, {}, where))
    elif tag == "rect":
        x, y, wide, high = (number(name) for name in ("x", "y", "width", "height"))
        corners = placed([(x, y), (x + wide, y), (x + wide, y + high), (x, y + high)])
        if wide > 0.0 and high > 0.0:
            if fill == "none":
                sketch.walls.append((corners, True, {}, where))
            else:
                sketch.solids.append(([corners], {}, where))
    elif tag in ("circle", "ellipse"):
        wide, high = (number("r"), number("r")) if tag == "circle" else (number("rx"), number("ry"))
        ((x, y),) = placed([(number("cx"), number("cy"))])
        radius = math.sqrt(abs(wide * high * (matrix[0] * matrix[3] - matrix[1] * matrix[2])))
        if radius > 0.0:
            sketch.discs.append(((x, y), radius, {}, where))
    elif tag == "path":
        for points, closed in _lines_of(path, element.get("d", "")):
            if len(points) > 1:
                sketch.walls.append((placed(points), closed and len(points) > 2, {}, where))
    elif tag == "use":
        name = element.get("href") or next((value for key, value in element.items() if key.endswith("}href")), "")
        if name not in drawing.named:
            raise PlanError(f"{where} refers to {shortened(repr(name))}, expected the id of an element of the file")
        shift = _times(matrix, (1.0, 0.0, 0.0, 1.0, number("x"), number("y")))
        _draw(drawing, drawing.named[name], shift, fill, depth + 1)
    for child in element:
        _draw(drawing, child, matrix, fill, depth + 1)


def _style(element: ElementTree.Element, name: str) -> str | None:
    """Return a property of an element, be it an attribute or in its style."""
    declared = _declared(element.get("style", ""), name)
    return element.get(name) if declared is None else declared


def _declared(style: str, name: str) -> str | None:
    """Return what a style says of a property."""
    found = re.search(rf"(?:^|;)\s*{name}\s*:\s*([^;]+)", style)
    return found[1].strip() if found else None


def _times(one: Matrix, other: Matrix) -> Matrix:
    a, b, c, d, e, f = one
    p, q, r, s, t, u = other
    return (
        a * p + c * q, b * p + d * q, a * r + c * s, b * r + d * s, a * t + c * u + e, b * t + d * u + f,
    )  # fmt: skip


def _transform(path: Path, text: str) -> Matrix:
    found, at, text = _UNIT, 0, text.strip(" \t\r\n,").removeprefix("none")
    while at < len(text):
        one = _TRANSFORM.match(text, at)
        if one is None:
            what = f"{path}: transform {shortened(text[at:].lstrip())}"
            raise PlanError(f"{what}, expected one of SVG's, such as scale(2)")
        name, given, at = one[1], one[2], one.end()
        values = [float(value) for value in _NUMBER.findall(given)]
        if not all(map(math.isfinite, values)):
            raise PlanError(f"{path}: transform {shortened(one[0])}, expected numbers that are finite")
        if name == "matrix" and len(values) == 6:
            step: Matrix = tuple(values)  # type: ignore[assignment]
        elif name == "translate" and len(values) in (1, 2):
            step = (1.0, 0.0, 0.0, 1.0, values[0], values[1] if len(values) == 2 else 0.0)
        elif name == "scale" and len(values) in (1, 2):
            step = (values[0], 0.0, 0.0, values[-1], 0.0, 0.0)
        elif name == "rotate" and len(values) in (1, 3):
            cos, sin = math.cos(math.radians(values[0])), math.sin(math.radians(values[0]))
            x, y = values[1:] if len(values) == 3 else (0.0, 0.0)
            step = (cos, sin, -sin, cos, x - cos * x + sin * y, y - sin * x - cos * y)
        elif name in ("skewX", "skewY") and len(values) == 1:
            skew = math.tan(math.radians(values[0]))
            step = (1.0, 0.0, skew, 1.0, 0.0, 0.0) if name == "skewX" else (1.0, skew, 0.0, 1.0, 0.0, 0.0)
        else:
            raise PlanError(f"{path}: transform {shortened(one[0])}, expected one of SVG's")
        found = _times(found, step)
    return found


def _lines_of(path: Path, text: str) -> Iterator[tuple[Line, bool]]:
    """Yield the lines of a path's data, curves in straight pieces, and whether each is closed."""
    tokens = _path_items(text)
    at, command, here, begun = 0, "", (0.0, 0.0), (0.0, 0.0)
    points: Line = []
    handle: tuple[float, float] | None = None
    while at < len(tokens):
        if tokens[at].isalpha():
            command, at = tokens[at], at + 1
            if command.upper() not in _ARGUMENTS:
                raise PlanError(f"{path}: a path has the command {command!r}, expected one of {', '.join(_ARGUMENTS)}")
        elif not command or command in "zZ":
            raise PlanError(f"{path}: a path has a number without a command, expected a letter before it")
        kind, count = command.upper(), _ARGUMENTS[command.upper()]
        given = tokens[at : at + count]
        if len(given) < count or any(one.isalpha() for one in given):
            raise PlanError(f"{path}: a path's command {command!r} has too few numbers, expected {count}")
        values, at = [float(one) for one in given], at + count
        x, y = here if command.islower() else (0.0, 0.0)
        if kind == "Z":
            yield points, True
            points, here, handle = [], begun, None
            continue
        if kind == "M":
            if points:
                yield points, False
            here = begun = (x + values[0], y + values[1])
            points, handle = [here], None
            # What follows without a command of its own are lines.
            command = "l" if command == "m" else "L"
            continue
        points = points or [here]
        if kind in "HV":
            here = (x + values[0], here[1]) if kind == "H" else (here[0], y + values[0])
            handle = None
            points.append(here)
            continue
        pairs = [(x + values[k], y + values[k + 1]) for k in range(0, count - (kind == "A"), 2)]
        if kind in "CSQT":
            mirrored = here if handle is None else (2 * here[0] - handle[0], 2 * here[1] - handle[1])
            controls = [here, *([mirrored] if kind in "ST" else []), *pairs]
            points += [_on_curve(controls, step / _STEPS) for step in range(1, _STEPS + 1)]
            handle, here = controls[-2], controls[-1]
        else:
            end = (x + values[-2], y + values[-1])
            if kind == "A":
                points += _on_arc(here, end, values[0], values[1], math.radians(values[2]), *map(bool, values[3:5]))
            here, handle = end, None
            points.append(here)
    if points:
        yield points, False


def _path_items(text: str) -> list[str]:
    """Return the commands and numbers of a path's data; the two flags of an arc need nothing between them."""
    found: list[str] = []
    at, command, count = 0, "", 0
    while True:
        is_flag = command in ("A", "a") and count % 7 in (3, 4)
        item = (is_flag and _FLAG.match(text, at)) or _PATH_ITEM.match(text, at)
        if not item:
            return found
        found.append(item[1])
        at, count = item.end(), count + 1
        if item[1].isalpha():
            command, count = item[1], 0


def _on_arc(
    here: tuple[float, float], end: tuple[float, float], rx: float, ry: float, turn: float, large: bool, sweep: bool
) -> Line:
    """Return points of an elliptic arc between its ends, whose axes are turned by some angle [rad].

    Source: SVG 1.1, appendix F.6.5 and F.6.6, where the ellipse is scaled to a circle of radius 1.
    """
    rx, ry, cos, sin = abs(rx), abs(ry), math.cos(turn), math.sin(turn)
    if rx == 0.0 or ry == 0.0 or here == end:
        return []
    half_x, half_y = (here[0] - end[0]) / 2, (here[1] - end[1]) / 2
    ux, uy = (cos * half_x + sin * half_y) / rx, (cos * half_y - sin * half_x) / ry
    length = math.hypot(ux, uy)
    if length > 1.0:  # radii that are too small grow
        rx, ry, ux, uy, length = rx * length, ry * length, ux / length, uy / length, 1.0
    off = math.sqrt(1.0 - length * length) / length * (1.0 if large != sweep else -1.0)
    cx, cy = off * uy, -off * ux
    first = math.atan2(uy - cy, ux - cx)
    angle = (math.atan2(-uy - cy, -ux - cx) - first) % (2.0 * math.pi)
    angle -= 0.0 if sweep else 2.0 * math.pi
    pieces = math.ceil(abs(angle) / _ARC)
    middle_x, middle_y = (here[0] + end[0]) / 2, (here[1] + end[1]) / 2
    points = []
    for piece in range(1, pieces):
        x = rx * (cx + math.cos(first + piece / pieces * angle))
        y = ry * (cy + math.sin(first + piece / pieces * angle))
        points.append((middle_x + cos * x - sin * y, middle_y + sin * x + cos * y))
    return points


def _on_curve(controls: Line, share: float) -> tuple[float, float]:
    """Return a point of a Bezier curve (de Casteljau)."""
    while len(controls) > 1:
        controls = [(a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])) for a, b in pairwise(controls)]
    return controls[0]
