"""Small images of an object from all around, for single-image reconstruction, as Choy et al. made theirs.

3D-R2N2 (Choy et al. 2016), by the published renderer and the metadata of their images: azimuth, elevation and distance
are uniform, around a model whose bounding box has a diagonal of 1 and its centre at the origin (here: in proportion to
the object, at `palpate.mesh.OBJECT_POSITION`). Blender did not use the field of view of 25 degrees in their metadata.
Azimuth turns clockwise seen from above: the camera is at distance (cos e cos a, -cos e sin a, sin e), z up.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from palpate.batch import UnusableObject
from palpate.camera import Camera, rotation_about
from palpate.mesh import DIAGONAL, OBJECT_POSITION, read_record

if TYPE_CHECKING:
    from palpate.scene import Scene
    from palpate.vision.renderer import Renderer

COUNT, SIZE = 24, 137  # views an object, pixels
FOCAL_LENGTH = 35 / 32  # of the image's width: Blender's lens and sensor of 2016
AZIMUTH, ELEVATION = (0.0, 360.0), (25.0, 30.0)  # degrees
DISTANCE = (0.65, 0.95)  # of LARGEST_DISTANCE
LARGEST_DISTANCE = 1.75  # of the bounding box's diagonal
_BEFORE_X = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # axes of a camera on the x axis that looks back, z up


class Views(NamedTuple):
    """v views of an object."""

    image: np.ndarray  # (v, s, s, 3) uint8 over white
    mask: np.ndarray  # (v, s, s) uint8
    camera: np.ndarray  # (v, 3, 4) float64, from homogeneous world coordinates (m) to homogeneous pixels


def viewpoints(generator: np.random.Generator, count: int = COUNT) -> np.ndarray:
    """Viewpoints (count, 3) with the distribution of Choy et al.; the first are the same whatever the count. A row has
    azimuth and elevation in degrees, and distance in units of `LARGEST_DISTANCE` times the bounding box's diagonal."""
    low, high = zip(AZIMUTH, ELEVATION, DISTANCE, strict=True)
    return generator.uniform(low, high, (count, 3))


def camera(viewpoint: Iterable[float], size: int = SIZE, scale: float = DIAGONAL) -> Camera:
    """The camera in the world of a row of `viewpoints`; scale: the diagonal of the object's box, m."""
    azimuth, elevation, distance = viewpoint
    turn = rotation_about(2, -np.radians(azimuth)) @ rotation_about(1, -np.radians(elevation))
    position = turn @ [LARGEST_DISTANCE * distance, 0, 0] * scale + OBJECT_POSITION
    return Camera(position, turn @ _BEFORE_X, FOCAL_LENGTH * size, size)


def render(renderer: "Renderer", scene: "Scene", at: Iterable[Iterable[float]], size: int = SIZE) -> Views:
    """Views of a scene's object from `viewpoints`; raises as `Renderer.render_views`, and UnusableObject if no view
    shows the object."""
    scale = read_record(scene.object_folder).get("diagonal", DIAGONAL)
    cameras = [camera(viewpoint, size, scale) for viewpoint in at]
    images = renderer.render_views(scene, cameras)
    if not any(image.mask.any() for image in images):
        raise UnusableObject(f"{scene.visual_file}: no view shows the object: make its materials less transparent")
    columns = [image.rgb for image in images], [image.mask for image in images], [each.matrix() for each in cameras]
    return Views(*map(np.stack, columns))
