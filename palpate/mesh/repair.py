"""Repairs that can't change an object's shape: faces to drop, faces to turn, vertices to merge."""

from typing import NamedTuple

import igl
import numpy as np
from trimesh import Trimesh
from trimesh.ray.ray_pyembree import RayMeshIntersector

from palpate.mesh import topology
from palpate.mesh.part import distinct

# Vertices closer than this share of the bounding box's diagonal are one; a thinner triangle has no area. Single
# precision, in which most formats store, resolves about 1e-7 of it.
TOLERANCE = 1e-6
ROUNDING = 1e-3  # of the tolerance: coordinates that differ by less differ by rounding
VISIBILITY_MARGIN = 0.05  # share of the rays by which more escape from an open sheet's back than its front to turn it


class Repaired(NamedTuple):
    """Result for f source faces."""

    vertices: np.ndarray  # (m, 3) merged
    faces: np.ndarray  # (f, 3) into them, in final winding
    keep: np.ndarray  # (f,) bool: which source faces stay
    flip: np.ndarray  # (f,) bool: which were turned
    counts: dict[str, int]


def repair(vertices: np.ndarray, faces: np.ndarray, part: np.ndarray) -> Repaired:
    """Merge vertices (n, 3), find faces (f, 3) to drop and faces to turn; part (f,): the number of each face's part. A
    part's closed shells keep their vertices for themselves, so that solids which merely touch stay solids. Of faces
    with the same three vertices one is kept: the first that faces as the repaired surface does, else the first."""
    used = np.unique(faces)
    tolerance = float(TOLERANCE * np.linalg.norm(np.ptp(vertices[used], axis=0)))
    merged, first, behind = _weld(vertices, faces, part, tolerance)
    corners, flat = vertices[first], _collapsed(merged)
    keep = ~flat & ~behind
    doubled = _doubled(vertices, faces, merged, keep, tolerance)
    keep &= ~doubled
    thin = _droppable(corners, merged, keep, tolerance)
    keep &= ~thin
    flip = np.zeros(len(faces), dtype=bool)
    if keep.any():
        flip[keep] = _turned(corners, merged[keep])
    inner, outer = _outsides(merged, np.flatnonzero(keep & flip), np.flatnonzero(doubled))
    keep[inner], keep[outer], flip[inner] = False, True, False
    merged = np.where(flip[:, None], merged[:, ::-1], merged)
    counts = {
        "stray_vertices_removed": len(vertices) - len(used),
        "vertices_merged": len(used) - len(first),
        "duplicate_faces_removed": int((doubled | behind).sum()),
        "zero_area_faces_removed": int(flat.sum() + thin.sum()),
        "faces_turned": int(flip.sum()),
    }
    return Repaired(corners, merged, keep, flip, counts)


def _weld(
    vertices: np.ndarray, faces: np.ndarray, part: np.ndarray, tolerance: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Faces (f, 3) in merged vertices, the source vertex (m,) of each, and faces (f,) bool of shells' backs."""
    corner = faces.ravel()
    low = vertices[corner].min(axis=0)
    # Within the bounding box there are at most 1 / TOLERANCE = 2^20 cells an axis: three fit into 63 bits.
    cell = np.rint((vertices[corner] - low) / max(tolerance, np.finfo(float).tiny)).astype(np.int64)
    place = np.unique(cell[:, 0] << 42 | cell[:, 1] << 21 | cell[:, 2], return_inverse=True)[1]
    parts = int(part.max()) + 1
    own = np.unique(place * parts + np.repeat(part, 3), return_inverse=True)[1].reshape(-1, 3)

    proper = ~_collapsed(own)
    owner, behind = np.zeros(len(faces), dtype=np.int64), np.zeros(len(faces), dtype=bool)
    if proper.any():
        shell = topology.shells(own[proper], int(own.max()) + 1)
        closed = topology.closed_groups(own[proper], shell)
        if parts > 1 and closed.any():
            at = place.reshape(-1, 3)[proper]
            back = _backs(vertices[faces[proper]], at, shell, closed)
            behind[proper] = back[shell]
            closed &= ~_shared(at, shell, closed, back)
        owner[proper] = np.where(closed[shell], part[proper] + 1, 0)
    key = place * (parts + 1) + np.repeat(owner, 3)
    _, first, merged = np.unique(key, return_index=True, return_inverse=True)
    return merged.reshape(-1, 3), corner[first], behind


def _backs(triangles: np.ndarray, place: np.ndarray, shell: np.ndarray, closed: np.ndarray) -> np.ndarray:
    """Closed shells (s,) bool to drop because another is at the same place: of two the one that is inside out, or the
    later if they face the same way. Two are at the same place if their corners are and their areas are equal, however
    they are triangulated. triangles (f, 3, 3): corners of the faces; place (f, 3): the same, by number."""
    area = np.bincount(shell, np.linalg.norm(topology.cross(triangles), axis=1))
    volume = np.bincount(shell, np.einsum("ij,ij->i", triangles[:, 0] - triangles[0, 0], topology.cross(triangles)))
    size = int(place.max()) + 1
    corner_shell, corner = np.divmod(np.unique(np.repeat(shell, 3) * size + place.ravel()), size)
    start = np.searchsorted(corner_shell, np.arange(len(closed) + 1))
    back = np.zeros(len(closed), dtype=bool)
    at: dict[bytes, int] = {}  # the shell with these corners
    for number in np.flatnonzero(closed):
        corners = corner[start[number] : start[number + 1]].tobytes()
        other = at.setdefault(corners, number)
        if other != number and abs(area[other] - area[number]) < 1e-6 * area[number]:
            at[corners] = number if volume[other] < 0 < volume[number] else other
            back[[number, other]] = True
            back[at[corners]] = False
    return back


def _shared(place: np.ndarray, shell: np.ndarray, closed: np.ndarray, back: np.ndarray) -> np.ndarray:
    """Closed shells (s,) bool with a face where an open one has one, and such open ones: they are to be merged."""
    _, triple = distinct(*np.sort(place, axis=1).T)
    front = ~back[shell]
    of_open, of_closed = (np.isin(triple, triple[front & (closed[shell] == kind)]) for kind in (False, True))
    return np.bincount(shell, weights=front & of_open & of_closed, minlength=len(closed)) > 0


def _collapsed(faces: np.ndarray) -> np.ndarray:
    """Faces (f,) bool that name a vertex twice."""
    return (faces == np.roll(faces, 1, axis=1)).any(axis=1)


def _doubled(
    vertices: np.ndarray, faces: np.ndarray, merged: np.ndarray, among: np.ndarray, tolerance: float
) -> np.ndarray:
    """Faces (f,) bool to drop of those `among` that have the same three merged vertices, in any order: of each set all
    but the earliest; and that too if the set is a fold without which its shell has no border."""
    index = np.flatnonzero(among)
    first, number = distinct(*np.sort(merged[index], axis=1).T)
    doubled = among.copy()
    doubled[index[first]] = False
    two = np.flatnonzero((np.bincount(number) == 2)[number])
    pairs = index[two[np.argsort(number[two], kind="stable")].reshape(-1, 2)]
    folds = pairs[_folded(vertices, faces[pairs], merged[pairs], tolerance), 0]
    if not len(folds):
        return doubled
    kept = among & ~doubled
    shell = np.zeros(len(faces), dtype=np.int64)
    shell[kept] = topology.shells(merged[kept], int(merged.max()) + 1)
    without = kept.copy()
    without[folds] = False
    count = int(shell.max()) + 1
    rest = np.bincount(shell[without], minlength=count)
    closing = (_border(merged[kept], shell[kept], count) > 0) & (rest > 0)
    closing &= _border(merged[without], shell[without], count) == 0
    doubled[folds] = closing[shell[folds]]
    return doubled


def _outsides(merged: np.ndarray, turned: np.ndarray, doubled: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Turned faces to which one of the doubled is opposite, and the first of these: it has been facing out."""
    rows = np.r_[merged[turned][:, ::-1], merged[doubled]]
    from_least = (rows.argmin(axis=1)[:, None] + np.arange(3)) % 3
    row = np.unique(np.take_along_axis(rows, from_least, axis=1), axis=0, return_inverse=True)[1].ravel()
    _, one, other = np.intersect1d(row[: len(turned)], row[len(turned) :], return_indices=True)
    return turned[one], doubled[other]


def _folded(vertices: np.ndarray, faces: np.ndarray, merged: np.ndarray, tolerance: float) -> np.ndarray:
    """Pairs of faces (k, 2, 3), sides of a welded sliver: opposite ways around merged vertices, apart before."""
    a, b, c = np.moveaxis(merged, 2, 0)
    way = (a > b) ^ (b > c) ^ (a > c)
    order = np.argsort(merged, axis=2, kind="stable")
    place = vertices[np.take_along_axis(faces, order, axis=2)]
    apart = np.abs(place[:, 0] - place[:, 1]).max(axis=(1, 2), initial=0)
    return (way[:, 0] != way[:, 1]) & (apart > ROUNDING * tolerance)


def _border(faces: np.ndarray, group: np.ndarray, count: int) -> np.ndarray:
    """How many edges of faces have an odd number of their group's faces: (count,)."""
    odd = topology.edge_counts(faces, group).reshape(-1, 3) % 2
    return np.bincount(group, weights=odd.sum(axis=1), minlength=count)


def _droppable(vertices: np.ndarray, faces: np.ndarray, keep: np.ndarray, tolerance: float) -> np.ndarray:
    """Faces (f,) bool thinner than the tolerance, unless that opens a closed surface: one may close a crack."""
    longest = np.linalg.norm(vertices[np.roll(faces, -1, axis=1)] - vertices[faces], axis=2).max(axis=1)
    height = np.linalg.norm(topology.cross(vertices[faces]), axis=1) / np.maximum(longest, 1e-300)
    thin = keep & (height <= tolerance)
    if not thin.any():
        return thin
    shell = np.zeros(len(faces), dtype=np.int64)
    shell[keep] = topology.shells(faces[keep], len(vertices))
    closed = topology.closed_groups(faces[keep], shell[keep])
    flat = np.bincount(shell[keep], weights=~thin[keep]) == 0  # nothing but thin faces: no shell worth keeping
    return thin & (~closed | flat)[shell]


def _turned(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Which faces (f,) bool to turn for a consistent winding that faces outwards."""
    oriented, patch = igl.bfs_orient(np.ascontiguousarray(faces, dtype=np.int64))
    turned = ~np.any([(np.roll(oriented, shift, axis=1) == faces).all(axis=1) for shift in range(3)], axis=0)
    minority = np.bincount(patch, weights=turned) <= np.bincount(patch) / 2
    turned ^= ~minority[patch]  # as few as possible
    current = np.where(turned[:, None], faces[:, ::-1], faces)
    closed = topology.closed_groups(current, patch)
    wrong = closed & _inside_out(vertices, current, patch, closed)
    if not closed.all():
        wrong |= ~closed & _seen_from_behind(vertices, current, patch, ~closed)
    return turned ^ wrong[patch]


def _inside_out(vertices: np.ndarray, faces: np.ndarray, patch: np.ndarray, closed: np.ndarray) -> np.ndarray:
    """Closed patches (p,) bool to turn: those whose outermost enclosing closed patch has negative volume. A void inside
    a solid then still faces its hollow; a solid that is inside out is turned with all in it."""
    origin = vertices.mean(axis=0)
    corner = vertices[faces] - origin
    volume = np.bincount(patch, weights=np.einsum("ij,ij->i", corner[:, 0], topology.cross(corner)))
    negative = closed & (volume < 0)
    if not negative.any():
        return negative
    order = np.argsort(patch, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(patch[order])) + 1)
    low = np.array([corner[group].min(axis=(0, 1)) for group in groups])
    high = np.array([corner[group].max(axis=(0, 1)) for group in groups])
    extent = np.linalg.norm(high - low, axis=1)
    wrong = negative.copy()
    for this in np.flatnonzero(closed):
        around = closed & (low <= low[this]).all(axis=1) & (high >= high[this]).all(axis=1) & (extent > extent[this])
        point = corner[groups[this][0], :1]
        for other in sorted(np.flatnonzero(around), key=lambda number: -extent[number]):
            shell = faces[groups[other]].astype(np.int64)
            if abs(igl.winding_number(vertices - origin, shell, point)[0]) > 0.5:
                wrong[this] = negative[other]
                break
    return wrong


def _seen_from_behind(vertices: np.ndarray, faces: np.ndarray, patch: np.ndarray, candidates: np.ndarray) -> np.ndarray:
    """Patches (p,) bool among the candidates of whose backs more rays escape than of their fronts: 8 a side from the
    centres of up to 16 faces (after Takayama et al. 2014, A Simple Method for Correcting Facet Orientations)."""
    index = np.flatnonzero(candidates[patch])
    index = index[np.argsort(patch[index], kind="stable")]
    rank = np.arange(len(index)) - np.searchsorted(patch[index], patch[index])
    length = np.bincount(patch)[patch[index]]
    chosen = index[rank * 16 // length != (rank - 1) * 16 // length]
    shooter = RayMeshIntersector(Trimesh(vertices, faces, process=False, validate=False))
    corner = vertices[faces[chosen]]
    normal, centre = topology.cross(corner), corner.mean(axis=1)
    area = np.linalg.norm(normal, axis=1)
    normal /= np.maximum(area, 1e-300)[:, None]
    offset = 1e-4 * np.linalg.norm(np.ptp(vertices, axis=0))
    escaped = []
    for side in (normal, -normal):
        tangent = np.cross(side, np.eye(3)[np.abs(side).argmin(axis=1)])
        tangent /= np.maximum(np.linalg.norm(tangent, axis=1), 1e-300)[:, None]
        other, free = np.cross(side, tangent), np.zeros(len(chosen))
        for k in range(8):
            turn, tilt = 2 * np.pi * k / 8, np.deg2rad((15, 40, 65, 80)[k % 4])
            direction = np.cos(tilt) * side + np.sin(tilt) * (np.cos(turn) * tangent + np.sin(turn) * other)
            free += ~shooter.intersects_any(centre + offset * side, direction)
        escaped.append(np.bincount(patch[chosen], weights=free * area, minlength=len(candidates)))
    total = 8 * np.bincount(patch[chosen], weights=area, minlength=len(candidates))
    return escaped[1] - escaped[0] > VISIBILITY_MARGIN * total
