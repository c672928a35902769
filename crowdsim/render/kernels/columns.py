"""Names of the columns of the arrays that the kernels of drawing work on."""

EYE_X, EYE_Y, EYE_Z = 0, 1, 2
RIGHT_X, RIGHT_Y, RIGHT_Z = 3, 4, 5
UP_X, UP_Y, UP_Z = 6, 7, 8
AHEAD_X, AHEAD_Y, AHEAD_Z = 9, 10, 11
FOCAL, MIDDLE_X, MIDDLE_Y, HAZE = 12, 13, 14, 15
"""A camera: eye [m], directions, focal length [px], middle of the picture [px], distance where haze hides half [m]."""

SUN_X, SUN_Y, SUN_Z = 0, 1, 2
U_X, U_Y, U_Z = 3, 4, 5
V_X, V_Y, V_Z = 6, 7, 8
GRID_U, GRID_V, PER_METRE, COLUMNS, ROWS = 9, 10, 11, 12, 13
SOFTNESS, WIDEST = 14, 15
"""A light: direction to the sun, two directions across it, corner of the grid of shadows [m], its cells a metre, its
columns and rows, tangent of the sun's apparent radius, widest blur [m]."""

SUN_RED, SUN_GREEN, SUN_BLUE = 16, 17, 18
SKY_RED, SKY_GREEN, SKY_BLUE = 19, 20, 21
BOUNCE_RED, BOUNCE_GREEN, BOUNCE_BLUE = 22, 23, 24
ALBEDO, SQUARES, LINES, FINE = 25, 26, 27, 28
HORIZON_RED, HORIZON_GREEN, HORIZON_BLUE = 29, 30, 31
ZENITH_RED, ZENITH_GREEN, ZENITH_BLUE = 32, 33, 34
FLAT, SHADOW = 35, 36
LIGHT = 37
"""What follows in a light: light of sun, sky and floor; how bright the floor is, and how strong its squares, lines and
fine lines are; colours of the sky; whether floor and sky are of the horizon's colour alone, and the share of it that
shadows take from the floor; number of columns."""

FLOOR_X, FLOOR_Z, FLOOR_PER_METRE, FLOOR_COLUMNS, FLOOR_ROWS, REACH = 0, 1, 2, 3, 4, 5
"""A floor: corner of the grid of contacts [m], its cells a metre, its columns and rows, reach [m]."""

START_X, START_Y, START_Z, END_X, END_Y, END_Z, START_RADIUS, END_RADIUS = 0, 1, 2, 3, 4, 5, 6, 7
"""A capsule in the world: both ends and both radii [m]."""

CENTRE_X, CENTRE_Y, CENTRE_Z, HALF_X, HALF_Y, HALF_Z, RADIUS, TAPER = 0, 1, 2, 3, 4, 5, 6, 7
"""A cone relative to the eye: centre, half axis, radius at the centre, half the difference of the radii [m]."""

SHADE_U, SHADE_V, SHADE_W, ALONG_U, ALONG_V, ALONG_W, SHADE_RADIUS, SHADE_TAPER, PER_SQUARE = 0, 1, 2, 3, 4, 5, 6, 7, 8
"""A cone in light space: first end, the vector to the second, first radius, difference to the second [m], one over the
squared length of that vector in u and v [1/m^2]."""

LEAST_U, LEAST_V, GREATEST_U, GREATEST_V = 0, 1, 2, 3
"""The region of light space that cones reach [m]."""

AX, AY, BX, BY, A_RADIUS, B_RADIUS = 0, 1, 2, 3, 4, 5
"""A segment of a grid: both ends and both radii [cells]; a negative first radius leaves it out."""

FIRST_ROW, LAST_ROW = 0, 1
"""Rows of pixels that a cone may touch."""

PAINT_RED, PAINT_GREEN, PAINT_BLUE, GLOSS = 0, 1, 2, 3
"""Linear colour and gloss of a cone."""

FLASH_X, FLASH_Y, FLASH_DEPTH, FLASH_SIZE, FLASH_AGE, FLASH_POWER, FLASH_OUTCOME = 0, 1, 2, 3, 4, 5, 6
"""A flash: position in the picture [px], distance from the eye [m], size [px], age 0..1, brightness, outcome of the
strike (``crowd.kernels.layout``)."""

ARENA_KIND, ARENA_X, ARENA_Z, ARENA_HALF_X, ARENA_HALF_Z, ARENA_LINE = 0, 1, 2, 3, 4, 5
"""An arena: kind (0 none, 1 circle, 2 rectangle), centre, half sizes and half the width of its line [m]."""
