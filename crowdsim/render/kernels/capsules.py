"""Compiled preparation of capsules for one camera: placing, culling, projection, light space and neighbours."""

import math

from crowdsim.core.quaternions import rotate
from crowdsim.jit import kernel
from crowdsim.poses.kernels.columns import TRUNK

CLOSEST = 0.05
NEIGHBOUR_GAP = 0.15


@kernel
def place_capsules(positions, rotations, sizes, girths, joints, segments, offsets, radii, swells, out_shapes):
    """Write the capsules of bodies in the world. Shape (n * K,), ``CAPSULE``.

    Those that swell, whose ``swells`` (K,) is 1, are as many times thicker as the girth says. ``sizes`` (n, 3) are
    those of the bones of trunk, legs and arms, one of which each capsule lies on, by ``segments`` (K,); ``offsets``
    (2, K, 3) are its ends in its joint's frame.
    """
    count = joints.shape[0]
    for n in range(positions.shape[0]):
        scale = sizes[n, TRUNK]
        for k in range(count):
            j, row = joints[k], n * count + k
            size = sizes[n, segments[k]]
            width = scale * (1.0 + swells[k] * (girths[n] - 1.0))
            shape, place = out_shapes[row], positions[n, j]
            x, y, z = rotate(rotations[n, j], offsets[0, k, 0], offsets[0, k, 1], offsets[0, k, 2])
            shape.start_x, shape.start_y, shape.start_z = place[0] + size * x, place[1] + size * y, place[2] + size * z
            x, y, z = rotate(rotations[n, j], offsets[1, k, 0], offsets[1, k, 1], offsets[1, k, 2])
            shape.end_x, shape.end_y, shape.end_z = place[0] + size * x, place[1] + size * y, place[2] + size * z
            shape.start_radius, shape.end_radius = width * radii[k, 0], width * radii[k, 1]


@kernel
def _ends_from_eye(shape, camera):
    """Return the vectors from the eye to both ends of a capsule."""
    ax, ay, az = shape.start_x - camera.eye_x, shape.start_y - camera.eye_y, shape.start_z - camera.eye_z
    bx, by, bz = shape.end_x - camera.eye_x, shape.end_y - camera.eye_y, shape.end_z - camera.eye_z
    return ax, ay, az, bx, by, bz


@kernel
def _depth(cone, camera):
    """Return how far ahead of the eye the centre of a cone is [m]."""
    return cone.centre_x * camera.ahead_x + cone.centre_y * camera.ahead_y + cone.centre_z * camera.ahead_z


@kernel
def choose_capsules(shapes, cameras, width, height, margin, smallest, out_chosen):
    """Write the capsules that show, or whose shadow may, ascending, and return how many.

    A capsule shows when the sphere about it, widened by ``margin`` [m], reaches into the view, and when it covers
    ``smallest`` pixels or more.
    """
    count, camera = 0, cameras[0]
    tx, ty = 0.5 * width / camera.focal, 0.5 * height / camera.focal
    lx, ly = math.sqrt(1.0 + tx * tx), math.sqrt(1.0 + ty * ty)
    for c in range(shapes.shape[0]):
        ax, ay, az, bx, by, bz = _ends_from_eye(shapes[c], camera)
        ra, rb = shapes[c].start_radius, shapes[c].end_radius
        mx, my, mz = 0.5 * (ax + bx), 0.5 * (ay + by), 0.5 * (az + bz)
        long = math.sqrt((bx - ax) ** 2 + (by - ay) ** 2 + (bz - az) ** 2)
        wide = max(ra, rb)
        size = 0.5 * long + wide + margin
        x = mx * camera.right_x + my * camera.right_y + mz * camera.right_z
        y = mx * camera.up_x + my * camera.up_y + mz * camera.up_z
        z = mx * camera.ahead_x + my * camera.ahead_y + mz * camera.ahead_z
        if not (z > -size and abs(x) - tx * z < size * lx and abs(y) - ty * z < size * ly):
            continue
        if smallest > 0.0:
            per_metre = camera.focal / max(z, 1.0)
            if 2.0 * wide * (long + 1.6 * wide) * per_metre * per_metre < smallest:
                continue
        out_chosen[count] = c
        count += 1
    return count


@kernel
def view_capsules(shapes, chosen, cameras, lights, out_cones, out_shades, out_segments, out_spans):
    """Write the chosen capsules as ``draw_tiles`` wants them, and as segments of the screen in tiles."""
    camera, light = cameras[0], lights[0]
    for n in range(chosen.shape[0]):
        c = chosen[n]
        ax, ay, az, bx, by, bz = _ends_from_eye(shapes[c], camera)
        ra, rb = shapes[c].start_radius, shapes[c].end_radius
        cone = out_cones[n]
        cone.centre_x, cone.centre_y, cone.centre_z = 0.5 * (ax + bx), 0.5 * (ay + by), 0.5 * (az + bz)
        cone.half_x, cone.half_y, cone.half_z = 0.5 * (bx - ax), 0.5 * (by - ay), 0.5 * (bz - az)
        cone.radius, cone.taper = 0.5 * (ra + rb), 0.5 * (rb - ra)
        shade = out_shades[n]
        shade.u, shade.v, shade.w = _in_light(ax, ay, az, light)
        shade.along_u, shade.along_v, shade.along_w = _in_light(bx - ax, by - ay, bz - az, light)
        shade.radius, shade.taper = ra, rb - ra
        shade.per_square = 1.0 / max(shade.along_u**2 + shade.along_v**2, 1e-9)
        za = ax * camera.ahead_x + ay * camera.ahead_y + az * camera.ahead_z
        zb = bx * camera.ahead_x + by * camera.ahead_y + bz * camera.ahead_z
        near = CLOSEST + max(ra, rb)
        if za < near and zb < near:
            out_segments[n].a_radius = -1.0
            out_spans[n].first, out_spans[n].last = 0, -1
            continue
        # An end behind the eye moves along the axis to where it can be projected.
        if za < near:
            s = (near - za) / (zb - za)
            ax, ay, az = ax + s * (bx - ax), ay + s * (by - ay), az + s * (bz - az)
        elif zb < near:
            s = (near - zb) / (za - zb)
            bx, by, bz = bx + s * (ax - bx), by + s * (ay - by), bz + s * (az - bz)
        segment = out_segments[n]
        segment.ax, segment.ay, segment.a_radius = _project(ax, ay, az, ra, camera)
        segment.bx, segment.by, segment.b_radius = _project(bx, by, bz, rb, camera)
        low = min(max(8.0 * min(segment.ay - segment.a_radius, segment.by - segment.b_radius), -1e6), 1e6)
        high = min(max(8.0 * max(segment.ay + segment.a_radius, segment.by + segment.b_radius), -1e6), 1e6)
        out_spans[n].first, out_spans[n].last = math.floor(low), math.floor(high)


@kernel
def _in_light(x, y, z, light):
    """Return a vector in light space."""
    u = x * light.u_x + y * light.u_y + z * light.u_z
    v = x * light.v_x + y * light.v_y + z * light.v_z
    return u, v, x * light.sun_x + y * light.sun_y + z * light.sun_z


@kernel
def _project(x, y, z, radius, camera):
    """Return a circle in tiles of 8 pixels that encloses the picture of a sphere, and a pixel more."""
    u = x * camera.right_x + y * camera.right_y + z * camera.right_z
    v = x * camera.up_x + y * camera.up_y + z * camera.up_z
    w = x * camera.ahead_x + y * camera.ahead_y + z * camera.ahead_z
    over = 1.0 / (w * w - radius * radius)
    across = camera.focal * radius * math.sqrt(max(u * u + v * v + w * w - radius * radius, 0.0)) * over
    at_x = (camera.middle_x + camera.focal * u * w * over) / 8.0
    return at_x, (camera.middle_y - camera.focal * v * w * over) / 8.0, (across + 1.0) / 8.0


@kernel
def shadow_bounds(shades):
    """Return the least u and v that the capsules reach in light space, and the greatest ones."""
    least_u, least_v, greatest_u, greatest_v = 1e30, 1e30, -1e30, -1e30
    for c in range(shades.shape[0]):
        shade = shades[c]
        for end in range(2):
            radius = shade.radius + end * shade.taper
            u, v = shade.u + end * shade.along_u, shade.v + end * shade.along_v
            least_u, least_v = min(least_u, u - radius), min(least_v, v - radius)
            greatest_u, greatest_v = max(greatest_u, u + radius), max(greatest_v, v + radius)
    return least_u, least_v, greatest_u, greatest_v


@kernel
def shadow_segments(shades, cones, cameras, lights, plane, thinnest, out):
    """Write the capsules as segments of the grid of shadows, widened by the softest edge that they can cast.

    Those that show thinner than ``thinnest`` pixels are left out.
    """
    camera, light = cameras[0], lights[0]
    for c in range(shades.shape[0]):
        cone, shade, segment = cones[c], shades[c], out[c]
        ahead = _depth(cone, camera)
        if 2.0 * (cone.radius + abs(cone.taper)) * camera.focal < thinnest * max(ahead, 1.0):
            segment.a_radius = -1.0
            continue
        over = max(camera.eye_y + cone.centre_y + abs(cone.half_y) + cone.radius + abs(cone.taper), 0.0)
        pad = light.softness * over / light.sun_y + light.widest
        for end in range(2):
            x = (shade.u + end * shade.along_u - plane.left) * plane.per_metre
            y = (shade.v + end * shade.along_v - plane.top) * plane.per_metre
            _set_end(segment, end, x, y, (shade.radius + end * shade.taper + pad) * plane.per_metre)


@kernel
def contact_segments(cones, cameras, plane, reach, out):
    """Write the capsules within ``reach`` [m] of the floor as segments of the grid of contacts."""
    camera = cameras[0]
    for c in range(cones.shape[0]):
        cone, segment = cones[c], out[c]
        low = camera.eye_y + cone.centre_y - abs(cone.half_y) - cone.radius - abs(cone.taper)
        if low > reach:
            segment.a_radius = -1.0
            continue
        for end in range(2):
            sign = 2.0 * end - 1.0
            x = (cone.centre_x + sign * cone.half_x - plane.left) * plane.per_metre
            y = (cone.centre_z + sign * cone.half_z - plane.top) * plane.per_metre
            _set_end(segment, end, x, y, (cone.radius + sign * cone.taper + reach) * plane.per_metre)


@kernel
def _set_end(segment, end, x, y, radius):
    """Write one end of a segment."""
    if end == 0:
        segment.ax, segment.ay, segment.a_radius = x, y, radius
    else:
        segment.bx, segment.by, segment.b_radius = x, y, radius


@kernel
def _axis_distance(p, q):
    """Return the distance between the axes of two cones."""
    # With x = p + s hp and y = q + t hq, s and t in -1..1: solve for s, clamp, solve for t, clamp, solve for s again.
    rx, ry, rz = p.centre_x - q.centre_x, p.centre_y - q.centre_y, p.centre_z - q.centre_z
    a = p.half_x * p.half_x + p.half_y * p.half_y + p.half_z * p.half_z
    e = q.half_x * q.half_x + q.half_y * q.half_y + q.half_z * q.half_z
    b = p.half_x * q.half_x + p.half_y * q.half_y + p.half_z * q.half_z
    c = p.half_x * rx + p.half_y * ry + p.half_z * rz
    f = q.half_x * rx + q.half_y * ry + q.half_z * rz
    s = min(max((b * f - c * e) / max(a * e - b * b, 1e-9), -1.0), 1.0)
    t = min(max((b * s + f) / max(e, 1e-9), -1.0), 1.0)
    s = min(max((b * t - c) / max(a, 1e-9), -1.0), 1.0)
    dx = rx + s * p.half_x - t * q.half_x
    dy = ry + s * p.half_y - t * q.half_y
    dz = rz + s * p.half_z - t * q.half_z
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@kernel
def near_capsules(cones, owners, cameras, smallest, out):
    """Write for each capsule those of the same avatar whose surface is near, ascending, then -1.

    Avatars that show smaller than ``smallest`` pixels a metre have none. Capsules of one avatar lie beside one another.
    """
    slots, camera = out.shape[1], cameras[0]
    count = cones.shape[0]
    start = 0
    while start < count:
        stop = start + 1
        while stop < count and owners[stop] == owners[start]:
            stop += 1
        for c in range(start, stop):
            out[c, 0] = -1
        ahead = _depth(cones[start], camera)
        if camera.focal >= smallest * max(ahead, 0.5):
            for c in range(start, stop):
                used = 0
                for other in range(start, stop):
                    if other == c or used == slots:
                        continue
                    touch = cones[c].radius + abs(cones[c].taper) + cones[other].radius + abs(cones[other].taper)
                    if _axis_distance(cones[c], cones[other]) < touch + NEIGHBOUR_GAP:
                        out[c, used] = other
                        used += 1
                if used < slots:
                    out[c, used] = -1
        start = stop
