"""Signed distances against closed forms, and meshes that are open, doubled or turned inside out."""

import numpy as np
import pytest
import trimesh

from palpate.mesh.signed_distance import POINTS, ambiguity, sample_distances, signed_distance

RNG = np.random.default_rng(0)
ANYWHERE = RNG.uniform(-0.25, 0.25, (2000, 3))
HALF = np.array([0.05, 0.1, 0.15])
BOX = trimesh.creation.box(extents=2 * HALF)
BEHIND = 2e-4


def box_distance(points):
    """Positive outside by the offset beyond the sides, negative inside by the nearest side."""
    beyond = np.abs(points) - HALF
    return np.linalg.norm(beyond.clip(min=0), axis=1) + beyond.max(axis=1).clip(max=0)


def near_box(count=500):
    """Points up to 6 mm from the faces of the box."""
    points, _ = trimesh.sample.sample_surface(BOX, count, seed=0)
    return points + RNG.uniform(-0.006, 0.006, points.shape)


def changed(**how):
    """The box without its lid, with each face twice, with each face in both senses, and inside out."""
    flipped = BOX.faces[:, ::-1]
    faces = {
        "open": BOX.faces[BOX.face_normals[:, 2] < 0.5],
        "twice": np.concatenate([BOX.faces, BOX.faces]),
        "both": np.concatenate([BOX.faces, flipped]),
        "flipped": flipped,
    }
    return BOX.vertices, faces[how["way"]]


def test_a_box_in_closed_form():
    points = np.concatenate([ANYWHERE, near_box()])
    np.testing.assert_allclose(signed_distance(BOX.vertices, BOX.faces, points), box_distance(points), atol=1e-12)
    assert ambiguity(BOX.vertices, BOX.faces, near_box(), BEHIND) == 0


def test_a_sphere_in_closed_form():
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.2)
    found = signed_distance(ball.vertices, ball.faces, ANYWHERE)
    sagitta = 0.2 * (1 - np.cos(ball.edges_unique_length.max() / 0.2 / np.sqrt(3)))
    assert np.abs(found - (np.linalg.norm(ANYWHERE, axis=1) - 0.2)).max() < sagitta


@pytest.mark.parametrize("way", ["twice", "flipped"])
def test_the_same_inside_where_faces_are_doubled_or_inside_out(way):
    points = np.concatenate([ANYWHERE, near_box()])
    np.testing.assert_allclose(signed_distance(*changed(way=way), points), box_distance(points), atol=1e-12)
    assert ambiguity(*changed(way=way), near_box(), BEHIND) == 0


def test_faces_in_both_senses_are_a_sheet_all_over():
    found = signed_distance(*changed(way="both"), ANYWHERE)
    np.testing.assert_allclose(found, np.abs(box_distance(ANYWHERE)), atol=1e-12)
    assert ambiguity(*changed(way="both"), near_box(), BEHIND) == 1


def test_an_open_box_is_full_away_from_its_lid_and_says_where_it_is_ambiguous():
    vertices, faces = changed(way="open")
    deep = ANYWHERE[(box_distance(ANYWHERE) < 0) & (ANYWHERE[:, 2] < 0)]
    assert len(deep) > 30 and (signed_distance(vertices, faces, deep) < 0).all()
    far = ANYWHERE[box_distance(ANYWHERE) > 0.05]
    assert (signed_distance(vertices, faces, far) > 0).all()
    near = near_box()
    assert 0.05 < ambiguity(vertices, faces, near, BEHIND) < 0.5
    assert ambiguity(vertices, faces, near[near[:, 2] < -0.1], BEHIND) < 0.01


def test_a_single_sheet_has_no_inside():
    sheet = (
        np.array([[-0.1, -0.1, 0], [0.1, -0.1, 0], [0.1, 0.1, 0], [-0.1, 0.1, 0.0]]),
        np.array([[0, 1, 2], [0, 2, 3]]),
    )
    near = np.column_stack([RNG.uniform(-0.09, 0.09, (200, 2)), RNG.uniform(-0.006, 0.006, 200)])
    assert ambiguity(*sheet, near, BEHIND) == 1


def test_points_to_learn_from():
    """As many as asked for at each distance, with their own distances, the same each time."""
    surface, _ = trimesh.sample.sample_surface(BOX, 5000, seed=1)
    diagonal = float(np.linalg.norm(2 * HALF))
    points, distance, unclear = sample_distances(BOX.vertices, BOX.faces, surface, diagonal, np.random.default_rng(3))
    again = sample_distances(BOX.vertices, BOX.faces, surface, diagonal, np.random.default_rng(3))
    assert all(np.array_equal(one, other) for one, other in zip((points, distance, unclear), again, strict=True))
    assert points.shape == (POINTS, 3) and points.dtype == np.float32 and unclear == 0
    np.testing.assert_allclose(distance, box_distance(points.astype(float)), atol=1e-12)
    # In its direction across a face, a distance is a normal number.
    near, middle, rest = np.split(np.abs(distance), [POINTS // 2, POINTS * 3 // 4])
    for part, spread in ((near, 0.012 * diagonal), (middle, 0.05 * diagonal)):
        assert 0.8 * spread < np.sqrt(np.mean(part**2)) < 1.4 * spread
    anywhere = points[POINTS * 3 // 4 :] / (0.52 * diagonal)
    assert len(rest) == POINTS // 4 and np.abs(anywhere).max() <= 1 + 1e-6
    np.testing.assert_allclose((anywhere**2).mean(axis=0), 1 / 3, atol=0.03)
    assert 0.2 < np.mean(distance[: POINTS // 2] < 0) < 0.55
