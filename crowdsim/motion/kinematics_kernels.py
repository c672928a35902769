"""Compiled forward kinematics."""

from crowdsim.jit import kernel


@kernel(fastmath={"contract", "nsz"})
def pose_joints(low, high, parents, offsets, root_positions, rotations, translations, out_positions, out_rotations):
    """Compose frames ``low`` to ``high`` from the root outwards; an empty ``translations`` means fixed offsets."""
    joints = parents.shape[0]
    moving = translations.shape[0] > 0
    for f in range(low, high):
        for c in range(3):
            out_positions[f, 0, c] = root_positions[f, c]
        for c in range(4):
            out_rotations[f, 0, c] = rotations[f, 0, c]
        for j in range(1, joints):
            p = parents[j]
            w, x, y, z = (
                out_rotations[f, p, 0],
                out_rotations[f, p, 1],
                out_rotations[f, p, 2],
                out_rotations[f, p, 3],
            )
            if moving:
                ox, oy, oz = translations[f, j, 0], translations[f, j, 1], translations[f, j, 2]
            else:
                ox, oy, oz = offsets[j, 0], offsets[j, 1], offsets[j, 2]
            tx, ty, tz = y * oz - z * oy, z * ox - x * oz, x * oy - y * ox
            tx, ty, tz = tx + tx, ty + ty, tz + tz
            out_positions[f, j, 0] = out_positions[f, p, 0] + ox + w * tx + (y * tz - z * ty)
            out_positions[f, j, 1] = out_positions[f, p, 1] + oy + w * ty + (z * tx - x * tz)
            out_positions[f, j, 2] = out_positions[f, p, 2] + oz + w * tz + (x * ty - y * tx)
            a, b, c, d = rotations[f, j, 0], rotations[f, j, 1], rotations[f, j, 2], rotations[f, j, 3]
            out_rotations[f, j, 0] = w * a - x * b - y * c - z * d
            out_rotations[f, j, 1] = w * b + x * a + y * d - z * c
            out_rotations[f, j, 2] = w * c - x * d + y * a + z * b
            out_rotations[f, j, 3] = w * d + x * c - y * b + z * a
