"""Small images of an object from all around, for single-image reconstruction, as Choy et al. made theirs.

Facts of their renderings (3D-R2N2, Choy et al. 2016; read off the renderer they published and the metadata
beside their images): 24 images of 137 x 137 an object; azimuth in [0, 360) and elevation in [25, 30) degrees
and a distance of [0.65, 0.95) x 1.75, all uniform, around a model whose bounding box has a diagonal of 1 and
its centre at the origin; a camera with a lens of 35 mm on a sensor of 32 mm (the field of view of 25 degrees
in their metadata is not what Blender used). Azimuth turns clockwise seen from above: the camera stands at
distance (cos e cos a, -cos e sin a, sin e), z up, and looks at the origin.

Here the object is half as large and stands at `palpate.mesh.OBJECT_POSITION`: distances are halved with it,
so that the images are the same. Around an object that keeps its size they are in proportion to it. Numpy only,
but for `render`, which is given a Renderer.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from PIL import Image as PillowImage

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
# A published image that shows this mesh has nearly all of its surface within the silhouette; another mesh, or
# the same one turned, does not. What may be missing is parts thinner than a pixel.
AGREEMENT = 0.9

# A camera at the end of the x axis that looks back along it, z up: right is y.
_BEFORE_X = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])


class Viewpoint(NamedTuple):
    """Where a view is taken from, as a line of the published metadata has it, less its field of view.

    Angles in degrees; distance in units of `LARGEST_DISTANCE` times the bounding box's diagonal. `roll` turns
    the camera about its axis; it is 0 in all published images.
    """

    azimuth: float
    elevation: float
    roll: float
    distance: float


class Views(NamedTuple):
    """Images (v, s, s, 3) uint8 over white, masks (v, s, s) uint8, and cameras (v, 3, 4) float64: projections
    from homogeneous world coordinates (metres) to homogeneous pixels (see `palpate.camera`)."""

    image: np.ndarray
    mask: np.ndarray
    camera: np.ndarray


def viewpoints(generator: np.random.Generator, count: int = COUNT) -> list[Viewpoint]:
    """`count` viewpoints with the distribution of Choy et al.; the first are the same whatever the count."""
    low, high = zip(AZIMUTH, ELEVATION, DISTANCE, strict=True)
    drawn = generator.uniform(low, high, (count, 3))
    return [Viewpoint(azimuth, elevation, 0.0, distance) for azimuth, elevation, distance in drawn.tolist()]


def camera(
    viewpoint: Viewpoint, size: int = SIZE, scale: float = DIAGONAL, centre: Iterable[float] = (0, 0, 0)
) -> Camera:
    """The camera of a viewpoint, in the world.

    The object's own frame is `scale` times what is left of the source's coordinates (z up) after `centre` is
    taken from them; the viewpoint is about the source's origin. The defaults are for an object that a source
    holds centred and with a diagonal of 1.
    """
    about_z, about_y, about_x = (
        rotation_about(axis, -np.radians(angle)) for axis, angle in zip((2, 1, 0), viewpoint[:3], strict=True)
    )
    turn = about_z @ about_y @ about_x
    there = turn @ [LARGEST_DISTANCE * viewpoint.distance, 0, 0]
    position = (there - np.asarray(tuple(centre), dtype=float)) * scale + OBJECT_POSITION
    return Camera(position, turn @ _BEFORE_X, FOCAL_LENGTH * size, size)


def render(renderer: "Renderer", scene: "Scene", at: Iterable[Viewpoint], size: int = SIZE) -> Views:
    """Views of a scene's object.

    Raises what its `render_views` raises, and UnusableObject if no view shows the object.
    """
    scale = diagonal(scene.object_folder)
    cameras = [camera(viewpoint, size, scale) for viewpoint in at]
    images = renderer.render_views(scene, cameras)
    if not any(image.mask.any() for image in images):
        raise UnusableObject(f"{scene.visual_file}: no view shows the object: make its materials less transparent")
    return Views(
        np.stack([image.rgb for image in images]),
        np.stack([image.mask for image in images]),
        np.stack([each.matrix() for each in cameras]),
    )


def published(
    folder: Path | str, record: Mapping[str, Any], points: np.ndarray, count: int = COUNT, size: int = SIZE
) -> Views:
    """The first `count` published images of an object: `<synset>/<model>/rendering/` of ShapeNetRendering.

    record: what the object's `mesh.json` says (where its box lay in the source, and the scale from there).
    points: (n, 3) of its surface in the world, against which the silhouettes are checked.

    Raises UnusableObject naming the file if images or metadata are missing or not as expected, or if the images do
    not show this mesh (they were made of ShapeNetCore v1: those of v2 are turned).
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
    views = Views(*(np.stack(arrays) for arrays in zip(*made, strict=True)))
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
    """The share of points (n, 3) in the world, of those inside the images, that land within a pixel of the
    mask."""
    size = views.mask.shape[1]
    seen = inside = 0
    for mask, matrix in zip(views.mask, views.camera, strict=True):
        x, y, depth = matrix @ np.column_stack([points, np.ones(len(points))]).T
        column, row = np.floor(x / depth), np.floor(y / depth)
        kept = (depth > 0) & (column >= 0) & (column < size) & (row >= 0) & (row < size)
        padded = np.pad(mask > 0, 1)
        near = np.any(
            [padded[down : down + size, over : over + size] for down in range(3) for over in range(3)], axis=0
        )
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
