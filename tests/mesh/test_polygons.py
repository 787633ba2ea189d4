"""Polygons as triangles, against shapely's area and Blender's triangles."""

import numpy as np
import pytest
import shapely

from palpate.mesh.polygons import strip_triangles, triangulate, with_holes
from tests.mesh.reading import by_blender


def star(rng, straight: bool) -> np.ndarray:
    """A polygon around the origin, mostly concave; straight: with a corner in the middle of each side, too."""
    turn = np.sort(rng.random(rng.integers(4, 30))) * 2 * np.pi
    flat = np.stack([np.cos(turn), np.sin(turn)], axis=1) * rng.uniform(0.1, 1, len(turn))[:, None]
    middle = (flat + np.roll(flat, -1, axis=0)) / 2
    return np.stack([flat, middle], axis=1).reshape(-1, 2) if straight else flat


def comb(teeth: int) -> np.ndarray:
    x = np.arange(2 * teeth)
    return np.r_[[(0, 0), (2 * teeth - 1, 0)], np.stack([x, np.where(x % 2, 0.1, 1)], axis=1)[::-1]]


def spiral(count: int) -> np.ndarray:
    turn = np.linspace(0, 6 * np.pi, count)
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return np.r_[ring * (1 + turn)[:, None], (ring * (0.2 + turn)[:, None])[::-1]]


def polygons() -> list[np.ndarray]:
    rng = np.random.default_rng(5)
    flat = [star(rng, straight=bool(k % 2)) for k in range(200)] + [comb(k) for k in range(2, 9)]
    flat += [spiral(20), spiral(200), np.array([(0, 0), (1, 0), (2, 0), (2, 1), (0, 1)])]
    return [polygon[:: 1 if k % 3 else -1] for k, polygon in enumerate(flat) if shapely.Polygon(polygon).is_valid]


def in_space(flat, rng):
    """Corners (n, 3) of a flat polygon, turned, scaled and moved at random."""
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return 10.0 ** rng.uniform(-4, 4) * (np.pad(flat, ((0, 0), (0, 1))) @ turn.T + rng.normal(size=3))


def areas(corner):
    cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    return cross / 2 if corner.shape[2] == 2 else np.linalg.norm(cross, axis=1) / 2


def test_triangles_cover_a_polygon_once_and_keep_its_outline():
    rng = np.random.default_rng(6)
    flat = polygons()
    assert len(flat) > 150
    counts = np.array([len(polygon) for polygon in flat])
    vertices = np.concatenate([in_space(polygon, rng) for polygon in flat])
    triangles, owner = triangulate(vertices, np.arange(len(vertices)), counts)
    assert (np.diff(owner) >= 0).all() and np.bincount(owner).tolist() == (counts - 2).tolist()
    for number, (polygon, first) in enumerate(zip(flat, np.cumsum(counts) - counts, strict=True)):
        mine = triangles[owner == number] - first
        signed = areas(polygon[mine])
        side = 1 if shapely.LinearRing(polygon).is_ccw else -1
        assert (side * signed > -1e-9).all()  # wound as the polygon, none outside it
        assert signed.sum() == pytest.approx(side * shapely.Polygon(polygon).area)
        edges = {(int(a), int(b)) for corners in mine for a, b in zip(corners, np.roll(corners, -1), strict=True)}
        assert {(k, (k + 1) % len(polygon)) for k in range(len(polygon))} <= edges


def test_convex_polygons_are_fans_from_their_first_corner():
    turn = np.arange(6) * np.pi / 3
    hexagon = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    triangles, _ = triangulate(hexagon, np.arange(6), [6])
    assert triangles.tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]


def test_keyholes_and_holes():
    """A square with two square holes: by a slit to each, and as rings wound either way."""
    square, hole = np.array([(0, 0), (10, 0), (10, 10), (0, 10)]), np.array([(0, 0), (0, 1), (1, 1), (1, 0)])
    holes = [hole + (1, 1), hole + (7, 7)]
    slit = np.r_[square[:1], holes[0], holes[0][:1], square[:1], square[1:3], holes[1][[2, 3, 0, 1, 2]], square[2:]]
    triangles, _ = triangulate(np.pad(slit, ((0, 0), (0, 1))).astype(float), np.arange(len(slit)), [len(slit)])
    assert areas(slit[triangles]).sum() == pytest.approx(98) and (areas(slit[triangles]) > -1e-9).all()
    whole = shapely.Polygon(square, holes)
    for rings in ([square, *holes], [square[::-1], holes[0][::-1], holes[1]]):
        corners = np.concatenate(rings)
        made = corners[with_holes([in_space_of(ring) for ring in rings])]
        assert np.abs(areas(made)).sum() == pytest.approx(98)
        assert len(set(np.sign(areas(made)))) == 1 and np.sign(areas(made)[0]) == (1 if rings[0] is square else -1)
        assert all(whole.contains(shapely.Polygon(triangle).representative_point()) for triangle in made)


def in_space_of(ring):
    return np.pad(ring, ((0, 0), (0, 1))) @ np.linalg.qr(np.arange(9.0).reshape(3, 3) ** 2 + np.eye(3))[0].T * 0.01


def test_polygons_without_an_area_and_of_vertices_that_are_not_finite():
    vertices = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (np.nan, 0, 0), (0, np.inf, 0)])
    for corners in ([0, 0, 0, 0], [0, 1, 2, 2], [0, 1, 0, 1, 0], [0, 1, 4, 3], [5, 0, 1, 2, 3]):
        triangles, _ = triangulate(vertices, np.array(corners), [len(corners)])
        assert triangles.shape == (len(corners) - 2, 3)
    triangles, owner = triangulate(vertices, np.array([0, 0, 1, 0, 1, 2]), [1, 2, 3])
    assert triangles.tolist() == [[3, 4, 5]] and owner.tolist() == [2]
    assert len(triangulate(vertices, np.zeros(0, int), [])[0]) == 0


def test_strips_and_fans_of_one_list():
    """Wound as OpenGL has them, against a loop; -1 ends a strip, and triangles without an area are left out."""
    rng = np.random.default_rng(8)
    counts = np.array([0, 5, 1, 9, 2, 3, 40])
    corners = rng.permutation(counts.sum()) + 1
    for fan in (False, True):
        triangles, owner = strip_triangles(corners, counts, fan)
        expected = []
        for number, start in enumerate(np.cumsum(counts) - counts):
            strip = corners[start : start + counts[number]].tolist()
            for k in range(len(strip) - 2):
                corner = (strip[0], *strip[k + 1 : k + 3]) if fan else tuple(strip[k : k + 3][:: -1 if k % 2 else 1])
                expected.append((number, corner))
        turned = [tuple(np.roll(row, -int(np.argmin(row)))) for row in corners[triangles]]
        least = [tuple(np.roll(row, -int(np.argmin(row)))) for _, row in expected]
        assert turned == least and owner.tolist() == [number for number, _ in expected]
    separated = strip_triangles([1, 2, 3, 4, -1, 5, 6, 7, 7, 8, -1, -1], [12])[0]
    assert separated.tolist() == [[0, 1, 2], [2, 1, 3], [5, 6, 7]]


def test_as_blender_cuts_them(tmp_path):
    """Flat polygons, and quads that are folded, for which it matters which way."""
    rng = np.random.default_rng(7)
    flat = [np.pad(polygon, ((0, 0), (0, 1))) for polygon in polygons()]
    folded = [np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]) + rng.normal(0, 0.3, (4, 3)) for _ in range(300)]
    counts = np.array([len(polygon) for polygon in flat + folded])
    vertices = np.round(np.concatenate(flat + folded), 6).astype(np.float32).astype(float)
    lines = ["v {:.9g} {:.9g} {:.9g}".format(*vertex) for vertex in vertices]
    starts = np.cumsum(counts) - counts
    lines += ["f " + " ".join(str(start + k + 1) for k in range(n)) for start, n in zip(starts, counts, strict=True)]
    (tmp_path / "a.obj").write_text("\n".join(lines) + "\n")
    (blender,) = by_blender(tmp_path / "a.obj")
    expected = np.bincount(np.repeat(np.arange(len(counts)), counts - 2), areas(blender["triangles"]))
    triangles, owner = triangulate(vertices, np.arange(len(vertices)), counts)
    made = np.bincount(owner, areas(vertices[triangles]))
    different = np.abs(made - expected) > 1e-5
    assert not different[: len(flat)].any()
    # Of quads bent by more than a right angle whichever way they are cut, either way is as good.
    assert different[len(flat) :].mean() < 0.05
