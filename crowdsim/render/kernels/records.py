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
    """Cones of the tiles of the screen, of the grid of shadows and of the grid of contacts with the floor."""

    tiles: Lists
    shadows: Lists
    contacts: Lists


class Near(NamedTuple):
    """Room for listing each cone once: stamps, shape (K + 1,), the last one the latest; cones found, shape (64,)."""

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
