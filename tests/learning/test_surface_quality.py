import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from palpate.charts import ATLAS_RADIUS, sphere, vision_atlas
from palpate.learning.surface_quality import Topology, surface_quality, topology
from palpate.mesh import OBJECT_POSITION

HINGE = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, -1, 0]], dtype=float)  # two triangles on the side 0-1
FACES = np.array([[0, 1, 2], [1, 0, 3]])
PLANE = np.stack([*np.meshgrid(*[np.linspace(-2, 2, 41)] * 2), np.zeros((41, 41))], axis=-1).reshape(-1, 3)


def measured(vertices, faces=FACES, truth=PLANE, joined=((0, 0),)):
    surface = Topology(faces, trimesh.graph.face_adjacency(faces), np.array(joined))
    return surface_quality(vertices, surface, cKDTree(truth))


def hinged(degrees: float) -> np.ndarray:
    """The second triangle turned about the common side."""
    angle = np.radians(degrees)
    return np.vstack([HINGE[:3], [0.5, -np.cos(angle), np.sin(angle)]])


@pytest.mark.parametrize(("degrees", "folded"), [(0, 0), (30, 0), (89, 0), (91, 100), (180, 100)])
def test_two_faces_are_bent_by_the_angle_of_their_hinge(degrees, folded):
    found = measured(hinged(degrees))
    assert found.bend == pytest.approx(degrees, abs=1e-4) and found.folded == folded
    # A face turned over is as parallel to the true plane as before.
    assert measured(hinged(degrees), FACES[::-1]).across == pytest.approx(min(degrees, 180 - degrees), abs=0.5)


@pytest.mark.parametrize("strategy", ["charts", "sphere"])
def test_angles_and_gaps_are_those_of_trimesh_and_of_a_loop(strategy):
    """On noisy vertices of the atlas and of the sphere."""
    vertices, faces = sphere() if strategy == "sphere" else vision_atlas()[:2]
    noisy = vertices.numpy() + np.random.default_rng(0).normal(0, 0.01, vertices.shape)
    mesh = trimesh.Trimesh(noisy, faces.numpy(), process=False)
    truth = trimesh.creation.icosphere(subdivisions=4, radius=ATLAS_RADIUS).vertices + OBJECT_POSITION
    found = surface_quality(noisy, topology(strategy), cKDTree(truth))
    angles = np.degrees(mesh.face_adjacency_angles)
    assert len(topology(strategy).adjacent) == len(angles)
    assert found.bend == pytest.approx(angles.mean(), rel=1e-4)
    assert found.folded == pytest.approx(100 * (angles > 90).mean())
    pairs = vision_atlas().joined.tolist() if strategy == "charts" else []
    gaps = [np.linalg.norm(noisy[one] - noisy[other]) for one, other in pairs]
    assert found.gap == pytest.approx(1000 * np.mean(gaps) if gaps else 0)
    outward = mesh.triangles_center - OBJECT_POSITION
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    to_line = np.degrees(np.arccos(np.abs((mesh.face_normals * outward).sum(axis=1))))
    fourth = np.arange(0, len(faces), 4)
    assert found.across == pytest.approx(np.average(to_line[fourth], weights=mesh.area_faces[fourth]), abs=1.0)


def test_the_initial_atlas_is_smooth_and_closed():
    atlas = vision_atlas()
    found = surface_quality(atlas.vertices.numpy(), topology("charts"), cKDTree(atlas.vertices.numpy()))
    assert found.bend == pytest.approx(4.9, abs=0.05) and found.folded == 0 and found.gap == pytest.approx(0, abs=1e-3)


def test_faces_across_the_true_surface_are_told_by_their_angle():
    """A sheet tilted against the plane; turned over it is the same."""
    tilt = np.radians(35)
    turn = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    sheet = HINGE @ turn.T
    assert measured(sheet).across == pytest.approx(35, abs=0.5)
    assert measured(sheet, FACES[:, ::-1]).across == pytest.approx(35, abs=0.5)


def test_faces_without_area_have_no_angle():
    vertices = np.vstack([hinged(40), HINGE[1]])
    faces = np.vstack([FACES, [1, 2, 4]])  # 4 lies on 1
    assert measured(vertices, faces).bend == pytest.approx(40, abs=1e-4)


def test_points_and_voxels_have_no_charts():
    assert topology(None) is None and np.isnan(surface_quality(HINGE, None, cKDTree(PLANE))).all()
