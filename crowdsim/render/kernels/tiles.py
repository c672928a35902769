"""Layout of the scratch arrays in which a tile of 8 x 8 pixels is drawn, and constants in single precision.

The loops over the 64 pixels of a tile have no branches and work in float32 on one flat scratch array with a fixed
distance between its rows, so that the compiler can use vector instructions.
"""

import numpy as np

F = np.float32
# An unsigned index is never negative, which lets the compiler use vector instructions.
U = np.uint64
N = 64
DX, DY, DZ, SPREAD = 0, N, 2 * N, 3 * N
FRONT_T, FRONT_S, FRONT_I = 4 * N, 5 * N, 6 * N
NEXT_T, NEXT_S, NEXT_I = 7 * N, 8 * N, 9 * N
EDGE_T, EDGE_S, EDGE_C, EDGE_I = 10 * N, 14 * N, 18 * N, 22 * N
GROUND_X, GROUND_Z, GROUND_T, WIDTH_X, WIDTH_Z = 26 * N, 27 * N, 28 * N, 29 * N, 30 * N
REST = 31 * N
RED, GREEN, BLUE = 32 * N, 33 * N, 34 * N
LINE, OUTSIDE = 35 * N, 36 * N
HIT_T, HIT_S, HIT_C = 37 * N, 38 * N, 39 * N
SCRATCH = 40 * N

POINTS = 7 * N
"""Points to be lit in a tile: the floor in every pixel, then up to four edges and two crossing fronts a pixel."""
X, Y, Z, NX, NY, NZ = 0, POINTS, 2 * POINTS, 3 * POINTS, 4 * POINTS, 5 * POINTS
WIDTH, SHARE, SUN, SKY, WAY = 6 * POINTS, 7 * POINTS, 8 * POINTS, 9 * POINTS, 10 * POINTS
TINT_RED, TINT_GREEN, TINT_BLUE, TINT_GLOSS = 11 * POINTS, 12 * POINTS, 13 * POINTS, 14 * POINTS
POINT_SCRATCH = 15 * POINTS
TOGETHER = 128
"""Cones up to which all points of a tile look for them at once; beyond, eight points at a time look for fewer."""
FLOOR, NOTHING = -1, -2
SAMPLES = 4
"""Samples of a pixel that skins are drawn with, so many layers at the most."""
LAYER_X, LAYER_Y, LAYER_Z, LAYER_RED, LAYER_GREEN, LAYER_BLUE, LAYER_GLOSS = 0, 1, 2, 3, 4, 5, 6
LAYER = 7
"""Columns of a layer of skin: normal, linear colour and gloss; and their number."""
AT_X, AT_Y, AT_Z, AT_NX, AT_NY, AT_NZ = U(X), U(Y), U(Z), U(NX), U(NY), U(NZ)
AT_WIDTH, AT_SUN, AT_SKY = U(WIDTH), U(SUN), U(SKY)

FAR = F(1e9)
TINY = F(1e-9)
ZERO, HALF, ONE, TWO = F(0.0), F(0.5), F(1.0), F(2.0)
FULL, FAINT = F(0.996), F(0.004)
NEAR = F(0.05)

FLAGS = {"contract", "nsz", "arcp", "reassoc", "nnan"}
