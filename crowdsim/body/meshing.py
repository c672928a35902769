"""From a field to a triangle mesh with edges of a wanted length, cut along lines and thickened behind them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from crowdsim.body.field import Shapes, evaluate
from crowdsim.core.types import Array

_CORNERS = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), axis=-1).reshape(-1, 3)
_EDGES = np.array([(a, b) for a in range(8) for b in range(a + 1, 8) if np.abs(_CORNERS[a] - _CORNERS[b]).sum() == 1])


def surface_nets(values: Array, low: Array, spacing: float) -> tuple[Array, Array]:
    """Return vertices (V, 3) and triangles (F, 3) of where a field on a grid changes its sign, outwards from positive.

    A vertex for each cell that the surface passes (Gibson, Constrained Elastic Surface Nets, 1998), a quad for each
    edge of the grid.
    """
    inside = _unambiguous(values > 0)
    values = np.where(inside & (values <= 0), np.float32(1e-3), values)
    shape = np.array(values.shape)
    corners = sum(inside[x : x + shape[0] - 1, y : y + shape[1] - 1, z : z + shape[2] - 1].astype(np.int8)
                  for x, y, z in _CORNERS)  # fmt: skip
    cells = np.argwhere((corners > 0) & (corners < 8))
    numbers = np.full(shape - 1, -1, np.int64)
    numbers[tuple(cells.T)] = np.arange(len(cells))
    at = [values[tuple((cells + corner).T)].astype(float) for corner in _CORNERS]
    total, count = np.zeros((len(cells), 3)), np.zeros(len(cells))
    for a, b in _EDGES:
        crosses = (at[a] > 0) != (at[b] > 0)
        share = np.where(crosses, at[a] / np.where(crosses, at[a] - at[b], 1.0), 0.0)
        total += crosses[:, None] * (_CORNERS[a] + share[:, None] * (_CORNERS[b] - _CORNERS[a]))
        count += crosses
    vertices = low + spacing * (cells + total / count[:, None])
    quads = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        near, far = [slice(None)] * 3, [slice(None)] * 3
        near[axis], far[axis] = slice(0, -1), slice(1, None)
        first, second = inside[tuple(near)], inside[tuple(far)]
        edges = np.argwhere(first != second)
        forward = first[tuple(edges.T)]
        around = []
        for du, dv in ((0, 0), (1, 0), (1, 1), (0, 1)):
            cell = edges.copy()
            cell[:, u] -= du
            cell[:, v] -= dv
            around.append(numbers[tuple(cell.T)])
        ring = np.stack(around, axis=1)
        quads.append(np.where(forward[:, None], ring, ring[:, ::-1]))
    ring = np.concatenate(quads)
    return vertices, np.concatenate([ring[:, [0, 1, 2]], ring[:, [0, 2, 3]]])


def _unambiguous(inside: Array) -> Array:
    """Fill squares and cubes of the grid of which only opposite corners are inside.

    A surface would touch itself there.
    """
    inside = inside.copy()
    while True:
        found = 0
        for axis in range(3):
            grid = np.moveaxis(inside, axis, 0)
            a, b, c, d = grid[:, :-1, :-1], grid[:, 1:, :-1], grid[:, :-1, 1:], grid[:, 1:, 1:]
            faces = np.argwhere((a == d) & (b == c) & (a != b))
            found += len(faces)
            for u, v in ((0, 0), (1, 0), (0, 1), (1, 1)):
                grid[tuple((faces + np.array([0, u, v])).T)] = True
        for x, y, z in _CORNERS[:4]:
            first = inside[x : x + inside.shape[0] - 1, y : y + inside.shape[1] - 1, z : z + inside.shape[2] - 1]
            total = sum(inside[p : p + first.shape[0], q : q + first.shape[1], r : r + first.shape[2]].astype(np.int8)
                        for p, q, r in _CORNERS)  # fmt: skip
            last = inside[
                1 - x : 1 - x + first.shape[0], 1 - y : 1 - y + first.shape[1], 1 - z : 1 - z + first.shape[2]
            ]
            cells = np.argwhere(((total == 2) & first & last) | ((total == 6) & ~first & ~last))
            found += len(cells)
            for corner in _CORNERS:
                inside[tuple((cells + corner).T)] = True
        if not found:
            return inside


def largest_piece(vertices: Array, triangles: Array) -> tuple[Array, Array]:
    """Return the largest connected piece of a closed mesh, without bubbles inside of it and crumbs beside it.

    Args:
        vertices: Shape (V, 3).
        triangles: Shape (F, 3).
    """
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import connected_components

    edges, count = mesh_edges(triangles), len(vertices)
    links = csr_matrix((np.ones(len(edges), np.int8), (edges[:, 0], edges[:, 1])), (count, count))
    _, pieces = connected_components(links, directed=False)
    kept = pieces == np.argmax(np.bincount(pieces))
    return vertices[kept], (np.cumsum(kept) - 1)[triangles[kept[triangles[:, 0]]]]


def mesh_edges(triangles: Array) -> Array:
    """Return the edges of a closed mesh, each once, the lower vertex first. Shape (E, 2)."""
    # On a closed surface each edge has its lower vertex first in one of its two triangles.
    pairs = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    pairs = pairs[pairs[:, 0] < pairs[:, 1]]
    return pairs[np.argsort(pairs[:, 0] * (int(triangles.max()) + 1) + pairs[:, 1])]


def vertex_normals(vertices: Array, triangles: Array) -> Array:
    """Return unit normals of vertices, faces weighted by area. Shape (V, 3)."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    faces = np.cross(b - a, c - a)
    total = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(total, triangles[:, k], faces)
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12)


def relax(shapes: Shapes, vertices: Array, triangles: Array, rounds: int, share: float = 0.5) -> Array:
    """Return vertices spread evenly along the surface of a field and put on it."""
    edges = mesh_edges(triangles)
    degree = np.bincount(edges.ravel(), minlength=len(vertices))[:, None]
    for _ in range(rounds):
        mean = np.zeros_like(vertices)
        np.add.at(mean, edges[:, 0], vertices[edges[:, 1]])
        np.add.at(mean, edges[:, 1], vertices[edges[:, 0]])
        move = share * (mean / degree - vertices)
        normals = vertex_normals(vertices, triangles)
        vertices = vertices + move - normals * np.sum(move * normals, axis=1, keepdims=True)
        gap, slope = evaluate(shapes, vertices)
        vertices = vertices - np.clip(gap, -0.004, 0.004)[:, None] * slope
    return vertices


def refine(vertices: Array, triangles: Array, wanted: Callable[[Array], Array]) -> tuple[Array, Array]:
    """Halve edges that are longer than wanted by half.

    Args:
        vertices: Shape (V, 3).
        triangles: Shape (F, 3).
        wanted: Returns wanted lengths of edges at points (n, 3).
    """
    edges, count = mesh_edges(triangles), len(vertices)
    ends = vertices[edges]
    long = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) > 1.5 * wanted(ends.mean(axis=1))
    keys = edges[long, 0] * count + edges[long, 1]
    vertices = np.concatenate([vertices, ends[long].mean(axis=1)])
    low, high = (function(triangles, np.roll(triangles, -1, axis=1)) for function in (np.minimum, np.maximum))
    found = np.minimum(np.searchsorted(keys, low * count + high), max(len(keys) - 1, 0))
    halved = keys[found] == low * count + high if len(keys) else np.zeros(triangles.shape, bool)
    middles = np.where(halved, count + found, -1)
    number = halved.sum(axis=1)
    pieces = [triangles[number == 0]]
    # Corners and middles, turned so that the halved edge is the first, or the whole one the last.
    for halves in (1, 2):
        rows = np.flatnonzero(number == halves)
        first = np.argmax(halved[rows], axis=1) if halves == 1 else (np.argmin(halved[rows], axis=1) + 1) % 3
        turn = (first[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(triangles[rows], turn, axis=1).T
        m, n, _ = np.take_along_axis(middles[rows], turn, axis=1).T
        pieces += ([np.stack([a, m, c], 1), np.stack([m, b, c], 1)] if halves == 1 else
                   [np.stack([m, b, n], 1), np.stack([a, m, n], 1), np.stack([a, n, c], 1)])  # fmt: skip
    (a, b, c), (m, n, o) = triangles[number == 3].T, middles[number == 3].T
    pieces += [np.stack(corners, 1) for corners in ((a, m, o), (m, b, n), (o, n, c), (m, n, o))]
    return vertices, np.concatenate(pieces)


def thin(vertices: Array, triangles: Array, wanted: Callable[[Array], Array]) -> tuple[Array, Array]:
    """Collapse edges that are shorter than wanted, the shortest first, many at once.

    Args:
        vertices: Shape (V, 3).
        triangles: Shape (F, 3).
        wanted: Returns wanted lengths of edges at points (n, 3).
    """
    random = np.random.default_rng(0)
    for limit in np.append(np.linspace(0.45, 0.8, 16), np.full(24, 0.8)):
        edges = mesh_edges(triangles)
        count = len(vertices)
        ends = vertices[edges]
        cost = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) / wanted(ends.mean(axis=1))
        # Edges in an order of their own, of which each is chosen that is the first around all its neighbours.
        ranks = np.full(len(edges), len(edges))
        short = np.flatnonzero(cost < limit)
        ranks[random.permutation(short)] = np.arange(len(short))
        least = np.full(count, len(edges))
        for k in range(2):
            np.minimum.at(least, edges[:, k], ranks)
        around = least.copy()
        for k in range(2):
            np.minimum.at(around, edges[:, k], least[edges[:, 1 - k]])
        chosen = short[(around[edges[short, 0]] == ranks[short]) & (around[edges[short, 1]] == ranks[short])]
        done = edges[chosen[_collapsible(vertices, triangles, edges, chosen)]]
        if limit == 0.8 and 200 * len(done) < count:
            break
        target = np.arange(count)
        target[done[:, 1]] = done[:, 0]
        moved = vertices.copy()
        moved[done[:, 0]] = 0.5 * (vertices[done[:, 0]] + vertices[done[:, 1]])
        triangles = target[triangles]
        a, b, c = triangles.T
        kept, packed = np.unique(triangles[(a != b) & (b != c) & (c != a)], return_inverse=True)
        vertices, triangles = moved[kept], packed.reshape(-1, 3)
    return vertices, triangles


def _collapsible(vertices: Array, triangles: Array, edges: Array, chosen: Array) -> Array:
    """Which edges leave a surface without folds: exactly two common neighbours, and no triangle that turns over.

    No two of the chosen edges are neighbours, so that each triangle changes with one of them at most.
    """
    from scipy.sparse import csr_matrix

    count = len(vertices)
    a, b = edges[chosen].T
    links = csr_matrix((np.ones(2 * len(edges), np.int32), (edges.ravel(), edges[:, ::-1].ravel())), (count, count))
    common = np.asarray(links[a].multiply(links[b]).sum(axis=1)).ravel()
    degree = np.asarray(links.sum(axis=1)).ravel()
    owner = np.full(count, -1)
    owner[a] = owner[b] = np.arange(len(chosen))
    middle = vertices.copy()
    middle[a] = middle[b] = 0.5 * (vertices[a] + vertices[b])
    theirs = owner[triangles]
    touched = (theirs >= 0).sum(axis=1) == 1
    before, after = vertices[triangles[touched]], middle[triangles[touched]]
    turned = [np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]) for corner in (before, after)]
    lengths = np.linalg.norm(turned[0], axis=1) * np.linalg.norm(turned[1], axis=1)
    folds = np.sum(turned[0] * turned[1], axis=1) < 0.3 * lengths
    good = (common == 2) & (degree[a] + degree[b] <= 16)
    good[theirs[touched][folds].max(axis=1)] = False
    return good


def cut(
    vertices: Array, triangles: Array, numbers: Array, values: Array, snap: float = 0.25
) -> tuple[Array, Array, Array, Array]:
    """Split triangles where values of vertices change their sign, so that a line of edges runs there.

    Args:
        vertices: Shape (V, 3).
        triangles: Shape (F, 3).
        numbers: A number of each triangle, which its pieces inherit. Shape (F,).
        values: Shape (V,); a line runs where they are 0.
        snap: Vertices that are nearer to the line than this share of an edge are moved onto it.

    Returns:
        Vertices, those beyond the first V on the line; triangles; their numbers; and which lie where values are
        positive.
    """
    edges = mesh_edges(triangles)
    vertices, values = vertices.copy(), np.where(np.abs(values) < 1e-9, 1e-9, values)
    a, b = values[edges[:, 0]], values[edges[:, 1]]
    crosses = (a > 0) != (b > 0)
    share = np.where(crosses, a / np.where(crosses, a - b, 1.0), 0.0)
    moves, goals = np.full(len(vertices), snap), vertices.copy()
    for end in range(2):
        near = np.where(crosses, share if end == 0 else 1.0 - share, 1.0)
        order = np.argsort(-near, kind="stable")
        order = order[near[order] < moves[edges[order, end]]]
        # The nearest comes last and stays.
        moves[edges[order, end]] = near[order]
        goals[edges[order, end]] = (
            vertices[edges[:, 0]] + share[:, None] * (vertices[edges[:, 1]] - vertices[edges[:, 0]])
        )[order]
    on = moves < snap
    vertices[on], values[on] = goals[on], 0.0
    a, b = values[edges[:, 0]], values[edges[:, 1]]
    split = np.flatnonzero(a * b < 0)
    count = len(vertices)
    share = a[split] / (a[split] - b[split])
    ends = edges[split]
    vertices = np.concatenate(
        [vertices, vertices[ends[:, 0]] + share[:, None] * (vertices[ends[:, 1]] - vertices[ends[:, 0]])]
    )
    values = np.concatenate([values, np.zeros(len(split))])
    middles = {(int(x), int(y)): count + number for number, (x, y) in enumerate(ends)}
    plain = np.ones(len(triangles), bool)
    added: list[list[int]] = []
    heirs: list[int] = []
    for number in np.flatnonzero(np.ptp(np.sign(values[triangles]), axis=1) == 2):
        corners = [int(v) for v in triangles[number]]
        ring: list[int] = []
        for k in range(3):
            u, v = corners[k], corners[(k + 1) % 3]
            ring.append(u)
            middle = middles.get((min(u, v), max(u, v)))
            if middle is not None:
                ring.append(middle)
        plain[number] = False
        pieces = _split_ring(ring, vertices, values)
        added += pieces
        heirs += [numbers[number]] * len(pieces)
    numbers = np.concatenate([numbers[plain], np.array(heirs, np.int64)])
    triangles = np.concatenate([triangles[plain], np.array(added, np.int64).reshape(-1, 3)])
    return vertices, triangles, numbers, values[triangles].sum(axis=1) > 0


def _split_ring(ring: list[int], vertices: Array, values: Array) -> list[list[int]]:
    """Triangles of a polygon, parted by its vertices on the line."""
    zero = [k for k, v in enumerate(ring) if values[v] == 0.0]
    first, last = zero[0], zero[-1]
    parts = [ring[first : last + 1], ring[last:] + ring[: first + 1]]
    result = []
    for part in parts:
        if len(part) == 3:
            result.append(part)
        elif len(part) == 4:
            across = [np.linalg.norm(vertices[part[k]] - vertices[part[k + 2]]) for k in range(2)]
            result += ([[part[0], part[1], part[2]], [part[0], part[2], part[3]]] if across[0] < across[1]
                       else [[part[1], part[2], part[3]], [part[1], part[3], part[0]]])  # fmt: skip
    return result


def unpinched(triangles: Array, part: Array) -> Array:
    """Return a part with the triangles around vertices at which it touches itself. Shape (F,), bool."""
    count, part = int(triangles.max()) + 1, part.copy()
    while True:
        directed = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
        ours = np.repeat(part, 3)
        keys = directed[:, 0] * count + directed[:, 1]
        border = ours & np.isin(directed[:, 1] * count + directed[:, 0], keys[~ours])
        pinched = np.bincount(directed[border, 0], minlength=count) > 1
        if not pinched.any():
            return part
        part |= pinched[triangles].any(axis=1)


def thicken(vertices: Array, triangles: Array, part: Array, moves: Array) -> tuple[Array, Array, Array, Array]:
    """Raise a part of a surface, with a rim around it, so that the whole stays closed.

    Args:
        vertices: Shape (V, 3).
        triangles: Shape (F, 3).
        part: Which triangles are raised. Shape (F,), bool.
        moves: Where each vertex goes [m]. Shape (V, 3).

    Returns:
        Vertices, triangles, the triangle of the part that each triangle of the rim hangs on, and the vertex that each
        vertex beyond the first V was.
    """
    directed = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    owner = np.repeat(np.arange(len(triangles)), 3)
    ours, others = part[owner], ~part[owner]
    count = len(vertices)
    keys = directed[:, 0] * count + directed[:, 1]
    border = ours & np.isin(directed[:, 1] * count + directed[:, 0], keys[others])
    line = np.unique(directed[border])
    copies = np.arange(count)
    copies[line] = count + np.arange(len(line))
    inside = np.unique(triangles[part])
    raised = vertices.copy()
    raised[inside] += moves[inside]
    vertices = np.concatenate([raised, raised[line]])
    vertices[line] -= moves[line]
    triangles = triangles.copy()
    triangles[part] = copies[triangles[part]]
    a, b = directed[border].T
    rim = np.concatenate([np.stack([copies[b], copies[a], a], axis=1), np.stack([copies[b], a, b], axis=1)])
    return vertices, np.concatenate([triangles, rim]), np.tile(owner[border], 2), line
