"""What the kernels of drawing work on: named tuples of arrays."""

from typing import NamedTuple

from crowdsim.core.types import Array


class Cones(NamedTuple):
    """Rounded cones as one camera sees them; K cones.

    Attributes:
        cones: Middle relative to the eye (3), half axis (3), middle radius, half the difference. Shape (K, 8), float32.
        spans: First and last row of pixels that each may touch. Shape (K, 2), int32.
        shades: In light space relative to the eye, one end (3), the vector to the other (3), first radius, difference
            to the second, one over the squared flat length. Shape (K, 9), float32.
        paints: Linear red, green, blue and gloss. Shape (K, 4), float32.
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
    """Cones of the tiles of the screen, of the grid of shadows and of the grid of contacts; triangles of the tiles."""

    tiles: Lists
    faces: Lists
    shadows: Lists
    contacts: Lists


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
        paints: Linear red, green, blue and gloss. Shape (P, 4), float32.
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
