"""Floor plans from GeoJSON and SVG become walls, boxes and discs; what is none is refused with its position."""

import json
import math
from pathlib import Path

import pytest

from crowdsim.places.description import BoxObstacle, DiscObstacle, PlanObstacle, SolidObstacle, WallObstacle
from crowdsim.places.plans import read_plan
from crowdsim.places.sketch import PlanError


def feature(geometry, coordinates, **properties):
    geometry = {"type": geometry, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def read(tmp_path: Path, content, name="plan.geojson", **keys):
    text = content if isinstance(content, str) else json.dumps(content)
    (tmp_path / name).write_text(text, encoding="utf-8")
    return read_plan(tmp_path / name, PlanObstacle(file=name, **keys))


def collection(*features):
    return {"type": "FeatureCollection", "features": list(features)}


def refused(tmp_path, content, name="plan.geojson", **keys):
    with pytest.raises(PlanError) as failure:
        read(tmp_path, content, name, **keys)
    return str(failure.value).removeprefix(f"{tmp_path / name}: ")


SQUARE = [[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]]


def test_lines_polygons_and_points_become_walls_boxes_and_discs(tmp_path):
    wall, room, box, disc = read(
        tmp_path,
        collection(
            feature("LineString", [[0, 0], [6, 0]], thickness=0.3, doors=[{"at": 2, "width": 1.2}]),
            feature("Polygon", [SQUARE], kind="room", height=3),
            feature("Polygon", [SQUARE]),
            feature("Point", [9, 1], radius=0.4, name="pillar"),
            feature("Point", [9, 9], name="a label, which stands nowhere"),
        ),
        height=2.0,
    )
    assert isinstance(wall, WallObstacle)
    assert (wall.thickness, wall.height, wall.doors[0].width) == (0.3, 2.0, 1.2)
    assert isinstance(room, WallObstacle)
    assert (room.closed, room.height, len(room.points)) == (True, 3, 4)
    assert isinstance(box, BoxObstacle)
    assert (box.centre, box.size) == ((2.0, 1.5), (4.0, 3.0))
    assert isinstance(disc, DiscObstacle)
    assert disc.centre == (9, 1)


def test_scale_and_centre_place_a_plan(tmp_path):
    (box,) = read(tmp_path, feature("Polygon", [SQUARE]), scale=0.5, centre=(10.0, -2.0))
    assert box.centre == (10.0, -2.0)
    assert box.size == (2.0, 1.5)


def test_a_rotated_rectangle_is_a_box_and_any_other_outline_a_wall_around(tmp_path):
    turned = [[0, 0], [3, 4], [-1, 7], [-4, 3], [0, 0]]
    box, wall = read(tmp_path, collection(feature("Polygon", [turned]), feature("Polygon", [[[0, 0], [4, 0], [0, 4]]])))
    assert box.size == pytest.approx((5.0, 5.0))
    assert isinstance(wall, WallObstacle)
    assert wall.closed


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "line 1: is no JSON, expected a GeoJSON file"),
        ([1], "is no GeoJSON, expected an object with a type, such as FeatureCollection"),
        (collection(), "is no floor plan: it draws nothing, expected lines, outlines or circles"),
        (collection(feature("LineString", [[0, "a"], [1, 1]])), "features[0]: a position: is 'a', expected a number"),
        (feature("LineString", [[0, 0, 1], [4, 0, 2]]), "Feature: positions are 1 to 2 m high: uneven ground is not "
         "supported, every avatar moves on the plane y = 0, expected one height in the whole file"),
        (feature("LineString", [[8.5401, 47.3771], [8.5402, 47.3772]]), "is 0.0001 m large, expected 0.5 m or more; "
         "'scale' says how many metres a unit of the file is, degrees are projected to metres by the program that "
         "exports it"),
        (feature("LineString", [[682000, 246000], [682020, 246000]]), "a point is at 682000, 246000, expected x and z "
         "up to 4000 m; 'centre' moves the plan, 'scale' makes it smaller"),
        (collection(feature("LineString", [[0, 0, 0], [4, 0, 0]]), feature("LineString", [[0, 1, 3], [4, 1, 3]])),
         "features[1]: positions are 0 to 3 m high: uneven ground is not supported, every avatar moves on the plane "
         "y = 0, expected one height in the whole file"),
        (feature("LineString", [[0, 0], [4, 0]], doors=[{"at": 2, "widht": 1}]), "Feature.properties.doors[0]: widht: "
         "unknown key, expected at, width, opens or closes (did you mean 'width'?)"),
        (feature("LineString", [[0, 0], [4, 0]], doors=[7]), "Feature.properties.doors[0]: is 7, expected a door, such "
         "as {'at': 2, 'width': 1}"),
        (feature("LineString", [[0, 0], [4, 0]], thickness=-1), "Feature: the wall from 0, 0: thickness: is -1.0, "
         "expected a number greater than 0"),
        (collection(feature("Polygon", [SQUARE]), feature("Point", [0, 9], radius=-1)), "features[1]: the disc at 0, "
         "9: radius: is -1.0, expected a number greater than 0"),
        (feature("Polygon", [SQUARE], height=200), "Feature: the box at 0, 0: height: is 200.0, expected a number "
         "less than or equal to 100"),
        (feature("Polygon", [SQUARE[:3]], height=200), "Feature: the outline from 0, 0: height: is 200.0, expected a "
         "number less than or equal to 100"),
        (feature("Polygon", [[[0, 0]]]), "Feature: an outline has 1 corners, expected 3 or more that differ"),
        (feature("LineString", [[0, 0], [10**400, 0]]), f"Feature: a position: is 1{56 * '0'}..., expected a number"),
        (feature("LineString", [[0, 0], [4, 0]], doors=[{"at": 10**400}]), "Feature.properties.doors[0]: at: "
         f"is '1{55 * '0'}..., expected a number from 0 to 100000"),
        ({"type": "GeometryCollection", "geometries": 3}, "GeometryCollection: coordinates are no list, expected one"),
        (feature("Curve", []), "Feature: geometry of type 'Curve', expected LineString, Polygon or Point"),
    ],
)  # fmt: skip
def test_what_is_no_floor_plan_is_refused(tmp_path, content, message):
    assert refused(tmp_path, content) == message


def test_a_door_in_a_file_that_leads_nowhere_is_refused(tmp_path):
    assert refused(tmp_path, feature("LineString", [[0, 0], [3, 0]], doors=[{"at": 2.9}])) == (
        "Feature: the wall from 0, 0: doors[0].at: is 2.9, so that the door leads nowhere: it reaches from 2.4 "
        "to 3.4 m of a wall of 3 m, expected 0.5 to 2.5"
    )


def svg(inner, name="plan.svg"):
    return f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 100">{inner}</svg>'


def test_shapes_of_svg_become_obstacles_with_their_transforms(tmp_path):
    inner = (
        '<g transform="translate(10, 0) scale(2)"><line x1="0" y1="0" x2="4" y2="1"/>'
        '<rect x="1" y="1" width="2" height="1"/><rect x="0" y="0" width="9" height="9" fill="none"/>'
        '<circle cx="1" cy="2" r="0.5"/></g><path d="m 0 0 h 5 v 5 z l 1 1 M 20,20 C 20,25 25,25 25,20"/>'
        '<polygon points="0,0 3,0 0,3"/><defs><line x1="0" y1="0" x2="1" y2="1"/></defs>'
    )
    found = read(tmp_path, svg(inner), "plan.svg")
    walls = [one for one in found if isinstance(one, WallObstacle)]
    assert [wall.points for wall in walls[:2]] == [
        ((10, 0), (18, 2)),
        ((10, 0), (28, 0), (28, 18), (10, 18)),
    ]
    assert (walls[2].closed, walls[2].points) == (True, ((0, 0), (5, 0), (5, 5)))
    assert walls[3].points == ((0, 0), (1, 1))
    assert len(walls[4].points) == 13
    assert max(z for _, z in walls[4].points) == pytest.approx(23.75)
    assert [wall.closed for wall in walls[5:]] == [True]
    (box,) = (one for one in found if isinstance(one, BoxObstacle))
    assert (box.centre, box.size) == ((14, 3), (4, 2))
    (disc,) = (one for one in found if isinstance(one, DiscObstacle))
    assert (disc.centre, disc.radius) == ((12, 4), 1.0)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (svg("<text>Hall</text><image/>"), "is no floor plan: it holds image, text, expected line, polyline, polygon, "
         "rect, circle or path"),
        ("<html/>", "is <html>, expected an SVG file"),
        ("<svg", "line 1: is no XML, expected an SVG file"),
        ('<!DOCTYPE svg [<!ENTITY a "b">]><svg/>', "defines entities, expected a plain SVG file, as programs save it "
         "without their own data"),
        (svg('<path d="M 0 0 X 3"/>'), "a path has the command 'X', expected one of M, L, H, V, C, S, Q, T, A, Z"),
        (svg('<path d="M 0 0 L 3"/>'), "a path's command 'L' has too few numbers, expected 2"),
        (svg('<rect x="1" width="20em" height="4"/>'), "width of a rect is '20em', expected a number, alone or with "
         "one of px, pt, pc, in, cm, mm, Q or %; 'scale' says how many metres it is"),
        (svg('<rect width="1" height="4%"/>').replace('viewBox="0 0 100 100"', 'width="100%"'), "height of a rect is "
         "'4%', expected a number: a percentage needs a viewBox, or a size, of the svg that it is in"),
        (svg('<g transform="spin(3)"><line x2="9"/></g>'), "transform spin(3), expected one of SVG's"),
        (svg('<g transform="scale(2) turn"><line x2="9"/></g>'), "transform turn, expected one of SVG's, such as "
         "scale(2)"),
        (svg('<g transform="rotate(1e999)"><line x2="9"/></g>'), "transform rotate(1e999), expected numbers that are "
         "finite"),
        (svg(f'<g transform="{400_000 * "a"}"><line x2="9"/></g>'), f"transform {57 * 'a'}..., expected one of SVG's, "
         "such as scale(2)"),
    ],
)  # fmt: skip
def test_svg_that_is_no_floor_plan_is_refused(tmp_path, content, message):
    assert refused(tmp_path, content, "plan.svg") == message


def test_arcs_of_paths_are_round_whatever_stands_between_their_flags(tmp_path):
    for data in ("M 10 0 A 10 10 0 1 1 0 -10", "M10 0a10 10 0 11-10-10", "M10,0 a10,10,0,1,1,-10,-10"):
        (wall,) = read(tmp_path, svg(f'<path d="{data}"/>'), "plan.svg")
        assert wall.points[0] == (10, 0)
        assert wall.points[-1] == pytest.approx((0, -10))
        # Three quarters of a circle around the origin, over the side of +y.
        assert [math.hypot(*point) for point in wall.points] == pytest.approx([10.0] * len(wall.points))
        assert len(wall.points) == 19
        assert max(z for _, z in wall.points) == pytest.approx(10.0)
    (ellipse,) = read(tmp_path, svg('<path d="M 0 0 A 2 1 90 0 0 2 0"/>'), "plan.svg")
    assert max(z for _, z in ellipse.points) == pytest.approx(2.0, abs=0.02)


def test_clones_are_drawn_where_they_are_used(tmp_path):
    inner = (
        '<defs><rect id="pillar" x="0" y="0" width="1" height="1"/></defs>'
        '<use href="#pillar" x="4" y="2"/>'
        '<g id="hall"><use xlink:href="#pillar" transform="translate(7) scale(2)"/></g>'
    )
    found = read(tmp_path, svg(inner).replace("<svg", '<svg xmlns:xlink="http://www.w3.org/1999/xlink"'), "plan.svg")
    assert [(box.centre, box.size) for box in found] == [((4.5, 2.5), (1, 1)), ((8, 1), (2, 2))]
    message = "<use> refers to '#door', expected the id of an element of the file"
    assert refused(tmp_path, svg('<use href="#door"/>'), "plan.svg") == message
    message = "elements are more than 100 deep, expected fewer"
    assert refused(tmp_path, svg('<g id="a"><use href="#a"/></g>'), "plan.svg") == message


def boxes(tmp_path, inner, root='viewBox="-50 -50 100 80"'):
    drawing = f'<svg xmlns="http://www.w3.org/2000/svg" {root}>{inner}</svg>'
    return [(box.centre, box.size) for box in read(tmp_path, drawing, "plan.svg")]


BLOCK = '<rect x="2" y="4" width="4" height="2"/>'


@pytest.mark.parametrize(
    ("nested", "centre", "size"),
    [
        ("", (4, 5), (4, 2)),
        ('x="10" y="-20"', (14, -15), (4, 2)),
        ('x="10" y="-20" width="40" height="40" viewBox="0 0 20 20"', (18, -10), (8, 4)),
        ('x="10" y="-20" width="40" height="40" viewBox="2 4 20 20"', (14, -18), (8, 4)),
        # What is wider than its view is in the middle of it, unless it says otherwise.
        ('x="10" width="60" height="40" viewBox="0 0 20 20"', (28, 10), (8, 4)),
        ('x="10" width="60" height="40" viewBox="0 0 20 20" preserveAspectRatio="xMinYMax"', (18, 10), (8, 4)),
        ('x="10" width="60" height="40" viewBox="0 0 20 20" preserveAspectRatio="xMaxYMax slice"', (22, -5), (12, 6)),
        ('x="10" width="60" height="40" viewBox="0 0 20 20" preserveAspectRatio="none"', (22, 10), (12, 4)),
        # As large as the view that it is in, or a share of that.
        ('viewBox="0 0 200 160"', (2, 2.5), (2, 1)),
        ('width="50%" height="50%" viewBox="0 0 200 160"', (1, 1.25), (1, 0.5)),
        ('x="1" transform="scale(2)"', (10, 10), (8, 4)),
    ],
)
def test_an_svg_in_an_svg_is_where_its_view_puts_it(tmp_path, nested, centre, size):
    ((found, large),) = boxes(tmp_path, f"<svg {nested}>{BLOCK}</svg>")
    assert found == pytest.approx(centre)
    assert large == pytest.approx(size)


def test_views_in_views_and_symbols_are_as_large_as_what_refers_to_them(tmp_path):
    inner = f'<svg x="10" width="40" height="20" viewBox="0 0 20 10"><svg width="50%" viewBox="0 0 20 20">{BLOCK}'
    assert boxes(tmp_path, f"{inner}</svg></svg>") == [((14, 5), (4, 2))]
    inner = f'<symbol id="desk" viewBox="0 0 20 20">{BLOCK}</symbol><use href="#desk" x="10" width="40" height="40"/>'
    assert boxes(tmp_path, f'{inner}<use href="#desk" width="20" height="20"/>') == [
        ((18, 10), (8, 4)),
        ((4, 5), (4, 2)),
    ]
    # A view of no size shows nothing.
    assert boxes(tmp_path, f'<svg width="0" viewBox="0 0 9 9">{BLOCK}</svg>{BLOCK}') == [((4, 5), (4, 2))]
    inner = f'<svg viewBox="0 0 10 10">{BLOCK}</svg>'
    assert boxes(tmp_path, inner, 'width="20px" height="20"') == [((8, 10), (8, 4))]
    # A file may leave open how large it is, as those that browsers show do.
    for root in ('width="100%" height="100%"', 'width="auto"', 'width="100%" viewBox="wide"'):
        assert boxes(tmp_path, f'<svg x="1" width="50%">{BLOCK}</svg>', root) == [((5, 5), (4, 2))]


def test_units_and_percentages_of_svg_are_those_of_browsers(tmp_path):
    ((centre, size),) = boxes(tmp_path, '<rect x="-5%" width="1in" height="25.4mm"/>', 'viewBox="0 0 100 80"')
    assert size == pytest.approx((96, 96))
    assert centre == pytest.approx((43, 48))
    ((_, size),) = boxes(tmp_path, '<rect width="50%" height="36pt"/>', 'width="2in" height="40"')
    assert size == pytest.approx((96, 48))
    (disc,) = read(tmp_path, svg('<circle cx="25%" cy="5" r="10%"/>').replace("100 100", "400 300"), "plan.svg")
    assert disc.centre == pytest.approx((100, 5))
    assert disc.radius == pytest.approx(0.1 * math.hypot(400, 300) / math.sqrt(2))


@pytest.mark.parametrize(
    ("root", "nested", "message"),
    [
        ("", 'viewBox="0 0 9 9"', "<svg> has a viewBox and is in an svg without one, expected its width and height "
         "as numbers"),
        ("", 'viewBox="0 0 9"', "viewBox of <svg> is '0 0 9', expected left, top, width and height"),
        ("", 'width="9em"', "width of a svg is '9em', expected a number, alone or with one of px, pt, pc, in, cm, mm, "
         "Q or %; 'scale' says how many metres it is"),
        ('viewBox="0 0 9 9"', 'viewBox="0 0 9 9" preserveAspectRatio="left"', "preserveAspectRatio of <svg> is "
         "'left', expected xMidYMid, say"),
    ],
)  # fmt: skip
def test_an_svg_in_an_svg_without_a_place_is_refused(tmp_path, root, nested, message):
    assert refused(tmp_path, f"<svg {root}><svg {nested}>{BLOCK}</svg></svg>", "plan.svg") == message


def test_a_fill_of_none_holds_for_what_is_in_a_group(tmp_path):
    rect = '<rect width="3" height="2"'
    inner = f'<g>{rect} style="fill: inherit"/>{rect} fill="red"/></g>'
    inner = f'<g fill="none" transform="none">{rect}/>{inner}</g>{rect}/>'
    kinds = [one.kind for one in read(tmp_path, svg(inner), "plan.svg")]
    assert kinds == ["wall", "wall", "box", "box"]


def test_a_fill_of_none_may_be_that_of_a_class(tmp_path):
    inner = "<style>.st0, .st1{fill:none;stroke:#000;} .st1{display:none}</style>"
    inner += '<rect class="st0" width="3" height="2"/><rect class="st1" width="9" height="9"/>'
    inner += '<rect class="st0" style="fill:#888" width="3" height="2"/>'
    assert [type(one) for one in read(tmp_path, svg(inner), "plan.svg")] == [WallObstacle, BoxObstacle]


def test_holes_of_an_outline_are_walls_around_open_ground(tmp_path):
    outer = [[-5, -5], [9, -5], [9, 9], [-5, 9], [-5, -5]]
    outline, hole = read(tmp_path, feature("Polygon", [outer, SQUARE]))
    assert isinstance(outline, SolidObstacle)
    assert outline.holes == (hole.points,)
    assert (hole.closed, hole.thickness) == (True, 0.1)


def test_file_names_have_slashes():
    with pytest.raises(ValueError, match="expected / between folders"):
        PlanObstacle(file="sub\\p.geojson")


def test_clones_of_clones_are_counted_before_they_are_drawn(tmp_path):
    groups = "".join(f'<g id="g{k}"><use href="#g{k + 1}"/><use href="#g{k + 1}"/></g>' for k in range(40))
    drawing = svg(f'<defs>{groups}<g id="g40"/></defs><use href="#g0"/>')
    assert "draws more than 100,000 elements, clones included, expected fewer" in refused(tmp_path, drawing, "plan.svg")
