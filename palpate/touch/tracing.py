"""What every way of tracing a sensor's depth map shares: only what can be felt is looked at."""

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np
import trimesh

from palpate.scene import Plan, plan
from palpate.surface.embree import RayMesh
from palpate.touch.sensor import PIXEL, RESOLUTION, SENSOR_RANGE, SENSOR_WIDTH

# Margin of the conservative tests in metres, far above their rounding errors.
_MARGIN = 1e-5
# Dot products of a sensor's axes are right to this: more than single precision's rounding.
_ORTHONORMAL = 1e-5

PLAN = plan("touch")


class Block(NamedTuple):
    """A rectangle of pixels."""

    rows: slice
    columns: slice


EVERYTHING = Block(slice(0, RESOLUTION), slice(0, RESOLUTION))


class Tracer(ABC):
    """Orthographic depth maps of one object, seen from touch sensors.

    The depth of a pixel is the distance along the sensor's +x, from the sensor plane, to the first face of
    either orientation (a mesh need not be closed); +inf where there is none within `SENSOR_RANGE`.
    """

    def __init__(self, mesh: trimesh.Trimesh, object_position=(0.0, 0.0, 0.0), plan: Plan = PLAN):
        """Build the object's search tree, once for all its grasps.

        Args:
            mesh: the object in its own frame, metres.
            object_position: (3,) where the origin of that frame is in the frame of the sensors' poses.
            plan: of a scene "touch".

        Raises ValueError if no face has an area.
        """
        self.plan = plan
        self._mesh = RayMesh(mesh)
        self._object_position = np.asarray(object_position, dtype=np.float64)
        # (3, f), so that a test of one coordinate reads memory in order.
        self._low = np.ascontiguousarray(self._mesh.triangles.min(axis=1).T)
        self._high = np.ascontiguousarray(self._mesh.triangles.max(axis=1).T)

    def trace(self, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """Depth maps of k sensors.

        Args:
            position: (k, 3), rotation: (k, 3, 3) of the sensors; columns of a rotation are the frame's axes.

        Returns:
            (k, 100, 100) float32 metres.

        Raises ValueError for a pose that is not one.
        """
        origins, rotation = self._in_object_frame(position, rotation)
        depth = np.full((len(origins), RESOLUTION, RESOLUTION), np.inf, dtype=np.float32)
        for k, origin in enumerate(origins):
            block = self._felt_block(origin, rotation[k])
            if block is not None:
                depth[k, block.rows, block.columns] = self._in_range(origin, rotation[k], block)
        return depth

    def succeeds(self, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """Whether each sensor feels anything: (k,) bool, the same as `isfinite(trace(...)).any()` of each.

        Cheaper, for ranking many grasps: pixels are looked at from coarse to fine until one is in range.
        """
        origins, rotation = self._in_object_frame(position, rotation)
        success = np.zeros(len(origins), dtype=bool)
        for k, origin in enumerate(origins):
            block = self._felt_block(origin, rotation[k])
            if block is not None:
                every = self.plan.needs("pixels after the first in range")
                success[k] = any(
                    np.isfinite(self._in_range(origin, rotation[k], part)).any()
                    for part in ([block] if every else _coarse_to_fine(block))
                )
        return success

    def felt_faces(self, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """Which faces some of k sensors may feel, (f,) bool: those that meet a box around a sensor's reach.

        position, rotation: as for `trace`. f: the faces that have an area.
        """
        felt = np.zeros(self._low.shape[1], dtype=bool)
        for origin, frame in zip(position - self._object_position, rotation, strict=True):
            felt[self._faces_in_box(origin, frame)] = True
        return felt

    def _in_object_frame(self, position, rotation) -> tuple[np.ndarray, np.ndarray]:
        """Poses of sensors, float64, in the object's own frame; ValueError if one is no pose."""
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
        return np.where(depth <= SENSOR_RANGE, depth, np.inf)

    @abstractmethod
    def _depth(self, origin, rotation, block: Block) -> np.ndarray:
        """Depth of a block of pixels, up to `SENSOR_RANGE`; beyond it, any larger number.

        Args:
            origin: (3,) position of the sensor in the object's own frame, rotation: (3, 3).

        Returns:
            (rows, columns) float64.
        """

    def _felt_block(self, origin, rotation) -> Block | None:
        """A block of pixels outside of which nothing can be in range; None if nothing can be in range at all.

        Conservative: the faces whose bounding boxes meet the bounding box of the sensor's reach, then their
        extent in the sensor's frame. Leaving the rest out does not change a single depth.
        """
        if self.plan.needs("pixels outside the felt block"):
            return EVERYTHING
        faces = self._near_faces(origin, rotation)
        if not len(faces):
            return None
        half = SENSOR_WIDTH / 2
        corners = (self._mesh.triangles[faces] - origin) @ rotation
        low, high = corners.min(axis=1), corners.max(axis=1)
        box = np.array([[0, -half, -half], [SENSOR_RANGE, half, half]])
        meets = ((low <= box[1] + _MARGIN) & (high >= box[0] - _MARGIN)).all(axis=1)
        if not meets.any():
            return None
        first = np.floor((low[meets, 1:].min(axis=0) - _MARGIN) / PIXEL + RESOLUTION / 2 - 0.5).astype(int)
        last = np.ceil((high[meets, 1:].max(axis=0) + _MARGIN) / PIXEL + RESOLUTION / 2 - 0.5).astype(int)
        first, last = np.clip(first, 0, RESOLUTION), np.clip(last + 1, 0, RESOLUTION)
        return Block(rows=slice(first[1], last[1]), columns=slice(first[0], last[0]))

    def _near_faces(self, origin, rotation) -> np.ndarray:
        """Indices of the faces that are looked at: those in the box, or all if the plan has them in."""
        if self.plan.needs("faces outside the swept box"):
            return np.arange(self._low.shape[1])
        return self._faces_in_box(origin, rotation)

    def _faces_in_box(self, origin, rotation) -> np.ndarray:
        """Indices of the faces whose bounding box meets the bounding box of what the sensor can feel."""
        half = np.array([SENSOR_RANGE, SENSOR_WIDTH, SENSOR_WIDTH]) / 2
        centre = origin + rotation[:, 0] * half[0]
        extent = np.abs(rotation) @ half + _MARGIN
        near = np.ones(self._low.shape[1], dtype=bool)
        for axis in range(3):
            near &= self._low[axis] <= centre[axis] + extent[axis]
            near &= self._high[axis] >= centre[axis] - extent[axis]
        return np.flatnonzero(near)


def _coarse_to_fine(block: Block):
    """Every 10th pixel of a block in both directions, then all."""
    for step in (10, 1):
        yield Block(*(slice(side.start, side.stop, step) for side in block))
