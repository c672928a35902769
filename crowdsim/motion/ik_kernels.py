"""Compiled inverse kinematics of limbs of two bones."""

import math

import numba as nb


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _turn(w, x, y, z, vx, vy, vz):
    """Turn a vector by a quaternion."""
    tx, ty, tz = 2.0 * (y * vz - z * vy), 2.0 * (z * vx - x * vz), 2.0 * (x * vy - y * vx)
    return vx + w * tx + y * tz - z * ty, vy + w * ty + z * tx - x * tz, vz + w * tz + x * ty - y * tx


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _between(ax, ay, az, bx, by, bz, nx, ny, nz):
    """Return the shortest turn from unit a to unit b, about n where they are opposite."""
    w = 1.0 + ax * bx + ay * by + az * bz
    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if length < 1e-9:
        return 0.0, nx, ny, nz
    return w / length, x / length, y / length, z / length


@nb.njit(cache=True, nogil=True, error_model="numpy")
def _write_product(w, x, y, z, q, out):
    """Write the product of a quaternion and q."""
    a, b, c, d = q[0], q[1], q[2], q[3]
    out[0] = w * a - x * b - y * c - z * d
    out[1] = w * b + x * a + y * d - z * c
    out[2] = w * c - x * d + y * a + z * b
    out[3] = w * d + x * c - y * b + z * a


@nb.njit(cache=True, nogil=True, error_model="numpy")
def bend_limbs(
    uppers, middles, ends, upper_turns, middle_turns, targets, hinges, limits, softness, out_upper, out_middle, out_end
):
    """Bend limbs so that their ends reach targets, or the nearest point on the way from the upper joint to it.

    With a the length from upper joint to middle joint, b that from middle joint to end, and phi the flexion (0 where
    the limb is straight), the distance d between upper joint and end is d^2 = a^2 + b^2 + 2 a b cos(phi). The middle
    joint bends in the plane it is bent in, then the whole limb swings by the shortest turn.

    All are in the world: places (N, 3), rotations (N, 4), hinge axes (N, 3), about which flexion is a positive turn,
    and ``limits`` (N, 2) of flexion [rad], 0 to pi. ``softness`` is the part of the longest reach over which the limb
    eases into it. ``out_upper`` and ``out_middle`` (N, 4) are the new rotations, ``out_end`` (N, 3) is where the end
    comes to lie.
    """
    for i in range(uppers.shape[0]):
        px, py, pz = uppers[i, 0], uppers[i, 1], uppers[i, 2]
        ux, uy, uz = middles[i, 0] - px, middles[i, 1] - py, middles[i, 2] - pz
        vx, vy, vz = ends[i, 0] - middles[i, 0], ends[i, 1] - middles[i, 1], ends[i, 2] - middles[i, 2]
        a = math.sqrt(ux * ux + uy * uy + uz * uz)
        b = math.sqrt(vx * vx + vy * vy + vz * vz)
        tx, ty, tz = targets[i, 0] - px, targets[i, 1] - py, targets[i, 2] - pz
        distance = math.sqrt(tx * tx + ty * ty + tz * tz)
        if not (a > 1e-9 and b > 1e-9 and distance < math.inf):
            # No limb, or nowhere to go: it stays as it is.
            _write_product(1.0, 0.0, 0.0, 0.0, upper_turns[i], out_upper[i])
            _write_product(1.0, 0.0, 0.0, 0.0, middle_turns[i], out_middle[i])
            out_end[i, 0], out_end[i, 1], out_end[i, 2] = ends[i, 0], ends[i, 1], ends[i, 2]
            continue
        ux, uy, uz = ux / a, uy / a, uz / a
        vx, vy, vz = vx / b, vy / b, vz / b

        # The part of the hinge axis that is square to the upper bone; any such axis where the hinge lies along it.
        hx, hy, hz = hinges[i, 0], hinges[i, 1], hinges[i, 2]
        along = hx * ux + hy * uy + hz * uz
        hx, hy, hz = hx - along * ux, hy - along * uy, hz - along * uz
        length = math.sqrt(hx * hx + hy * hy + hz * hz)
        known = length > 1e-6
        if not known:
            if abs(ux) < 0.7:
                hx, hy, hz = 0.0, uz, -uy
            else:
                hx, hy, hz = -uz, 0.0, ux
            length = math.sqrt(hx * hx + hy * hy + hz * hz)
        hx, hy, hz = hx / length, hy / length, hz / length

        # The axis it is bent about, mirrored where it bends backwards; the hinge takes over as the limb gets straight.
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        forward = nx * hx + ny * hy + nz * hz
        share = 0.0
        if known and forward < 0.0:
            share = -2.0 * forward
        bent = math.sqrt(nx * nx + ny * ny + nz * nz)
        share += max(0.0, 0.1 - bent) if known else (1.0 if bent < 1e-6 else 0.0)
        nx, ny, nz = nx + share * hx, ny + share * hy, nz + share * hz
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
        if length > 1e-9:
            nx, ny, nz = nx / length, ny / length, nz / length
        else:
            nx, ny, nz = hx, hy, hz

        # The flexion that gives the distance, by half angles, which are exact where the limb is nearly straight.
        least, most = limits[i, 0], limits[i, 1]
        longest = math.sqrt(max(0.0, a * a + b * b + 2.0 * a * b * math.cos(least)))
        wanted = distance
        ease = softness * longest
        if ease > 0.0 and wanted > longest - ease:
            wanted = longest - ease * math.exp((longest - ease - wanted) / ease)
        opened = max(0.0, wanted * wanted - (a - b) * (a - b))
        closed = max(0.0, (a + b - wanted) * (a + b + wanted))
        flexion = min(max(2.0 * math.atan2(math.sqrt(closed), math.sqrt(opened)), least), most)

        # Bend the middle joint: the lower bone lies at the flexion from the upper one, in the plane square to n.
        c, s = math.cos(flexion), math.sin(flexion)
        gx = c * ux + s * (ny * uz - nz * uy)
        gy = c * uy + s * (nz * ux - nx * uz)
        gz = c * uz + s * (nx * uy - ny * ux)
        bw, bx, by, bz = _between(vx, vy, vz, gx, gy, gz, nx, ny, nz)
        ex, ey, ez = a * ux + b * gx, a * uy + b * gy, a * uz + b * gz

        # Swing the limb onto the line to the target.
        reach = math.sqrt(ex * ex + ey * ey + ez * ez)
        sw, sx, sy, sz = 1.0, 0.0, 0.0, 0.0
        if reach > 1e-9 * (a + b) and distance > 1e-9 * (a + b):
            sw, sx, sy, sz = _between(
                ex / reach, ey / reach, ez / reach, tx / distance, ty / distance, tz / distance, nx, ny, nz
            )
        ex, ey, ez = _turn(sw, sx, sy, sz, ex, ey, ez)
        out_end[i, 0], out_end[i, 1], out_end[i, 2] = px + ex, py + ey, pz + ez
        _write_product(sw, sx, sy, sz, upper_turns[i], out_upper[i])
        _write_product(
            sw * bw - sx * bx - sy * by - sz * bz,
            sw * bx + sx * bw + sy * bz - sz * by,
            sw * by - sx * bz + sy * bw + sz * bx,
            sw * bz + sx * by - sy * bx + sz * bw,
            middle_turns[i],
            out_middle[i],
        )
