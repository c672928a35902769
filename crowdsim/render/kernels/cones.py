"""Compiled ray-casting of rounded cones.

A rounded cone is the union of the spheres about ``c(s) = m + s h`` with radius ``r(s) = r + s k``, s in -1..1. For a
ray ``t d`` from the eye (d of unit length), with the axis moved to the point of the ray nearest to m, the squared
distance between the ray and c(s) is ``D(s)^2 = d0^2 + A (s - s*)^2``, with A = |h|^2 - (h.d)^2. Two values of s matter:

* ``s_c``, where ``D(s) - r(s)`` is least: that gap, measured in pixels, gives the share of the pixel that is covered;
* ``s_h``, where the ray enters first, ``t(s) = s (h.d) - sqrt(r(s)^2 - D(s)^2)``: the hit, whose normal points away
  from c(s_h).

Where ``A < k^2`` the ray looks along the axis into the cone, D(s) - r(s) falls towards the wider end, and the root of
t'(s) is another one; where even ``|h|^2 < k^2`` the wider end's sphere is all there is.
"""

import math

import crowdsim.render.kernels.tiles as tiles
from crowdsim.jit import kernel
from crowdsim.render.kernels.tiles import FAR, FLAGS, HALF, ONE, TINY, TWO, ZERO, F, N, U


@kernel(fastmath=FLAGS)
def start_tile(buf, x0, y0, camera):
    """Write the ray of every pixel, and empty the lists of what they meet."""
    inverse = F(1.0 / camera.focal)
    cx, cy = F(camera.middle_x), F(camera.middle_y)
    rx, ry, rz = F(camera.right_x), F(camera.right_y), F(camera.right_z)
    ux, uy, uz = F(camera.up_x), F(camera.up_y), F(camera.up_z)
    fx, fy, fz = F(camera.ahead_x), F(camera.ahead_y), F(camera.ahead_z)
    left, top = F(x0) + HALF - cx, F(y0) + HALF - cy
    for i in range(N):
        sx = (left + F(i & 7)) * inverse
        sy = -(top + F(i >> 3)) * inverse
        length = ONE / math.sqrt(ONE + sx * sx + sy * sy)
        buf[tiles.DX + i] = (fx + sx * rx + sy * ux) * length
        buf[tiles.DY + i] = (fy + sx * ry + sy * uy) * length
        buf[tiles.DZ + i] = (fz + sx * rz + sy * uz) * length
        buf[tiles.SPREAD + i] = inverse * length
    for i in range(N):
        buf[tiles.FRONT_T + i] = FAR
        buf[tiles.NEXT_T + i] = FAR
        buf[tiles.REST + i] = ONE
    for i in range(4 * N):
        buf[tiles.EDGE_T + i] = FAR


@kernel(inline=True, fastmath=FLAGS)
def sort_in(buf, i, index, t, s, cover):
    """Sort what a pixel meets in by distance.

    A pixel keeps the two nearest that cover it wholly and the four nearest that cover a part of it.
    """
    new_t = t if cover >= tiles.FULL else FAR
    front_t, front_s, front_i = buf[U(tiles.FRONT_T) + i], buf[U(tiles.FRONT_S) + i], buf[U(tiles.FRONT_I) + i]
    next_t, next_s, next_i = buf[U(tiles.NEXT_T) + i], buf[U(tiles.NEXT_S) + i], buf[U(tiles.NEXT_I) + i]
    first = new_t < front_t
    second = new_t < next_t
    buf[U(tiles.NEXT_T) + i] = front_t if first else (new_t if second else next_t)
    buf[U(tiles.NEXT_S) + i] = front_s if first else (s if second else next_s)
    buf[U(tiles.NEXT_I) + i] = front_i if first else (index if second else next_i)
    buf[U(tiles.FRONT_T) + i] = new_t if first else front_t
    buf[U(tiles.FRONT_S) + i] = s if first else front_s
    buf[U(tiles.FRONT_I) + i] = index if first else front_i

    edge_t = t if (cover < tiles.FULL) & (cover > tiles.FAINT) else FAR
    edge_s, edge_c, edge_i = s, cover, index
    for slot in range(4):
        o = U(slot * N) + i
        old_t, old_s, old_c, old_i = (
            buf[U(tiles.EDGE_T) + o],
            buf[U(tiles.EDGE_S) + o],
            buf[U(tiles.EDGE_C) + o],
            buf[U(tiles.EDGE_I) + o],
        )
        nearer = edge_t < old_t
        buf[U(tiles.EDGE_T) + o] = edge_t if nearer else old_t
        buf[U(tiles.EDGE_S) + o] = edge_s if nearer else old_s
        buf[U(tiles.EDGE_C) + o] = edge_c if nearer else old_c
        buf[U(tiles.EDGE_I) + o] = edge_i if nearer else old_i
        edge_t = old_t if nearer else edge_t
        edge_s = old_s if nearer else edge_s
        edge_c = old_c if nearer else edge_c
        edge_i = old_i if nearer else edge_i


@kernel(fastmath=FLAGS)
def meet_cone(buf, start, stop, index, cone):
    """Let the rays of pixels ``start`` to ``stop`` of a tile meet one rounded cone, and sort that in by distance."""
    mx, my, mz, hx, hy, hz, r, k = cone
    hh = hx * hx + hy * hy + hz * hz
    # One end's sphere holds all others.
    swallowed = hh <= k * k
    open_ = max(hh - k * k, TINY)
    for p in range(stop - start):
        i = U(start) + U(p)
        dx, dy, dz = buf[U(tiles.DX) + i], buf[U(tiles.DY) + i], buf[U(tiles.DZ) + i]
        t0 = mx * dx + my * dy + mz * dz
        px, py, pz = mx - t0 * dx, my - t0 * dy, mz - t0 * dz
        hd = hx * dx + hy * dy + hz * dz
        ph = px * hx + py * hy + pz * hz
        a = max(hh - hd * hd, TINY)
        b = a - k * k
        middle = -ph / a
        d0 = max(px * px + py * py + pz * pz + ph * middle, ZERO)
        # Where the ray comes nearest to the surface, or is deepest in it.
        wider = ONE if k > ZERO else -ONE
        sc = middle + k * math.sqrt(d0 / (a * max(b, TINY)))
        sc = min(max(sc, -ONE), ONE) if b > ZERO else wider
        q = sc - middle
        rc = r + sc * k
        dc = d0 + a * q * q
        gap = math.sqrt(dc) - rc
        per_pixel = ONE / max((t0 + sc * hd) * buf[U(tiles.SPREAD) + i], TINY)
        cover = min(max(HALF - gap * per_pixel, ZERO), ONE) - min(max(HALF - (gap + TWO * rc) * per_pixel, ZERO), ONE)
        # Where it enters first: of the two ways to write the root, the one that takes no difference of equals.
        g = r * k + a * middle
        foot = r + k * middle
        inside = a * foot * foot - b * d0
        root = hd * math.sqrt(max(inside, ZERO) / open_)
        same = g * hd > ZERO
        over = open_ * (g + root) if same else b
        over = over if abs(over) > TINY else (TINY if over >= ZERO else -TINY)
        sh = (g * g - hd * hd * (r * r - d0 - a * middle * middle) if same else g - root) / over
        # Seen from its wider end, an open cone hides behind that.
        sh = wider if swallowed | ((b <= ZERO) & (hd * k <= ZERO)) else min(max(sh, -ONE), ONE)
        q = sh - middle
        rh = r + sh * k
        chord = rh * rh - d0 - a * q * q
        outside = chord < ZERO
        s = sc if outside else sh
        chord = rc * rc - dc if outside else chord
        t = t0 + s * hd - math.sqrt(max(chord, ZERO))
        buf[U(tiles.HIT_T) + i], buf[U(tiles.HIT_S) + i], buf[U(tiles.HIT_C) + i] = (
            t,
            s,
            cover if t > tiles.NEAR else ZERO,
        )
    # Of small cones most rows of pixels meet nothing.
    for row in range(start, stop, 8):
        most = ZERO
        for p in range(8):
            most = max(most, buf[U(tiles.HIT_C) + U(row) + U(p)])
        if most > tiles.FAINT:
            for p in range(8):
                i = U(row) + U(p)
                sort_in(buf, i, index, buf[U(tiles.HIT_T) + i], buf[U(tiles.HIT_S) + i], buf[U(tiles.HIT_C) + i])
