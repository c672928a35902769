"""Compiled skinning."""

import math

from crowdsim.jit import kernel


@kernel(allocates=False)
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
