"""Depth maps by ray casting: Embree names the face, double precision says where it is hit."""

import numpy as np

from palpate.touch.sensor import PIXEL, SENSOR_PLANE, SENSOR_RANGE
from palpate.touch.tracing import Block, Tracer

# How much further than the range Embree looks: more than its rounding, so that double precision decides.
_SLACK = 1e-5
# Sine of the angle between a face and the rays, below which the plane of the face says too little about the
# depth: moving the ray by Embree's rounding error (3e-8 m) then moves the hit by over 3e-6 m.
_EDGE_ON = 1e-2
# Rounding errors in metres: of Embree's rays, and of positions in double precision.
_SINGLE_ROUNDING = 2e-7
_DOUBLE_ROUNDING = 1e-12
# Sine of the angle below which a face covers no pixel: seen from the sensor, it is narrower than Embree's
# rounding.
_NO_WIDTH = 1e-6


class RayCaster(Tracer):
    """Depth maps by Embree. The default: exact to about 1e-7 m, and the fastest (see docs/touch.md).

    Embree's single precision may name a face seen edge-on that the ray passes by, or let a ray slip through a
    vertex. Such pixels are found out and decided in double precision against every face in range.
    """

    def _depth(self, origin, rotation, block: Block) -> np.ndarray:
        plane = SENSOR_PLANE[block]
        pixels = plane.reshape(-1, 3)
        start = pixels @ rotation.T + origin
        hit = self._scene.first_face(start, rotation[:, 0][None], SENSOR_RANGE + _SLACK)
        depth = np.full(len(pixels), np.inf)
        doubtful = np.zeros(len(pixels), dtype=bool)
        felt = np.flatnonzero(hit >= 0)
        if len(felt):
            depth[felt], doubtful[felt] = self._depth_on_faces(hit[felt], pixels[felt, 1:], origin, rotation)
            doubtful |= _pits(depth.reshape(plane.shape[:2])).ravel()
        settled = np.zeros(len(pixels), dtype=bool)
        while doubtful.any():
            depth[doubtful] = np.minimum(
                depth[doubtful], self._exact_depth(pixels[doubtful, 1:], origin, rotation)
            )
            settled |= doubtful
            # One pit may have hidden the next.
            doubtful = _pits(depth.reshape(plane.shape[:2])).ravel() & ~settled
        return depth.reshape(plane.shape[:2])

    def _depth_on_faces(self, hit, pixels, origin, rotation) -> tuple[np.ndarray, np.ndarray]:
        """Depth at which the rays through `pixels` (n, 2), y and z, meet the faces `hit` (n,).

        Returns (n,) depth and (n,) bool, whether the ray in fact misses the face; the depth is then +inf.
        """
        seen = np.zeros(len(self._scene.triangles), dtype=bool)
        seen[hit] = True
        faces = np.flatnonzero(seen)
        index = np.empty(len(seen), dtype=np.intp)
        index[faces] = np.arange(len(faces))
        hit = index[hit]

        corners, normal = self._in_sensor_frame(faces, origin, rotation)
        offset, slope = _planes(corners, normal)
        depth = offset[hit] + pixels[:, 0] * slope[hit, 0] + pixels[:, 1] * slope[hit, 1]
        # A ray may pass the edge of its face at Embree's rounding distance: stay on the face.
        nearest, furthest = corners[:, :, 0].min(axis=1)[hit], corners[:, :, 0].max(axis=1)[hit]
        missed = np.zeros(len(hit), dtype=bool)
        grazed = np.flatnonzero(np.abs(normal[:, 0])[hit] < _EDGE_ON)
        if len(grazed):
            face = hit[grazed]
            nearest[grazed], furthest[grazed], missed[grazed] = _depths_above(
                pixels[grazed], corners[face], normal[face]
            )
        depth = np.clip(depth, nearest, furthest)
        depth[missed] = np.inf
        return depth, missed

    def _exact_depth(self, pixels, origin, rotation) -> np.ndarray:
        """(n,) depth of the rays through `pixels` (n, 2), in double precision against every face in range.

        A face seen edge-on covers no pixel.
        """
        corners, normal = self._in_sensor_frame(self._near_faces(origin, rotation), origin, rotation)
        offset, slope = _planes(corners, normal)
        depth = offset + pixels @ slope.T
        covered = np.abs(normal[:, 0]) > _NO_WIDTH
        # Seen from the sensor, a pixel is inside a face if it is on the same side of its three edges.
        corner, facing = corners[:, :, 1:], np.sign(normal[:, 0])
        for start, stop in ((0, 1), (1, 2), (2, 0)):
            along = corner[:, stop] - corner[:, start]
            left = np.stack([-along[:, 1], along[:, 0]], axis=1) * facing[:, None]
            length = np.linalg.norm(along, axis=1)
            covered = covered & (
                pixels @ left.T - np.einsum("fi,fi->f", corner[:, start], left) >= -_DOUBLE_ROUNDING * length
            )
        depth = np.clip(depth, corners[:, :, 0].min(axis=1), corners[:, :, 0].max(axis=1))
        return np.where(covered & (depth >= 0), depth, np.inf).min(axis=1, initial=np.inf)

    def _in_sensor_frame(self, faces, origin, rotation) -> tuple[np.ndarray, np.ndarray]:
        """Corners (f, 3, 3) and unit normals (f, 3) of faces, in the sensor's frame."""
        normal = self._scene.normals[faces] @ rotation
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return (self._scene.triangles[faces] - origin) @ rotation, normal


def _planes(corners, normal) -> tuple[np.ndarray, np.ndarray]:
    """The planes of faces as x = offset + y slope[0] + z slope[1]: (f,) offset and (f, 2) slope.

    One seen exactly edge-on is entered at its nearest point: its offset is -inf, for clipping to the face.
    """
    across = np.where(normal[:, 0] == 0, np.inf, normal[:, 0])
    offset = np.einsum("fi,fi->f", normal, corners[:, 0]) / across
    return np.where(normal[:, 0] == 0, -np.inf, offset), -normal[:, 1:] / across[:, None]


def _depths_above(pixels, corners, normal) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The interval of depths that a face seen (almost) edge-on spans at a pixel.

    Such a face is nearly a segment of the sensor plane: along it, at the pixel, it spans a range of depths.

    Args:
        pixels: (n, 2) y and z, corners: (n, 3, 3) and normal: (n, 3) of the face at each, sensor frame.

    Returns:
        (n,) nearest and (n,) furthest depth, and (n,) bool, whether the pixel is beyond the segment's ends.
    """
    along = np.stack([-normal[:, 2], normal[:, 1]], axis=1)
    corner = np.einsum("nki,ni->nk", corners[:, :, 1:], along)
    pixel = np.einsum("ni,ni->n", pixels, along)
    on_segment = np.clip(pixel, corner.min(axis=1), corner.max(axis=1))
    missed = np.abs(pixel - on_segment) > _SINGLE_ROUNDING

    following = np.roll(corner, -1, axis=1)
    part = (on_segment[:, None] - corner) / np.where(following == corner, 1, following - corner)
    part = np.clip(part, 0, 1)
    depth = corners[:, :, 0] * (1 - part) + np.roll(corners[:, :, 0], -1, axis=1) * part
    crossed = (np.minimum(corner, following) <= on_segment[:, None]) & (
        np.maximum(corner, following) >= on_segment[:, None]
    )
    nearest = np.where(crossed, depth, np.inf).min(axis=1)
    furthest = np.where(crossed, depth, -np.inf).max(axis=1)
    return nearest, furthest, missed


def _pits(depth: np.ndarray) -> np.ndarray:
    """Pixels of a depth map (rows, columns) over a pixel's width deeper than three of four neighbours."""
    around = np.pad(depth, 1, constant_values=-np.inf)
    above, below, left, right = around[:-2, 1:-1], around[2:, 1:-1], around[1:-1, :-2], around[1:-1, 2:]
    second_deepest = np.maximum(
        np.maximum(np.minimum(above, below), np.minimum(left, right)),
        np.minimum(np.maximum(above, below), np.maximum(left, right)),
    )
    return depth > second_deepest + PIXEL
