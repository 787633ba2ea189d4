"""The pinhole camera: where a point of the world lands in an image. Numpy only.
An image is `size` pixels wide and high, row 0 at the top. Pixel (row r, column c) covers the square from (c, r) to
(c + 1, r + 1): its **centre is at (c + 0.5, r + 0.5)**. Coordinates in an image are (x, y) = (column, row)."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

# The paper's supplement, "Simulating Vision".
POSITION = (0.972, 0.461, 0.974)  # m
ROTATION = (70.458, 4.940, 113.540)  # degrees, as `euler_rotation` takes them
FOCAL_LENGTH = 406.595  # pixels of an image of `IMAGE_SIZE`; not in the paper: of its published projection matrix
IMAGE_SIZE = 256  # pixels, the width and height of the dataset's images

Vector = Sequence[float] | np.ndarray  # (3,)

# A Blender camera looks along its -z with +y up; image coordinates have y down and z into the scene.
IMAGE_FROM_CAMERA = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True)
class Camera:
    """A pinhole camera with square pixels and the principal point at the image's centre."""

    position: np.ndarray  # (3,) in the world, metres
    rotation: np.ndarray  # (3, 3), columns are the camera's axes in the world: x right, y up, looking along -z
    focal_length: float  # pixels
    size: int  # pixels, the image's width and height

    @classmethod
    def from_matrices(cls, intrinsics: np.ndarray, extrinsics: np.ndarray, size: int) -> "Camera":
        """The camera of matrices as `intrinsics` and `extrinsics` give them; ValueError if it has other intrinsics."""
        turn, focal_length = np.asarray(extrinsics)[:, :3], float(intrinsics[0][0])
        camera = cls(-turn.T @ np.asarray(extrinsics)[:, 3], turn.T @ IMAGE_FROM_CAMERA, focal_length, size)
        if not (focal_length > 0 and np.allclose(intrinsics, camera.intrinsics(), atol=1e-6 * size)):
            expected = "expected square pixels and the principal point at the image's centre"
            raise ValueError(f"intrinsics {np.asarray(intrinsics).tolist()} of an image of {size} pixels: {expected}")
        return camera

    def intrinsics(self) -> np.ndarray:
        """(3, 3) matrix from image coordinates (x right, y down, z into the scene) to homogeneous pixels."""
        centre = self.size / 2
        return np.array([[self.focal_length, 0, centre], [0, self.focal_length, centre], [0, 0, 1.0]])

    def extrinsics(self) -> np.ndarray:
        """(3, 4) matrix from homogeneous world coordinates to x right, y down, z into the scene."""
        turn = IMAGE_FROM_CAMERA @ self.rotation.T
        return np.column_stack([turn, -turn @ self.position])

    def matrix(self) -> np.ndarray:
        """(3, 4) projection from homogeneous world coordinates to homogeneous pixels: the two multiplied."""
        return self.intrinsics() @ self.extrinsics()

    def pose(self) -> np.ndarray:
        """(4, 4) pose in the world of the axes x right, y up, -z into the scene (Blender's, OpenGL's)."""
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = self.rotation, self.position
        return pose

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixels (..., 2) as (column, row), nan behind the camera, and depth (...), of world points (..., 3)."""
        seen = (np.asarray(points, dtype=float) - self.position) @ self.rotation @ IMAGE_FROM_CAMERA
        depth = seen[..., 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = self.focal_length * seen[..., :2] / depth[..., None] + self.size / 2
        pixels[depth <= 0] = np.nan
        return pixels, depth

    def rays(self) -> np.ndarray:
        """(size, size, 3) world directions through pixels' centres: `position + depth[..., None] * rays` are points."""
        ticks = (np.arange(self.size) + 0.5 - self.size / 2) / self.focal_length
        column, row = np.meshgrid(ticks, ticks)
        return np.stack([column, row, np.ones_like(row)], axis=-1) @ IMAGE_FROM_CAMERA @ self.rotation.T


def matrices(cameras: Sequence[Camera]) -> dict[str, np.ndarray]:
    """Intrinsics (k, 3, 3) and extrinsics (k, 3, 4) of k cameras, as the vision store has them."""
    return {key: np.stack([getattr(camera, key)() for camera in cameras]) for key in ("intrinsics", "extrinsics")}


def paper_camera(size: int = IMAGE_SIZE) -> Camera:
    """The paper's camera; another size keeps the field of view (34.95 degrees)."""
    return Camera(np.array(POSITION), euler_rotation(ROTATION), FOCAL_LENGTH * size / IMAGE_SIZE, size)


def euler_rotation(angles: Iterable[float]) -> np.ndarray:
    """(3, 3) rotation of Euler angles (3,) in degrees as Blender applies them: about fixed x, then y, then z."""
    about_x, about_y, about_z = (rotation_about(axis, np.radians(angle)) for axis, angle in enumerate(angles))
    return about_z @ about_y @ about_x


def looking_at(
    target: Vector, position: Vector, size: int = IMAGE_SIZE, field_of_view: float = 34.95, up: Vector = (0.0, 0.0, 1.0)
) -> Camera:
    """A camera at `position` (3,) that looks at `target` (3,); angle in degrees. ValueError if it is along `up`."""
    position = np.asarray(position, dtype=float)
    back = position - np.asarray(target, dtype=float)
    right = np.cross(up, back)
    if not np.linalg.norm(right) > 1e-9 * np.linalg.norm(back):
        raise ValueError(f"a camera at {position} can't look at {target} with {up} up: choose another `up`")
    axes = [right, np.cross(back, right), back]
    rotation = np.stack([axis / np.linalg.norm(axis) for axis in axes], axis=1)
    return Camera(position, rotation, size / 2 / math.tan(math.radians(field_of_view) / 2), size)


def rotation_about(axis: int, angle: float) -> np.ndarray:
    """(3, 3) rotation of points by `angle` radians about coordinate axis 0, 1 or 2."""
    rotation, first, second = np.eye(3), (axis + 1) % 3, (axis + 2) % 3
    rotation[first, first] = rotation[second, second] = np.cos(angle)
    rotation[second, first], rotation[first, second] = np.sin(angle), -np.sin(angle)
    return rotation
