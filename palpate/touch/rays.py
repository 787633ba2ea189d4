"""Depth maps by ray casting: Embree finds the face, its plane gives the depth in double precision."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from palpate.mesh import Geometry
from palpate.sensor import DIGIT, Sensor
from palpate.surface.embree import RayMesh

_MARGIN = 1e-5  # metres, of the conservative tests: far above their rounding errors
_ORTHONORMAL = 1e-5  # of dot products of a sensor's axes: more than single precision's rounding
_SLACK = 1e-5  # m that Embree's rays reach beyond the range and behind the sensor plane: more than its rounding
_LARGEST = 2.0  # m across: the rounding of larger objects is too coarse for Embree
# Sine of the angle between a face and the rays below which its plane does not give the depth: moving the ray by
# Embree's rounding error (3e-8 m) then moves the hit by over 3e-6 m.
_EDGE_ON = 1e-2
_DOUBLE_ROUNDING = 1e-12  # m by which edges are widened in double precision: no ray slips through between two faces
_NO_WIDTH = 1e-6  # sine of the angle below which a face covers no pixel: it is narrower than Embree's rounding


class RayCaster:
    """Orthographic depth maps of one object, seen from touch sensors; exact to about 1e-7 m.

    The depth of a pixel is the distance along the sensor's +x, from the sensor plane, to the first face of either
    orientation (a mesh need not be closed); +inf where there is none within the pixel's reach. Omitted are faces
    outside the box that the sensor's plane sweeps over its range, and sensors without such a face
    (`studies/omitted/touch.py`).

    In single precision a ray may miss a face seen edge-on that Embree names, or slip through a vertex, and a surface
    just behind the sensor plane may hide what is before it. Such pixels are detected and traced in double precision
    against every face in range; so are all of an object larger than 2 m.
    """

    def __init__(self, mesh: Geometry, object_position: Sequence[float] = (0.0, 0.0, 0.0), sensor: Sensor = DIGIT):
        """Build the search tree of a mesh in the object's own frame, m. object_position: (3,) of its origin in the
        frame of the sensors' poses. sensor: the kind of all. Raises ValueError if no face has an area."""
        self.sensor = sensor
        self.mesh = RayMesh(mesh)
        self._object_position = np.asarray(object_position, dtype=np.float64)
        # (3, f), so that a test of one coordinate reads memory in order.
        corners = self.mesh.triangles.transpose(1, 2, 0).copy()
        self._low, self._high = corners.min(axis=0), corners.max(axis=0)
        low, high = self.mesh.low, self.mesh.high
        self._large = (high - low).max() > _LARGEST
        # Coordinates far from the origin are rounded more.
        far = np.maximum(np.abs(low), np.abs(high)).max()
        self._rounding = max(_DOUBLE_ROUNDING, 8 * np.finfo(float).eps * far)

    def trace(self, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """Depth maps (k, r, c) float32, metres, of sensors at position (k, 3) and rotation (k, 3, 3), whose columns are
        the frame's axes. Raises ValueError for an invalid pose."""
        depth = np.full((len(position), *self.sensor.resolution), np.inf, dtype=np.float32)
        for k, *pose in self._near(position, rotation):
            depth[k] = self._in_range(*pose)
        return depth

    def succeeds(self, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """Whether each sensor is in contact: (k,) bool, the same as `isfinite(trace(...)).any()` of each, but cheaper:
        every 10th pixel in both directions is traced first."""
        success = np.zeros(len(position), dtype=bool)
        for k, *pose in self._near(position, rotation):
            success[k] = self.succeeds_early(*pose) or np.isfinite(self._in_range(*pose)).any()
        return success

    def _near(self, position: np.ndarray, rotation: np.ndarray) -> Iterator[tuple[Any, ...]]:
        """Number and pose in the object's own frame (two arrays) of each sensor with a face near."""
        for k, pose in enumerate(zip(*self._in_object_frame(position, rotation), strict=True)):
            if len(self.near_faces(*pose)):
                yield k, *pose

    def is_near(self, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """Whether any face is traced for each sensor: (...,) bool; position: (..., 3), rotation: (..., 3, 3)."""
        poses = self._in_object_frame(np.reshape(position, (-1, 3)), np.reshape(rotation, (-1, 3, 3)))
        near = [len(self.near_faces(*pose)) > 0 for pose in zip(*poses, strict=True)]
        return np.reshape(near, np.shape(position)[:-1])

    def succeeds_early(self, origin: np.ndarray, rotation: np.ndarray) -> bool:
        """Whether Embree finds a face in range at every 10th pixel in both directions; doubtful ones don't count."""
        depth, _ = self._embree_depth(origin, rotation, self.sensor.plane[::10, ::10])
        return bool((depth <= self.sensor.reach[::10, ::10].ravel()).any())

    def _in_object_frame(self, position: np.ndarray, rotation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Poses of sensors, float64, in the object's own frame; ValueError for an invalid pose."""
        position, rotation = np.asarray(position, dtype=np.float64), np.asarray(rotation, dtype=np.float64)
        for k, (origin, axes) in enumerate(zip(position, rotation, strict=True)):
            if not np.isfinite(origin).all():
                raise ValueError(f"the position of sensor {k} is not finite: {origin}")
            frame = np.isfinite(axes).all() and np.abs(axes.T @ axes - np.eye(3)).max() <= _ORTHONORMAL
            if not frame or np.linalg.det(axes) < 0:
                raise ValueError(
                    f"the axes of sensor {k} are not a right-handed frame of unit vectors: {axes.tolist()}"
                )
        return position - self._object_position, rotation

    def _in_range(self, origin: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """Depth (r, c), +inf beyond the pixels' reach."""
        depth = self.depth(origin, rotation)
        return np.where(depth <= self.sensor.reach, depth, np.inf)

    def near_faces(self, origin: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """Indices of the faces whose bounding box meets the bounding box of the sensor's reach."""
        half = np.array([self.sensor.range, self.sensor.width, self.sensor.height]) / 2
        centre = origin + rotation[:, 0] * half[0]
        extent = np.abs(rotation) @ half + _MARGIN
        low, high = centre - extent, centre + extent
        near = np.flatnonzero((self._low[0] <= high[0]) & (self._high[0] >= low[0]))
        for axis in (1, 2):
            near = near[(self._low[axis, near] <= high[axis]) & (self._high[axis, near] >= low[axis])]
        return near

    def depth(self, origin: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """Depth (r, c) float64 up to the sensor's range; beyond it, any larger number."""
        pixels, shape = self.sensor.plane.reshape(-1, 3), self.sensor.resolution
        depth, doubtful = self._embree_depth(origin, rotation, self.sensor.plane)
        settled = np.zeros(len(pixels), dtype=bool)
        while doubtful.any():
            depth[doubtful] = np.minimum(depth[doubtful], self._exact_depth(pixels[doubtful, 1:], origin, rotation))
            settled |= doubtful
            # One pit may have hidden the next.
            doubtful = _pits(depth.reshape(shape), max(self.sensor.pixel)).ravel() & ~settled
        return depth.reshape(shape)

    def _embree_depth(
        self, origin: np.ndarray, rotation: np.ndarray, plane: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Depth (n,) of pixels, `plane` (rows, columns, 3) of them, +inf where no face is hit; and which are doubtful
        (n,) bool."""
        direction = rotation[:, 0]
        pixels = plane.reshape(-1, 3)
        depth, doubtful = np.full(len(pixels), np.inf), np.full(len(pixels), self._large)
        if self._large:
            return depth, doubtful
        start = pixels @ rotation.T + (origin - _SLACK * direction)
        hit = self.mesh.first_face(start, direction[None], self.sensor.range + 2 * _SLACK)
        met = np.flatnonzero(hit >= 0)
        if not len(met):
            return depth, doubtful
        seen = np.zeros(len(self.mesh.triangles), dtype=bool)
        seen[hit[met]] = True
        faces, hit = np.flatnonzero(seen), (np.cumsum(seen) - 1)[hit[met]]
        corners, normal = self._in_sensor_frame(faces, origin, rotation)
        offset, slope = _planes(corners, normal)
        found = offset[hit] + pixels[met, 1] * slope[hit, 0] + pixels[met, 2] * slope[hit, 1]
        # A ray may pass the edge of its face at Embree's rounding distance: stay on the face.
        found = np.clip(found, corners[:, :, 0].min(axis=1)[hit], corners[:, :, 0].max(axis=1)[hit])
        # Doubtful where the face is seen edge-on, or met behind the sensor plane.
        doubtful[met] = (np.abs(normal[:, 0]) < _EDGE_ON)[hit] | (found < 0)
        depth[met] = np.where(doubtful[met], np.inf, found)
        doubtful |= _pits(depth.reshape(plane.shape[:2]), max(self.sensor.pixel)).ravel()
        return depth, doubtful

    def _exact_depth(self, pixels: np.ndarray, origin: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """Depth (n,) of the rays through `pixels` (n, 2), in double precision against every face in range. A face seen
        edge-on covers no pixel; one on the sensor plane is touched, at depth 0."""
        corners, normal = self._in_sensor_frame(self.near_faces(origin, rotation), origin, rotation)
        row_height, _ = self.sensor.pixel
        low, high = corners[:, :, 2].min(axis=1) - row_height, corners[:, :, 2].max(axis=1) + row_height
        depth = np.empty(len(pixels))
        rows, row = np.unique(pixels[:, 1], return_inverse=True)
        for number, z in enumerate(rows):
            mine, crossing = np.flatnonzero(row == number), np.flatnonzero((low <= z) & (z <= high))
            depth[mine] = _nearest(pixels[mine], corners[crossing], normal[crossing], self._rounding)
        return depth

    def _in_sensor_frame(
        self, faces: np.ndarray, origin: np.ndarray, rotation: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Corners (f, 3, 3) and unit normals (f, 3) of faces, in the sensor's frame."""
        normal = self.mesh.normals[faces] @ rotation
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        return (self.mesh.triangles[faces] - origin) @ rotation, normal


def _nearest(pixels: np.ndarray, corners: np.ndarray, normal: np.ndarray, rounding: float) -> np.ndarray:
    """Depth (n,) of the first of the faces, corners (f, 3, 3) and normals (f, 3), that covers each pixel."""
    offset, slope = _planes(corners, normal)
    depth = offset + pixels @ slope.T
    covered = np.abs(normal[:, 0]) > _NO_WIDTH
    # Seen from the sensor, a pixel is inside a face if it is on the same side of its three edges.
    corner, facing = corners[:, :, 1:], np.sign(normal[:, 0])
    for start, stop in ((0, 1), (1, 2), (2, 0)):
        along = corner[:, stop] - corner[:, start]
        left = np.stack([-along[:, 1], along[:, 0]], axis=1) * facing[:, None]
        length = np.linalg.norm(along, axis=1)
        inside = pixels @ left.T - np.einsum("fi,fi->f", corner[:, start], left) >= -rounding * length
        covered = covered & inside
    depth = np.clip(depth, corners[:, :, 0].min(axis=1), corners[:, :, 0].max(axis=1))
    nearest = np.where(covered & (depth >= -rounding), depth, np.inf).min(axis=1, initial=np.inf)
    return np.maximum(nearest, 0)


def _planes(corners: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The planes of faces as x = offset + y slope[0] + z slope[1]: (f,) offset, -inf if edge-on, and (f, 2) slope."""
    across = np.where(normal[:, 0] == 0, np.inf, normal[:, 0])
    offset = np.einsum("fi,fi->f", normal, corners[:, 0]) / across
    return np.where(normal[:, 0] == 0, -np.inf, offset), -normal[:, 1:] / across[:, None]


def _pits(depth: np.ndarray, pixel: float) -> np.ndarray:
    """Pixels of a depth map (rows, columns) over a pixel's width (m) deeper than three of four neighbours."""
    around = np.pad(depth, 1, constant_values=-np.inf)
    above, below, left, right = around[:-2, 1:-1], around[2:, 1:-1], around[1:-1, :-2], around[1:-1, 2:]
    second_deepest = np.maximum(
        np.maximum(np.minimum(above, below), np.minimum(left, right)),
        np.minimum(np.maximum(above, below), np.maximum(left, right)),
    )
    return depth > second_deepest + pixel
