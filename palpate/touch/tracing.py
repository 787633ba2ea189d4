"""Base of all tracers of depth maps: only faces and pixels that can be in contact are traced."""

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np
import trimesh

from palpate.sensor import DIGIT, Sensor
from palpate.surface.embree import RayMesh

_MARGIN = 1e-5  # metres, of the conservative tests: far above their rounding errors
_ORTHONORMAL = 1e-5  # of dot products of a sensor's axes: more than single precision's rounding


class Block(NamedTuple):
    """A rectangle of pixels."""

    rows: slice
    columns: slice


class Tracer(ABC):
    """Orthographic depth maps of one object, seen from touch sensors.

    The depth of a pixel is the distance along the sensor's +x, from the sensor plane, to the first face of either
    orientation (a mesh need not be closed); +inf where there is none within the pixel's reach. Omitted are faces
    outside the box that the sensor's plane sweeps over its range, and pixels without such a face
    (`studies/omitted/touch.py`).
    """

    def __init__(self, mesh: trimesh.Trimesh, object_position=(0.0, 0.0, 0.0), sensor: Sensor = DIGIT):
        """Build the search tree of a mesh in the object's own frame, metres, once for all its grasps.

        object_position: (3,) of that frame's origin in the frame of the sensors' poses. sensor: the kind of all
        sensors. Raises ValueError if no face has an area.
        """
        self.sensor = sensor
        self._mesh = RayMesh(mesh)
        self._object_position = np.asarray(object_position, dtype=np.float64)
        # (3, f), so that a test of one coordinate reads memory in order.
        self._low = np.ascontiguousarray(self._mesh.triangles.min(axis=1).T)
        self._high = np.ascontiguousarray(self._mesh.triangles.max(axis=1).T)

    def trace(self, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """Depth maps (k, r, c) float32, metres, of k sensors. Raises ValueError for an invalid pose.

        position: (k, 3), rotation: (k, 3, 3) of the sensors; columns of a rotation are the frame's axes.
        """
        origins, rotation = self._in_object_frame(position, rotation)
        depth = np.full((len(origins), *self.sensor.resolution), np.inf, dtype=np.float32)
        for k, origin in enumerate(origins):
            block = self._block_in_reach(origin, rotation[k])
            if block is not None:
                depth[k, block.rows, block.columns] = self._in_range(origin, rotation[k], block)
        return depth

    def succeeds(self, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """Whether each sensor is in contact: (k,) bool, the same as `isfinite(trace(...)).any()` of each, but cheaper.

        Pixels are traced from coarse to fine until one is in range. position, rotation: as for `trace`.
        """
        origins, rotation = self._in_object_frame(position, rotation)
        success = np.zeros(len(origins), dtype=bool)
        for k, origin in enumerate(origins):
            block = self._block_in_reach(origin, rotation[k])
            passes = [] if block is None else self._passes(block)
            success[k] = any(np.isfinite(self._in_range(origin, rotation[k], pixels)).any() for pixels in passes)
        return success

    def is_near(self, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """Whether any face is traced for each sensor: (...,) bool; position: (..., 3), rotation: (..., 3, 3)."""
        poses = self._in_object_frame(np.reshape(position, (-1, 3)), np.reshape(rotation, (-1, 3, 3)))
        near = [len(self._near_faces(*pose)) > 0 for pose in zip(*poses, strict=True)]
        return np.reshape(near, np.shape(position)[:-1])

    def faces_in_reach(self, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """Which faces with an area are traced for any sensor: (f,) bool; position: (..., 3), rotation: (..., 3, 3)."""
        near = np.zeros(self._low.shape[1], dtype=bool)
        poses = self._in_object_frame(np.reshape(position, (-1, 3)), np.reshape(rotation, (-1, 3, 3)))
        for origin, frame in zip(*poses, strict=True):
            near[self._near_faces(origin, frame)] = True
        return near

    def _in_object_frame(self, position, rotation) -> tuple[np.ndarray, np.ndarray]:
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

    def _in_range(self, origin, rotation, block: Block) -> np.ndarray:
        depth = self._depth(origin, rotation, block)
        return np.where(depth <= self.sensor.reach[block], depth, np.inf)

    @abstractmethod
    def _depth(self, origin, rotation, block: Block) -> np.ndarray:
        """Depth (rows, columns) float64 of a block of pixels, up to the sensor's range; beyond it, any larger number.

        origin: (3,), rotation: (3, 3) of the sensor in the object's own frame.
        """

    def _block_in_reach(self, origin, rotation) -> Block | None:
        """The block of pixels before the faces near the sensor, outside of which nothing can be in range, or None."""
        faces = self._near_faces(origin, rotation)
        if not len(faces):
            return None
        sensor = self.sensor
        size, pixel, side = (np.array(each)[::-1] for each in (sensor.size, sensor.pixel, sensor.resolution))  # y, z
        half = size / 2
        corners = (self._mesh.triangles[faces] - origin) @ rotation
        low, high = corners.min(axis=1), corners.max(axis=1)
        box = np.array([[0, *-half], [sensor.range, *half]])
        meets = ((low <= box[1] + _MARGIN) & (high >= box[0] - _MARGIN)).all(axis=1)
        if not meets.any():
            return None
        first = np.floor((low[meets, 1:].min(axis=0) - _MARGIN) / pixel + side / 2 - 0.5).astype(int)
        last = np.ceil((high[meets, 1:].max(axis=0) + _MARGIN) / pixel + side / 2 - 0.5).astype(int)
        first, last = np.clip(first, 0, side), np.clip(last + 1, 0, side)
        return Block(rows=slice(first[1], last[1]), columns=slice(first[0], last[0]))

    def _near_faces(self, origin, rotation) -> np.ndarray:
        """Indices of the faces whose bounding box meets the bounding box of the sensor's reach."""
        half = np.array([self.sensor.range, self.sensor.width, self.sensor.height]) / 2
        centre = origin + rotation[:, 0] * half[0]
        extent = np.abs(rotation) @ half + _MARGIN
        low, high = centre - extent, centre + extent
        near = np.flatnonzero((self._low[0] <= high[0]) & (self._high[0] >= low[0]))
        for axis in (1, 2):
            near = near[(self._low[axis, near] <= high[axis]) & (self._high[axis, near] >= low[axis])]
        return near

    def _passes(self, block: Block) -> list[Block]:
        """A block from coarse to fine: every 10th pixel in both directions, then all."""
        return [Block(*(slice(side.start, side.stop, step) for side in block)) for step in (10, 1)]
