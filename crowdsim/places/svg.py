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
Size = tuple[float, float]

_UNIT: Matrix = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_PATH_ITEM = re.compile(r"[\s,]*([A-Za-z]|[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)")
_FLAG = re.compile(r"[\s,]*([01])")
_TRANSFORM = re.compile(r"[\s,]*(\w+)\s*\(([^()]*)\)")
_ALIGNED = re.compile(r"(?:defer\s+)?(?:none|x(Min|Mid|Max)Y(Min|Mid|Max))(?:\s+(meet|slice))?")
_SHARES = {"Min": 0.0, "Mid": 0.5, "Max": 1.0}
_UNITS = {"px": 1.0, "pt": 96 / 72, "pc": 16.0, "in": 96.0, "cm": 96 / 2.54, "mm": 96 / 25.4, "Q": 96 / 101.6}
"""Units of lengths in those of the file (SVG 2, 8.9)."""
_SIZE = re.compile(rf"{_NUMBER.pattern}(?:{'|'.join(_UNITS)})?")
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
        raise PlanError(
            f"{path}: defines entities, expected a plain SVG file, as programs save it without their own data"
        )
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise PlanError(f"{path}: line {error.position[0]}: is no XML, expected an SVG file") from None
    if _tag(root) != "svg":
        raise PlanError(f"{path}: is <{_tag(root)}>, expected an SVG file")
    _apply_classes(root)
    drawing = _Drawing(path, {f"#{one.get('id')}": one for one in root.iter() if one.get("id")})
    _draw(drawing, root, _UNIT, None)
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


def _draw(
    drawing: _Drawing,
    element: ElementTree.Element,
    above: Matrix,
    fill: str | None,
    depth: int = 0,
    view: Size | None = None,
    use: ElementTree.Element | None = None,
) -> None:
    """Add an element and those in it to a drawing.

    Args:
        drawing: Added to.
        element: The element.
        above: Transform of what it is in.
        fill: Likewise.
        depth: How many elements it is in.
        view: How large the view is that it is in; None where the file does not say that.
        use: The element that refers to it; None where it is drawn where it stands.
    """
    path, sketch = drawing.path, drawing.sketch
    drawing.drawn += 1
    if depth > _MOST_DEPTH:
        raise PlanError(f"{path}: elements are more than {_MOST_DEPTH} deep, expected fewer")
    if drawing.drawn > _MOST_DRAWN:
        raise PlanError(f"{path}: draws more than {_MOST_DRAWN:,} elements, clones included, expected fewer")
    tag = _tag(element)
    if (tag in _UNSEEN and not (tag == "symbol" and use is not None)) or _style(element, "display") == "none":
        return
    own = _style(element, "fill")
    fill = fill if own in (None, "inherit") else own
    where = f"{path}: <{tag}>"
    matrix = _times(above, _transform(path, element.get("transform", "none")))

    def number(name: str) -> float:
        return _length(path, element, name, view) or 0.0

    if tag in ("svg", "symbol"):
        inside = _view_of(path, element, view, use, depth == 0)
        if inside is None:
            return
        matrix, view = _times(matrix, inside[0]), inside[1]

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
        _draw(drawing, drawing.named[name], shift, fill, depth + 1, view, element)
    for child in element:
        _draw(drawing, child, matrix, fill, depth + 1, view)


def _length(path: Path, element: ElementTree.Element, name: str, view: Size | None = None) -> float | None:
    """Return a length of an element in a view; None where it is not given.

    Source: SVG 2, 8.9 (units), of which those of fonts are refused.
    """
    given = element.get(name)
    if given is None:
        return None
    text = given.strip()
    number = _NUMBER.match(text)
    unit = text[number.end() :] if number else ""
    what = f"{path}: {name} of a {_tag(element)} is {shortened(repr(given))}, expected a number"
    if number and unit == "%":
        if view is None:
            raise PlanError(f"{what}: a percentage needs a viewBox, or a size, of the svg that it is in")
        across, along = view
        whole = across if "x" in name or name == "width" else along
        return 0.01 * float(number[0]) * (math.hypot(across, along) / math.sqrt(2.0) if name == "r" else whole)
    if number is None or (unit and unit not in _UNITS):
        raise PlanError(f"{what}, alone or with one of {', '.join(_UNITS)} or %; 'scale' says how many metres it is")
    return float(number[0]) * _UNITS.get(unit, 1.0)


def _view_of(
    path: Path, element: ElementTree.Element, view: Size | None, use: ElementTree.Element | None, outermost: bool
) -> tuple[Matrix, Size | None] | None:
    """Return what takes the inside of an `svg` or a `symbol` to where it stands, and how large that is inside.

    Coordinates of the outermost one are those of the plan, wherever its `viewBox` is. None where nothing is seen of it.

    Source: SVG 2, 8.2 (equivalent transform of a viewport).
    """
    tag, box = _tag(element), element.get("viewBox")
    edges = [float(value) for value in _NUMBER.findall(box or "")]
    is_box = len(edges) == 4 and all(map(math.isfinite, edges)) and min(edges[2:]) >= 0.0
    if is_box and outermost:
        return _UNIT, (edges[2], edges[3])
    if box is not None and not is_box and not outermost:
        raise PlanError(f"{path}: viewBox of <{tag}> is {shortened(repr(box))}, expected left, top, width and height")
    # What refers to it may say how large it is; by itself it is as large as the view that it is in.
    sizes: list[float | None] = []
    for axis, name in enumerate(("width", "height")):
        teller = element if use is None or use.get(name) is None else use
        text = teller.get(name, "100%").strip()
        # The outermost one has a size where it says that; browsers pass over what is none.
        is_known = _SIZE.fullmatch(text) if outermost else view is not None or not text.endswith("%")
        given = _length(path, teller, name, view) if is_known else None
        sizes.append(view[axis] if given is None and view is not None else given)
    wide, high = sizes
    if outermost:
        return _UNIT, None if wide is None or high is None else (wide, high)
    left, top = _length(path, element, "x", view) or 0.0, _length(path, element, "y", view) or 0.0
    shift: Matrix = (1.0, 0.0, 0.0, 1.0, left, top)
    if box is None:
        return shift, None if wide is None or high is None else (wide, high)
    if wide is None or high is None:
        what = "has a viewBox and is in an svg without one, expected its width and height as numbers"
        raise PlanError(f"{path}: <{tag}> {what}")
    if min(wide, high, *edges[2:]) <= 0.0:
        return None
    text = element.get("preserveAspectRatio", "xMidYMid").strip()
    aligned = _ALIGNED.fullmatch(text)
    if aligned is None:
        raise PlanError(f"{path}: preserveAspectRatio of <{tag}> is {shortened(repr(text))}, expected xMidYMid, say")
    x, y = wide / edges[2], high / edges[3]
    if aligned[1]:
        x = y = max(x, y) if aligned[3] == "slice" else min(x, y)
    left = _SHARES[aligned[1] or "Min"] * (wide - x * edges[2]) - x * edges[0]
    top = _SHARES[aligned[2] or "Min"] * (high - y * edges[3]) - y * edges[1]
    return _times(shift, (x, 0.0, 0.0, y, left, top)), (edges[2], edges[3])


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
