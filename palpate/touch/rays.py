"""Depth maps by ray casting: Embree names the face, double precision says where it is hit."""

import numpy as np

from palpate.touch.sensor import SENSOR_PLANE, SENSOR_RANGE
from palpate.touch.tracing import Block, Tracer

# How much further than the range Embree looks: more than its rounding, so that double precision decides.
_SLACK = 1e-5
# Sine of the angle between a face and the rays, below which the plane of the face says too little about the
# depth: moving the ray by Embree's rounding error (3e-8 m) then moves the hit by over 3e-6 m.
_EDGE_ON = 1e-2


class RayCaster(Tracer):
    """Depth maps by Embree. The default: exact to about 1e-7 m, and the fastest (see docs/touch.md)."""

    def _depth(self, origin, rotation, block: Block) -> np.ndarray:
        plane = SENSOR_PLANE[block]
        pixels = plane.reshape(-1, 3)
        hit = self._scene.first_face(
            pixels @ rotation.T + origin, rotation[:, 0][None], SENSOR_RANGE + _SLACK
        )
        depth = np.full(len(pixels), np.inf)
        felt = np.flatnonzero(hit >= 0)
        if len(felt):
            depth[felt] = self._depth_on_faces(hit[felt], pixels[felt, 1:], origin, rotation)
        return depth.reshape(plane.shape[:2])

    def _depth_on_faces(self, hit, pixels, origin, rotation) -> np.ndarray:
        """(n,) depth at which the rays through `pixels` (n, 2), y and z, meet the faces `hit` (n,)."""
        seen = np.zeros(len(self._scene.triangles), dtype=bool)
        seen[hit] = True
        faces = np.flatnonzero(seen)
        index = np.empty(len(seen), dtype=np.intp)
        index[faces] = np.arange(len(faces))
        hit = index[hit]

        corners = (self._scene.triangles[faces] - origin) @ rotation
        normal = self._scene.normals[faces] @ rotation
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        # The plane of a face: x = offset + y slope[0] + z slope[1]. One that is seen exactly edge-on is
        # entered at its nearest point, to which the clipping below moves -inf.
        across = np.where(normal[:, 0] == 0, np.inf, normal[:, 0])
        slope = -normal[:, 1:] / across[:, None]
        offset = np.where(normal[:, 0] == 0, -np.inf, np.einsum("fi,fi->f", normal, corners[:, 0]) / across)
        depth = offset[hit] + pixels[:, 0] * slope[hit, 0] + pixels[:, 1] * slope[hit, 1]

        # A ray may pass the edge of its face at Embree's rounding distance: stay on the face.
        nearest, furthest = corners[:, :, 0].min(axis=1)[hit], corners[:, :, 0].max(axis=1)[hit]
        grazed = np.flatnonzero(np.abs(normal[:, 0])[hit] < _EDGE_ON)
        if len(grazed):
            face = hit[grazed]
            nearest[grazed], furthest[grazed] = _depths_above(pixels[grazed], corners[face], normal[face])
        return np.clip(depth, nearest, furthest)


def _depths_above(pixels, corners, normal) -> tuple[np.ndarray, np.ndarray]:
    """The interval of depths that a face seen (almost) edge-on spans at a pixel.

    Such a face is nearly a segment of the sensor plane: along it, at the pixel, the face spans a range of
    depths.

    Args:
        pixels: (n, 2) y and z, corners: (n, 3, 3) and normal: (n, 3) of the face at each, sensor frame.

    Returns:
        Two (n,) arrays: nearest and furthest depth.
    """
    along = np.stack([-normal[:, 2], normal[:, 1]], axis=1)
    corner = np.einsum("nki,ni->nk", corners[:, :, 1:], along)
    pixel = np.einsum("ni,ni->n", pixels, along)
    pixel = np.clip(pixel, corner.min(axis=1), corner.max(axis=1))
    start, stop = corner, np.roll(corner, -1, axis=1)
    length = stop - start
    part = np.clip((pixel[:, None] - start) / np.where(length == 0, 1, length), 0, 1)
    depth = corners[:, :, 0] * (1 - part) + np.roll(corners[:, :, 0], -1, axis=1) * part
    crosses = np.minimum(start, stop) <= pixel[:, None]
    crosses &= np.maximum(start, stop) >= pixel[:, None]
    return np.where(crosses, depth, np.inf).min(axis=1), np.where(crosses, depth, -np.inf).max(axis=1)
