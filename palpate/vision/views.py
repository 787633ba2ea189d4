"""Small images of an object from all around, for single-image reconstruction, as Choy et al. made theirs.

3D-R2N2 (Choy et al. 2016), by the published renderer and the metadata of their images: 24 images of 137 x 137 an
object; azimuth in [0, 360) and elevation in [25, 30) degrees and a distance of [0.65, 0.95) x 1.75, all uniform, around
a model whose bounding box has a diagonal of 1 and its centre at the origin; a lens of 35 mm on a sensor of 32 mm
(Blender did not use the field of view of 25 degrees in their metadata). Azimuth turns clockwise seen from above: the
camera is at distance (cos e cos a, -cos e sin a, sin e), z up, and looks at the origin.

Here distances are in proportion to the object, at `palpate.mesh.OBJECT_POSITION`: the images are the same.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from PIL import Image as PillowImage
from scipy.ndimage import binary_dilation

from palpate.batch import UnusableObject
from palpate.camera import Camera, rotation_about
from palpate.mesh import DIAGONAL, OBJECT_POSITION, diagonal

if TYPE_CHECKING:
    from palpate.scene import Scene
    from palpate.vision.renderer import Renderer

COUNT = 24  # views an object
SIZE = 137  # pixels
FOCAL_LENGTH = 35 / 32  # of the image's width: Blender's lens and sensor of 2016
AZIMUTH = (0.0, 360.0)  # degrees
ELEVATION = (25.0, 30.0)  # degrees
DISTANCE = (0.65, 0.95)  # of LARGEST_DISTANCE
LARGEST_DISTANCE = 1.75  # of the bounding box's diagonal

METADATA = "rendering_metadata.txt"
OPAQUE = 128  # of 255: from here on a pixel of a published image shows the object
# Least share of the surface within the silhouettes of published images of this mesh; parts thinner than a pixel may be
# missing. Another mesh, or the same one turned, has less.
AGREEMENT = 0.9
_BEFORE_X = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # axes of a camera on the x axis that looks back, z up


class Viewpoint(NamedTuple):
    """Where a view is taken from: a line of the published metadata without its field of view; angles in degrees."""

    azimuth: float
    elevation: float
    roll: float  # about the camera's axis; 0 in all published images
    distance: float  # in units of `LARGEST_DISTANCE` times the bounding box's diagonal


class Views(NamedTuple):
    """v views of an object."""

    image: np.ndarray  # (v, s, s, 3) uint8 over white
    mask: np.ndarray  # (v, s, s) uint8
    camera: np.ndarray  # (v, 3, 4) float64, from homogeneous world coordinates (m) to homogeneous pixels


def viewpoints(generator: np.random.Generator, count: int = COUNT) -> list[Viewpoint]:
    """`count` viewpoints with the distribution of Choy et al.; the first are the same whatever the count."""
    low, high = zip(AZIMUTH, ELEVATION, DISTANCE, strict=True)
    drawn = generator.uniform(low, high, (count, 3))
    return [Viewpoint(azimuth, elevation, 0.0, distance) for azimuth, elevation, distance in drawn.tolist()]


def camera(
    viewpoint: Viewpoint, size: int = SIZE, scale: float = DIAGONAL, centre: Iterable[float] = (0, 0, 0)
) -> Camera:
    """The camera of a viewpoint about the origin of the source's coordinates (z up), in the world.

    The object's own frame is `scale` times those coordinates less `centre`. The defaults are for a source's object that
    is centred and has a diagonal of 1.
    """
    about_z, about_y, about_x = (
        rotation_about(axis, -np.radians(angle)) for axis, angle in zip((2, 1, 0), viewpoint[:3], strict=True)
    )
    turn = about_z @ about_y @ about_x
    there = turn @ [LARGEST_DISTANCE * viewpoint.distance, 0, 0]
    position = (there - np.asarray(tuple(centre), dtype=float)) * scale + OBJECT_POSITION
    return Camera(position, turn @ _BEFORE_X, FOCAL_LENGTH * size, size)


def render(renderer: "Renderer", scene: "Scene", at: Iterable[Viewpoint], size: int = SIZE) -> Views:
    """Views of a scene's object; raises as `Renderer.render_views`, and UnusableObject if no view shows the object."""
    scale = diagonal(scene.object_folder)
    cameras = [camera(viewpoint, size, scale) for viewpoint in at]
    images = renderer.render_views(scene, cameras)
    if not any(image.mask.any() for image in images):
        raise UnusableObject(f"{scene.visual_file}: no view shows the object: make its materials less transparent")
    made = [(image.rgb, image.mask, each.matrix()) for image, each in zip(images, cameras, strict=True)]
    return Views(*map(np.stack, zip(*made, strict=True)))


def published(
    folder: Path | str, record: Mapping[str, Any], points: np.ndarray, count: int = COUNT, size: int = SIZE
) -> Views:
    """The first `count` published images of an object: `<synset>/<model>/rendering/` of ShapeNetRendering.

    record: the object's `mesh.json`. points: (n, 3) of its surface in the world, to check the silhouettes.

    Raises UnusableObject naming the file if images or metadata are missing or invalid, or if the images do not show
    this mesh (they were made of ShapeNetCore v1: meshes of v2 are turned).
    """
    folder = Path(folder)
    centre = np.mean(record["source"]["bounding_box"], axis=0)
    at = read_metadata(folder / METADATA)
    if len(at) < count:
        raise UnusableObject(f"{folder / METADATA}: {len(at)} views, but the config asks for {count}")
    made = []
    for number, viewpoint in enumerate(at[:count]):
        image, mask = _read_image(folder / f"{number:02d}.png", size)
        made.append((image, mask, camera(viewpoint, size, record["scale"], centre).matrix()))
    views = Views(*map(np.stack, zip(*made, strict=True)))
    within = silhouette_agreement(views, points)
    if within < AGREEMENT:
        raise UnusableObject(
            f"{folder}: only {within:.0%} of the object's surface lies within the silhouettes of its"
            " published images: they are of ShapeNetCore v1; take its meshes, or set views.published_renderings to null"
        )
    return views


def read_metadata(path: Path | str) -> list[Viewpoint]:
    """The viewpoints in a `rendering_metadata.txt`: azimuth, elevation, roll, distance, field of view a line.

    Raises UnusableObject naming the file, and the line that is not five numbers.
    """
    path = Path(path)
    if not path.is_file():
        raise UnusableObject(f"{path}: no such file: expected the published renderings of the object there")
    found = []
    for number, line in enumerate(path.read_text(errors="replace").splitlines(), start=1):
        try:
            azimuth, elevation, roll, distance, _ = (float(word) for word in line.split())
        except ValueError:
            raise UnusableObject(
                f"{path}: line {number} is {line!r}: expected azimuth, elevation, roll, distance, and field of view"
            ) from None
        found.append(Viewpoint(azimuth, elevation, roll, distance))
    return found


def silhouette_agreement(views: Views, points: np.ndarray) -> float:
    """The share of points (n, 3) in the world, of those inside the images, that land within a pixel of the mask."""
    size = views.mask.shape[1]
    seen = inside = 0
    for mask, matrix in zip(views.mask, views.camera, strict=True):
        x, y, depth = matrix @ np.column_stack([points, np.ones(len(points))]).T
        column, row = np.floor(x / depth), np.floor(y / depth)
        kept = (depth > 0) & (column >= 0) & (column < size) & (row >= 0) & (row < size)
        near = binary_dilation(mask > 0, np.ones((3, 3)))
        seen += kept.sum()
        inside += near[row[kept].astype(int), column[kept].astype(int)].sum()
    return float(inside / seen) if seen else 0.0


def _read_image(path: Path, size: int) -> tuple[np.ndarray, np.ndarray]:
    """A published image over white (s, s, 3) and its mask (s, s)."""
    try:
        with PillowImage.open(path) as file:
            pixels = np.asarray(file.convert("RGBA"))
    except OSError as error:
        raise UnusableObject(f"{path}: can't be read as an image ({error}): unpack the renderings again") from None
    if pixels.shape != (size, size, 4):
        height, width = pixels.shape[:2]
        raise UnusableObject(f"{path}: {width} x {height} pixels: set views.size to {width}")
    alpha = pixels[..., 3:].astype(np.float64) / 255
    image = (pixels[..., :3] * alpha + 255 * (1 - alpha) + 0.5).astype(np.uint8)
    return image, np.where(pixels[..., 3] >= OPAQUE, 255, 0).astype(np.uint8)
