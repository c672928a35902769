"""What the kernels of drawing work on: records, and named tuples of arrays."""

from typing import NamedTuple

import numpy as np

from crowdsim.core.types import Array


def _fields(kind: str, names: str) -> np.dtype:
    return np.dtype([(name, kind) for name in names.split()])


def as_records(rows: Array, kind: np.dtype) -> Array:
    """Return rows of numbers as records, in the same memory where they lie there one after another. Shape (n,)."""
    return np.ascontiguousarray(rows, kind[0]).view(kind)[:, 0]


CAMERA = _fields(
    "<f8",
    "eye_x eye_y eye_z right_x right_y right_z up_x up_y up_z ahead_x ahead_y ahead_z focal middle_x middle_y haze",
)
"""A camera: its eye [m], directions, focal length [px], the middle of the picture [px], and the distance where haze
hides half [m]."""

LIGHT = _fields(
    "<f8",
    "sun_x sun_y sun_z u_x u_y u_z v_x v_y v_z softness widest sun_red sun_green sun_blue sky_red sky_green sky_blue "
    "bounce_red bounce_green bounce_blue albedo squares lines fine horizon_red horizon_green horizon_blue zenith_red "
    "zenith_green zenith_blue flat shadow",
)
"""A light: direction to the sun, two directions across it (light space), tangent of the sun's apparent radius, widest
blur [m]; light of sun, sky and floor; how bright the floor is, and how strong its squares, lines and fine lines are;
colours of the sky; whether floor and sky are of the horizon's colour alone, and the share of it that shadows take from
the floor."""

ARENA = _fields("<f8", "kind x z half_x half_z line")
"""An arena: kind (0 none, 1 circle, 2 rectangle), centre, half sizes and half the width of its line [m]."""

CAPSULE = _fields("<f4", "start_x start_y start_z end_x end_y end_z start_radius end_radius")
"""A capsule in the world: both ends and both radii [m]."""

CONE = _fields("<f4", "centre_x centre_y centre_z half_x half_y half_z radius taper")
"""A cone relative to the eye: centre, half axis, radius at the centre, half the difference of the radii [m]."""

SHADE = _fields("<f4", "u v w along_u along_v along_w radius taper per_square")
"""A cone in light space: first end, the vector to the second, first radius, difference to the second [m], one over the
squared length of that vector in u and v [1/m^2]."""

SEGMENT = _fields("<f4", "ax ay bx by a_radius b_radius")
"""A segment of a grid: both ends and both radii [cells]; a negative first radius leaves it out."""

SPAN = _fields("<i4", "first last")
"""Rows of pixels that a cone may touch."""

PAINT = _fields("<f4", "red green blue gloss")
"""Linear colour and gloss, each 0..1."""

FLASH = _fields("<f4", "x y depth size age power outcome")
"""A flash: position in the picture [px], distance from the eye [m], size [px], age 0..1, brightness, outcome of the
strike (``crowd.kernels.layout``)."""


class Plane(NamedTuple):
    """A plane in cells: its corner [m], cells in a metre, columns and rows."""

    left: float
    top: float
    per_metre: float
    columns: float
    rows: float


class Cones(NamedTuple):
    """Rounded cones as one camera sees them; K cones.

    Attributes:
        cones: Shape (K,), ``CONE``.
        spans: Shape (K,), ``SPAN``.
        shades: Shape (K,), ``SHADE``.
        paints: Shape (K,), ``PAINT``.
        owners: Avatar of each. Shape (K,), int32.
        neighbours: Cones of the same avatar that may darken each, -1 after the last. Shape (K, n), int32.
    """

    cones: Array
    spans: Array
    shades: Array
    paints: Array
    owners: Array
    neighbours: Array


class Lists(NamedTuple):
    """Cones of each cell of a grid, as CSR lists.

    Attributes:
        offsets: Those of cell i are ``entries[offsets[i] : offsets[i + 1]]``. Shape (cells + 1,), int32.
        entries: The cones, int32.
    """

    offsets: Array
    entries: Array


class Grids(NamedTuple):
    """Cones and triangles of the cells of some grids.

    Attributes:
        tiles: Cones of the tiles of the screen.
        faces: Triangles of the tiles.
        light: The plane across the light.
        shadows: Cones that may shade its cells.
        floor: The plane of the floor.
        contacts: Cones that may darken its cells.
        reach: How near these are [m].
    """

    tiles: Lists
    faces: Lists
    light: Plane
    shadows: Lists
    floor: Plane
    contacts: Lists
    reach: float


class Near(NamedTuple):
    """Room for listing each cone once: stamps, shape (K + 1,), the last one the latest; cones found, shape (128,)."""

    stamps: Array
    cones: Array


class Lit(NamedTuple):
    """Points that a tile shows.

    Attributes:
        values: Rows of ``tiles.POINTS`` values, see ``tiles``. Shape (POINT_SCRATCH,), float32.
        ids: Cone of each point, ``FLOOR`` or ``NOTHING``. Shape (POINTS,), int32.
        pixels: Its pixel. Shape (POINTS,), int32.
    """

    values: Array
    ids: Array
    pixels: Array


class Skins(NamedTuple):
    """Triangles of skins as one camera sees them; T triangles on V vertices.

    Attributes:
        triangles: Corners, counter-clockwise from outside. Shape (T, 3), int32.
        owners: Avatar of each. Shape (T,), int32.
        looks: Row of its paint. Shape (T,), int32.
        homes: Cone that it lies on, -1 for none. Shape (T,), int32.
        paints: Shape (P,), ``PAINT``.
        screen: x and y [px] of vertices, and one over their depth [1/m]. Shape (V, 3), float32.
        normals: Of vertices, unit. Shape (V, 3), float32.
    """

    triangles: Array
    owners: Array
    looks: Array
    homes: Array
    paints: Array
    screen: Array
    normals: Array


class Layers(NamedTuple):
    """What the pixels of a tile show of skins.

    Attributes:
        samples: One over the depth of the nearest triangle at each sample, 0 for none; then which of the tile's
            triangles that is. Eight columns a row of samples, four rows a row of pixels. Shape (2 * SAMPLES * N,),
            float32.
        values: Rows of layers, see ``tiles``. Shape (LAYER * SAMPLES * N,), float32.
        homes: Cone that each layer lies on, -1 for none. Shape (SAMPLES * N,), int32.
        focal: Focal length [px], float32.
    """

    samples: Array
    values: Array
    homes: Array
    focal: float
