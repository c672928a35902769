"""Compiled inverse kinematics of limbs: bones that bend at one joint until their end is at a given distance."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdsim.core.easing import minimum_jerk
from crowdsim.core.quaternions import conjugate, multiply, rotate
from crowdsim.jit import kernel
from crowdsim.poses.kernels.columns import LOWER, MIDDLE, UPPER

MOST = math.radians(150.0)
"""Flexion beyond which no knee or elbow is bent [rad]."""
_HINGED = 0.2
"""Sine of the flexion below which the hinge takes over from the plane that a limb is bent in."""

_SWIVELS = math.radians(70.0)
"""Furthest that a limb swivels [rad]."""
_ACROSS = math.radians(90.0)
"""Range, up to the far side of a limb, over which it swivels less: there it would have to choose a way around [rad]."""


class World(NamedTuple):
    """Joints in the world.

    Attributes:
        positions: Shape (J, 3) [m].
        rotations: Shape (J, 4).
    """

    positions: NDArray[np.float64]
    rotations: NDArray[np.float64]


@kernel(inline=True)
def _pose_joint(limbs, sizes, j, pose, world):
    """Write position and rotation in the world of a joint that hangs on another one."""
    positions, rotations, p = world.positions, world.rotations, limbs.parents[j]
    o, q, size = limbs.offsets[j], rotations[j], sizes[limbs.segments[p]]
    x, y, z = rotate(rotations[p], o[0] * size, o[1] * size, o[2] * size)
    positions[j, 0] = positions[p, 0] + x
    positions[j, 1] = positions[p, 1] + y
    positions[j, 2] = positions[p, 2] + z
    q[0], q[1], q[2], q[3] = multiply(rotations[p], pose[j])


@kernel
def pose_chain(limbs, sizes, root, pose, world):
    """Write positions and rotations in the world of the joints of a chain; ``sizes`` (3,) are as of ``Rows``."""
    for at in range(limbs.chain.shape[0]):
        j = limbs.chain[at]
        if limbs.parents[j] < 0:
            for k in range(3):
                world.positions[j, k] = root[k]
            for k in range(4):
                world.rotations[j, k] = pose[j, k]
        else:
            _pose_joint(limbs, sizes, j, pose, world)


@kernel
def pose_side(limbs, side, sizes, pose, world):
    """Write positions and rotations in the world of the joints of one limb, as ``pose_chain`` does."""
    for at in range(limbs.chain.shape[0]):
        if limbs.sides[at] == side:
            _pose_joint(limbs, sizes, limbs.chain[at], pose, world)


@kernel(inline=True)
def distance_between(a, b):
    """Return the distance between two points."""
    return math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2)


@kernel(inline=True)
def reach_of(a, b, flexion):
    """Return how far apart two bones of lengths ``a`` and ``b`` have their ends at a flexion."""
    return math.sqrt(a * a + b * b + 2.0 * a * b * math.cos(flexion))


@kernel
def soft_ramp(x):
    """Return a smooth bend from 0 to ``x``."""
    if abs(x) > 30.0:
        return max(x, 0.0)
    return x + math.log1p(math.exp(-x)) if x > 0.0 else math.log1p(math.exp(x))


@kernel
def excess(now, wanted, longest, width):
    """Return how far a limb that is ``now`` long is asked beyond its length; smooth, so it begins a little before."""
    edge = longest - 1.5 * width
    return width * (soft_ramp((wanted - edge) / width) - soft_ramp((now - edge) / width))


@kernel
def flexion_at(a, b, distance):
    """Return the flexion at which two bones have their ends so far apart."""
    cosine = (distance * distance - a * a - b * b) / (2.0 * a * b)
    return math.acos(min(max(cosine, -1.0), 1.0))


@kernel
def bend_axis(u, v, a, b, hinge):
    """Return the axis that two bones ``u`` and ``v`` of lengths ``a`` and ``b`` bend about.

    It is normal to the plane that they are bent in; the hinge takes over where they are nearly straight.
    """
    ux, uy, uz = u
    vx, vy, vz = v
    nx, ny, nz = (uy * vz - uz * vy) / (a * b), (uz * vx - ux * vz) / (a * b), (ux * vy - uy * vx) / (a * b)
    hx, hy, hz = hinge
    along = (hx * ux + hy * uy + hz * uz) / (a * a)
    hx, hy, hz = hx - along * ux, hy - along * uy, hz - along * uz
    size = math.sqrt(hx * hx + hy * hy + hz * hz)
    if size > 1e-6:
        hx, hy, hz = hx / size, hy / size, hz / size
        more = max(0.0, _HINGED - math.sqrt(nx * nx + ny * ny + nz * nz))
        nx, ny, nz = nx + more * hx, ny + more * hy, nz + more * hz
    size = math.sqrt(nx * nx + ny * ny + nz * nz)
    if size < 1e-9:
        return hx, hy, hz
    return nx / size, ny / size, nz / size


@kernel
def solve_bend(u, v, a, b, axis, flexion, change):
    """Return the rotation about an axis that changes the flexion by ``change``, and the way to the end after it.

    Where the axis is not quite normal to the limb, the angle is found step by step.
    """
    nx, ny, nz = axis
    wanted = flexion + change
    bend, end = (1.0, 0.0, 0.0, 0.0), u
    for _ in range(5):
        c, s = math.cos(0.5 * change), math.sin(0.5 * change)
        bend = c, s * nx, s * ny, s * nz
        ex, ey, ez = rotate(bend, v[0], v[1], v[2])
        end = u[0] + ex, u[1] + ey, u[2] + ez
        size = math.sqrt(end[0] * end[0] + end[1] * end[1] + end[2] * end[2])
        lack = wanted - flexion_at(a, b, size)
        change += lack
        if abs(lack) < 1e-9:
            break
    return bend, end


@kernel
def shortest_rotation(e, g):
    """Return the shortest rotation that lays one vector along another, and whether there is one."""
    size = math.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])
    far = math.sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2])
    if size < 1e-9 or far < 1e-9:
        return (1.0, 0.0, 0.0, 0.0), False
    ex, ey, ez, gx, gy, gz = e[0] / size, e[1] / size, e[2] / size, g[0] / far, g[1] / far, g[2] / far
    w, x, y, z = 1.0 + ex * gx + ey * gy + ez * gz, ey * gz - ez * gy, ez * gx - ex * gz, ex * gy - ey * gx
    size = math.sqrt(w * w + x * x + y * y + z * z)
    if size < 1e-6:
        return (1.0, 0.0, 0.0, 0.0), False
    return (w / size, x / size, y / size, z / size), True


@kernel
def _write_local(parent, rotation, out):
    """Write a joint's local rotation, given its parent's and its own in the world."""
    w, x, y, z = multiply(conjugate(parent), rotation)
    size = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    out[0], out[1], out[2], out[3] = w * size, x * size, y * size, z * size


@kernel
def bend_limb(limbs, side, pose, world, target, distance):
    """Bend a limb until its end is ``distance`` from its upper joint, and swing it to point at a target.

    It bends in the plane that it is bent in, about its hinge where it is nearly straight, and not beyond ``MOST``, or
    what it is bent already. The swing is the shortest rotation. Local rotations of its upper and middle joint change,
    and of its end joint, which keeps its rotation in the world. A limb with no direction to point in stays as it is.

    Args:
        limbs: A ``motion.Limbs``.
        side: Which of the two.
        pose: Local rotations. Shape (J, 4), changed.
        world: The joints in the world, a ``World``; it stays as it is.
        target: Position of the target [m], a tuple of three.
        distance: Distance of the end from the upper joint afterwards [m].

    Returns:
        The rotation in the world of all between the middle joint and the end.
    """
    upper, middle, end = limbs.joints[side, UPPER], limbs.joints[side, MIDDLE], limbs.joints[side, LOWER]
    p, q, r = world.positions[upper], world.positions[middle], world.positions[end]
    u = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    v = r[0] - q[0], r[1] - q[1], r[2] - q[2]
    a = math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    b = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    flexion = flexion_at(a, b, distance_between(p, r))
    change = min(flexion_at(a, b, distance), max(MOST, flexion)) - flexion
    h, world_rotations, parents = limbs.hinges[side], world.rotations, limbs.parents
    axis = bend_axis(u, v, a, b, rotate(world_rotations[upper], h[0], h[1], h[2]))
    bend, reached = solve_bend(u, v, a, b, axis, flexion, change)
    swing, found = shortest_rotation(reached, (target[0] - p[0], target[1] - p[1], target[2] - p[2]))
    if not found:
        return 1.0, 0.0, 0.0, 0.0
    # The upper joint swings; all between it and the middle joint goes along, and the middle joint bends in it.
    bend = multiply(swing, bend)
    above = world_rotations[parents[upper]]
    _write_local((above[0], above[1], above[2], above[3]), multiply(swing, world_rotations[upper]), pose[upper])
    _write_local(
        multiply(swing, world_rotations[parents[middle]]), multiply(bend, world_rotations[middle]), pose[middle]
    )
    unmoved = multiply((1.0, 0.0, 0.0, 0.0), world_rotations[end])
    _write_local(multiply(bend, world_rotations[parents[end]]), unmoved, pose[end])
    return bend


@kernel
def swivel_limb(limbs, side, pose, world, goal, straight):
    """Swivel a limb about the line from its upper joint to its end, so that its middle joint goes towards a goal.

    The nearer it is to straight the less it swivels. Local rotations of its upper joint change, and of its end joint,
    which keeps its rotation in the world.

    Args:
        limbs: A ``motion.Limbs``.
        side: Which of the two.
        pose: Local rotations. Shape (J, 4), changed.
        world: The joints in the world, a ``World``; it stays as it is.
        goal: Position towards which the middle joint goes [m], a tuple of three.
        straight: Distance of the middle joint from that line below which the limb hardly swivels [m].
    """
    upper, middle, end = limbs.joints[side, UPPER], limbs.joints[side, MIDDLE], limbs.joints[side, LOWER]
    p, q, r = world.positions[upper], world.positions[middle], world.positions[end]
    length = distance_between(p, r)
    if length < 1e-6:
        return
    x, y, z = (r[0] - p[0]) / length, (r[1] - p[1]) / length, (r[2] - p[2]) / length
    ux, uy, uz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    vx, vy, vz = goal[0] - p[0], goal[1] - p[1], goal[2] - p[2]
    along = ux * x + uy * y + uz * z
    ux, uy, uz = ux - along * x, uy - along * y, uz - along * z
    along = vx * x + vy * y + vz * z
    vx, vy, vz = vx - along * x, vy - along * y, vz - along * z
    sine = (uy * vz - uz * vy) * x + (uz * vx - ux * vz) * y + (ux * vy - uy * vx) * z
    angle = math.atan2(sine, ux * vx + uy * vy + uz * vz + straight * straight)
    angle = _SWIVELS * math.tanh(angle / _SWIVELS) * minimum_jerk((math.pi - abs(angle)) / _ACROSS)
    c, s = math.cos(0.5 * angle), math.sin(0.5 * angle)
    swivel = c, s * x, s * y, s * z
    world_rotations, parents = world.rotations, limbs.parents
    above, below = world_rotations[parents[upper]], world_rotations[parents[end]]
    _write_local((above[0], above[1], above[2], above[3]), multiply(swivel, world_rotations[upper]), pose[upper])
    unmoved = multiply((1.0, 0.0, 0.0, 0.0), world_rotations[end])
    _write_local(multiply(swivel, below), unmoved, pose[end])
