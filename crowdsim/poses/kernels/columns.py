"""Names of the columns of arrays that kernels of poses share."""

X, Z, HEADING = 0, 1, 2
"""Ground transforms, and shifts between them."""

BEFORE, AFTER = 0, 1
"""What lies before a moment and after it: durations, or the motion before a transition and the motion after it."""

BEGIN, END, RISE = 0, 1, 2
"""Spans of time; of a step of a foot, also how high it rises."""

COS, SIN = 0, 1

GAP_X, GAP_Y, GAP_Z = 0, 1, 2
FOOT_X, FOOT_Y, FOOT_Z = 3, 4, 5
TOES_X, TOES_Y, TOES_Z = 6, 7, 8
GAP_COLUMNS = 9
"""Gaps at transitions: position of a foot, level rotation and rotation about +y of the foot, rotation of its toes."""

TRACK_FOOT, TRACK_TOES = 3, 7
"""Where the quaternions of foot and toes begin in the tracks of feet, behind the position."""

UPPER, MIDDLE, LOWER = 0, 1, 2
"""Joints of a limb; the lower one is its end."""

HEAD, TORSO = 0, 1
"""Parts of a body that are hit."""
TRUNK, LEG, ARM = 0, 1, 2
"""Segments of a body: trunk with head, hands and feet; thighs and shanks; upper arms and forearms."""
