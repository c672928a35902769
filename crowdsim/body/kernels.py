"""Compiled skinning."""

import math

from crowdsim.core.quaternions import conjugate, multiply
from crowdsim.jit import kernel


@kernel
def skin_vertices(low, high, matrices, joints, weights, vertices, normals, out_vertices, out_normals):
    """Put the skin of avatars ``low`` to ``high`` into the world.

    Args:
        low: First avatar.
        high: One past the last.
        matrices: From the binding pose to the world, for each avatar and joint. Shape (n, K, 3, 4), float32.
        joints: Of each vertex. Shape (V, 4), uint8.
        weights: Shape (V, 4), float32.
        vertices: In the binding pose [m]. Shape (n, V, 3), float32.
        normals: Likewise, unit. Shape (n, V, 3), float32.
        out_vertices: Written. Shape (n, V, 3), float32.
        out_normals: Written. Shape (n, V, 3), float32.
    """
    for n in range(low, high):
        own = matrices[n]
        for v in range(vertices.shape[1]):
            a, b, c, d = weights[v, 0], weights[v, 1], weights[v, 2], weights[v, 3]
            p, q, r, s = own[joints[v, 0]], own[joints[v, 1]], own[joints[v, 2]], own[joints[v, 3]]
            x, y, z = vertices[n, v, 0], vertices[n, v, 1], vertices[n, v, 2]
            u, g, h = normals[n, v, 0], normals[n, v, 1], normals[n, v, 2]
            total = a * a * 0.0
            for k in range(3):
                mx = a * p[k, 0] + b * q[k, 0] + c * r[k, 0] + d * s[k, 0]
                my = a * p[k, 1] + b * q[k, 1] + c * r[k, 1] + d * s[k, 1]
                mz = a * p[k, 2] + b * q[k, 2] + c * r[k, 2] + d * s[k, 2]
                mt = a * p[k, 3] + b * q[k, 3] + c * r[k, 3] + d * s[k, 3]
                out_vertices[n, v, k] = mx * x + my * y + mz * z + mt
                normal = mx * u + my * g + mz * h
                out_normals[n, v, k] = normal
                total += normal * normal
            total = 1.0 / math.sqrt(total) if total > 0.0 else 0.0
            for k in range(3):
                out_normals[n, v, k] *= total


@kernel
def carry_skin(positions, rotations, scale, bindings, parents, helpers, straights, out):
    """Write what takes the skin of one avatar into the world, by joints and helpers; see ``Skin.matrices``.

    Args:
        positions: Of joints in the world [m]. Shape (J, 3).
        rotations: Of joints in the world. Shape (J, 4).
        scale: Size of the body.
        bindings: From the binding pose into the frames of joints and helpers. Shape (K, 3, 4).
        parents: Parent of each joint. Shape (J,), int64.
        helpers: Elbow or knee of each helper. Shape (K - J,), int64.
        straights: From the frame of a helper's joint to its parent's in the binding pose. Shape (K - J, 4).
        out: Written. Shape (K, 3, 4), float32.
    """
    joints = positions.shape[0]
    for k in range(bindings.shape[0]):
        joint = k
        if k >= joints:
            joint = helpers[k - joints]
        own = rotations[joint]
        w, x, y, z = own[0], own[1], own[2], own[3]
        if k >= joints:
            above = rotations[parents[joint]]
            a, b, c, d = multiply(multiply(conjugate(above), own), straights[k - joints])
            # Half of a rotation: the middle of it and none, on the shorter way.
            side = -1.0 if a < 0.0 else 1.0
            w, x, y, z = multiply(above, (side * a + 1.0, side * b, side * c, side * d))
        over = 2.0 / (w * w + x * x + y * y + z * z)
        turned = (
            (1.0 - over * (y * y + z * z), over * (x * y - w * z), over * (x * z + w * y)),
            (over * (x * y + w * z), 1.0 - over * (x * x + z * z), over * (y * z - w * x)),
            (over * (x * z - w * y), over * (y * z + w * x), 1.0 - over * (x * x + y * y)),
        )
        for row in range(3):
            p, q, r = turned[row]
            for column in range(4):
                value = p * bindings[k, 0, column] + q * bindings[k, 1, column] + r * bindings[k, 2, column]
                out[k, row, column] = scale * value + (positions[joint, row] if column == 3 else 0.0)


@kernel
def nearest_capsules(vertices, starts, ends, radii, out):
    """Write the capsule whose surface is nearest to each vertex.

    Args:
        vertices: Shape (V, 3).
        starts: One end of each capsule. Shape (C, 3).
        ends: The other. Shape (C, 3).
        radii: At both ends. Shape (C, 2).
        out: Written. Shape (V,), int32.
    """
    for v in range(vertices.shape[0]):
        best, least = 0, 1e30
        for c in range(starts.shape[0]):
            ax, ay, az = ends[c, 0] - starts[c, 0], ends[c, 1] - starts[c, 1], ends[c, 2] - starts[c, 2]
            x, y, z = vertices[v, 0] - starts[c, 0], vertices[v, 1] - starts[c, 1], vertices[v, 2] - starts[c, 2]
            share = min(max((x * ax + y * ay + z * az) / max(ax * ax + ay * ay + az * az, 1e-12), 0.0), 1.0)
            x, y, z = x - share * ax, y - share * ay, z - share * az
            gap = math.sqrt(x * x + y * y + z * z) - radii[c, 0] - share * (radii[c, 1] - radii[c, 0])
            if gap < least:
                best, least = c, gap
        out[v] = best
