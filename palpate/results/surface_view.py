"""The object's surface with the touched sites in colour: an orthographic clay picture, by ray casting.

Needs no renderer: where the rays of the picture meet the mesh, the surface is shaded by one lamp and
by how much of its surroundings it sees (ambient occlusion), and coloured where touched points lie close by.
"""

import itertools
from dataclasses import dataclass

import numpy as np
import trimesh
from matplotlib.colors import to_rgb
from scipy.spatial import cKDTree

from palpate.results.page import COLOURS
from palpate.sensor import DIGIT, Sensor
from palpate.surface.embree import RayMesh

CLAY = (0.93, 0.92, 0.90)  # RGB of the untouched surface
SITE_COLOURS = tuple(to_rgb(COLOURS[number]) for number in (1, 0, 2, 3))  # in the order of the sensors
TOUCHED_WITHIN = 0.001  # m: a point of the picture this close to a local cloud is part of the site
SUPERSAMPLING = 2
LIGHT = (-0.35, -0.50, -0.79)  # towards the lamp, from behind the camera's shoulder: right, down, in
AMBIENT = 0.55  # share of the light that comes from all around
OCCLUSION_RAYS = 10  # a sample; a pixel has SUPERSAMPLING^2 samples
OCCLUSION_REACH = 0.12  # m: geometry further away casts no ambient shadow
LIFT = 3e-4  # m: how far off the surface ambient rays start
MARGIN = 0.04  # of the picture's edge left free on each side
HIDDEN_BELOW = 0.15  # a site is hidden in a view that shows less than this share of its area
# Views that are looked at for the one that shows most of the sites: azimuth about z and elevation in degrees.
AZIMUTHS = range(0, 360, 20)
ELEVATIONS = (20, 50, -20)
PREVIEW = 96  # pixels


@dataclass(frozen=True)
class View:
    """An orthographic camera: `axes` (3, 3), rows right, down, into the picture; `scale`, metres a pixel;
    `shape`, height and width in pixels."""

    axes: np.ndarray
    centre: np.ndarray
    scale: float
    shape: tuple[int, int]

    def project(self, points: np.ndarray) -> np.ndarray:
        """(n, 2) pixels (column, row) of points (n, 3); the picture's top left corner is (0, 0)."""
        return (points - self.centre) @ self.axes[:2].T / self.scale + np.array(self.shape[::-1]) / 2

    def rays(self, samples: int, distance: float) -> tuple[np.ndarray, np.ndarray]:
        """Origins (n, 3) of `samples` x `samples` rays a pixel, row-major, and their direction (1, 3)."""
        row, column = (
            ((np.arange(length * samples) + 0.5) / samples - length / 2) * self.scale for length in self.shape
        )
        column, row = np.meshgrid(column, row)
        plane = np.stack([column.ravel(), row.ravel(), np.full(column.size, -distance)], axis=1)
        return plane @ self.axes + self.centre, self.axes[2][None]


@dataclass(frozen=True)
class Picture:
    """`image` (height, width, 4) float RGBA; of every site: `centres` (k, 2) pixel of its middle, nan if
    empty, `area` (k,) in m2 that is seen, `hidden` (k,) whether next to nothing is; `silhouette` in m2."""

    image: np.ndarray
    centres: np.ndarray
    area: np.ndarray
    hidden: np.ndarray
    silhouette: float


def direction(azimuth: float, elevation: float) -> np.ndarray:
    """(3,) unit vector of an azimuth about z and an elevation, in degrees; azimuth 0 is +x."""
    turn, tilt = np.radians([azimuth, elevation])
    return np.array([np.cos(turn) * np.cos(tilt), np.sin(turn) * np.cos(tilt), np.sin(tilt)])


def site_colours(count: int) -> list[tuple[float, float, float]]:
    """Colours of the sites of `count` sensors, in their order; from the first again after four."""
    return [SITE_COLOURS[sensor % len(SITE_COLOURS)] for sensor in range(count)]


class SurfaceView:
    """One object and the sites that sensors touched on it."""

    def __init__(self, mesh: trimesh.Trimesh, sites: list[np.ndarray], sensor: Sensor = DIGIT):
        """mesh and sites in one frame, metres; sites: arrays (n, 3) of points that sensors of one kind touched."""
        self._mesh, self._sensor = RayMesh(mesh), sensor
        self._vertices = self._mesh.triangles.reshape(-1, 3)
        self._sites = [np.asarray(site, float).reshape(-1, 3) for site in sites]
        self._site = np.repeat(np.arange(len(sites)), [len(site) for site in self._sites])
        touched = np.concatenate([np.zeros((0, 3)), *self._sites])
        self._touched = cKDTree(touched) if len(touched) else None

    def view(self, azimuth: float, elevation: float, shape: tuple[int, int]) -> View:
        """The view from a direction in degrees (azimuth 0 is +x), the object filling the picture."""
        turn = np.deg2rad(azimuth)
        into, right = -direction(azimuth, elevation), np.array([-np.sin(turn), np.cos(turn), 0])
        axes = np.stack([right, np.cross(into, right), into])
        flat = self._vertices @ axes.T
        low, high = flat.min(axis=0), flat.max(axis=0)
        height, width = shape
        scale = max((high - low)[:2] / [width, height]) / (1 - 2 * MARGIN)
        return View(axes, (low + high) / 2 @ axes, scale, shape)

    def best_view(self, shape: tuple[int, int]) -> View:
        """The view that shows most of the sites and of the object.

        Each site counts by the root of its area, so that all are seen rather than one of them well; the
        root of the silhouette keeps long objects from being looked at end on.
        """

        def merit(angles: tuple[int, int]) -> float:
            preview = self.draw(self.view(*angles, (PREVIEW, PREVIEW)), preview=True)
            return (np.sqrt(preview.area).sum() + self._sensor.width) * np.sqrt(preview.silhouette)

        return self.view(*max(itertools.product(AZIMUTHS, ELEVATIONS), key=merit), shape)

    def draw(self, view: View, preview: bool = False) -> Picture:
        """The picture from a view; a preview has the sites' areas only right, not the shading."""
        samples = 1 if preview else SUPERSAMPLING
        distance = 2 * np.linalg.norm(np.ptp(self._vertices, axis=0))
        origins, ahead = view.rays(samples, distance)
        face = self._mesh.first_face(origins, ahead)
        hit = np.flatnonzero(face >= 0)
        normal = self._mesh.normals[face[hit]]
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        corner = self._mesh.triangles[face[hit], 0]
        facing = normal @ view.axes[2]
        normal *= -np.sign(facing)[:, None]  # a face is drawn from either side
        depth = np.einsum("ni,ni->n", corner - origins[hit], normal) / np.minimum(-np.abs(facing), -1e-3)
        points = origins[hit] + np.clip(depth, 0, 2 * distance)[:, None] * ahead

        site = self._site_of(points)
        pixel = (view.scale / samples) ** 2
        area = pixel * np.bincount(site[site >= 0], minlength=len(self._sites))
        colours = np.array([*site_colours(len(self._sites)), CLAY])[site]
        if not preview:
            colours = colours * self._light(points, normal, view)[:, None]
        image = np.zeros((len(origins), 4))
        image[hit, :3], image[hit, 3] = colours, 1
        height, width = view.shape
        image = image.reshape(height, samples, width, samples, 4).mean(axis=(1, 3))
        image[..., :3] /= np.maximum(image[..., 3:], 1e-9)  # the mean was of premultiplied colours
        whole = np.array([len(cloud) * np.prod(self._sensor.pixel) for cloud in self._sites])
        return Picture(image, self._centres(view), area, area < HIDDEN_BELOW * whole, pixel * len(hit))

    def _site_of(self, points: np.ndarray) -> np.ndarray:
        """(n,) the site that each point is in, -1 for none."""
        if self._touched is None or not len(points):
            return np.full(len(points), -1)
        _, nearest = self._touched.query(points, distance_upper_bound=TOUCHED_WITHIN)
        return np.append(self._site, -1)[nearest]

    def _light(self, points: np.ndarray, normal: np.ndarray, view: View) -> np.ndarray:
        """(n,) light that each point sends to the camera, up to about 1."""
        lamp = np.clip(normal @ (np.array(LIGHT) @ view.axes), 0, None)
        return AMBIENT * self._openness(points, normal) + (1 - AMBIENT) * lamp

    def _openness(self, points: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """(n,) share of the directions above the surface, cosine-weighted, in which nothing is near."""
        unit = np.random.default_rng(0).normal(size=(OCCLUSION_RAYS, len(points), 3))
        unit /= np.linalg.norm(unit, axis=-1, keepdims=True)
        directions = (normal + 0.999 * unit).reshape(-1, 3)  # a unit sphere on the normal's tip: Lambert's cosine
        directions *= OCCLUSION_REACH / np.linalg.norm(directions, axis=1, keepdims=True)
        origins = np.broadcast_to(points + LIFT * normal, unit.shape).reshape(-1, 3)
        blocked = self._mesh.blocked(origins, directions, reach=1)
        return 1 - blocked.reshape(OCCLUSION_RAYS, -1).mean(axis=0)

    def _centres(self, view: View) -> np.ndarray:
        """(k, 2) pixel of the touched point that is nearest to the mean of its site; nan without points."""
        centres = np.full((len(self._sites), 2), np.nan)
        for number, cloud in enumerate(self._sites):
            if len(cloud):
                middle = cloud[np.argmin(np.linalg.norm(cloud - cloud.mean(axis=0), axis=1))]
                centres[number] = view.project(middle[None])[0]
        return centres
