"""Names of the columns of arrays that describe camera, light and floor."""

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

FLOOR_X, FLOOR_Z, FLOOR_PER_METRE, FLOOR_COLUMNS, FLOOR_ROWS, REACH = 0, 1, 2, 3, 4, 5
"""A floor: corner of the grid of contacts [m], its cells a metre, its columns and rows, reach [m]."""
