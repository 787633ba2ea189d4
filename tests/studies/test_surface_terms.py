from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import torch
import trimesh

from palpate.charts import vision_atlas
from palpate.protocol import CHAMFER_SCALE
from palpate.training.learners import ReconstructionLearner
from studies.surface_terms import SurfaceTerms
from tests.training.conftest import OCCLUDED_TOUCH, SETTINGS, made_up

TERMS = SurfaceTerms(edge_length=0.5, normal_consistency=0.2, joined=2.0)


def hinge(angle):
    """Two triangles that share a side; the second is turned out of the first's plane."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return torch.tensor([[[0, 0, 0], [0, 2, 0], [-1, 1, 0], [c, 1, s]]], dtype=torch.float64)


@pytest.mark.parametrize("angle", [0, 30, 90, 150])
def test_two_triangles_in_closed_form(angle):
    faces = torch.tensor([[0, 1, 2], [0, 3, 1]])
    terms = SurfaceTerms(normal_consistency=1.0)
    assert float(terms.of_faces(hinge(angle), faces)) == pytest.approx(1 - np.cos(np.radians(angle)))
    lengths = SurfaceTerms(edge_length=1.0)
    assert float(lengths.of_faces(hinge(angle), faces)) == pytest.approx(CHAMFER_SCALE * (4 + 4 * 2) / 5)


def test_of_a_closed_mesh_as_trimesh_has_it():
    mesh = trimesh.creation.icosphere(subdivisions=2)
    mesh.vertices = mesh.vertices * [1, 2, 3] + np.random.default_rng(0).normal(0, 0.05, mesh.vertices.shape)
    expected = 0.5 * CHAMFER_SCALE * np.mean(mesh.edges_unique_length**2)
    expected += 0.2 * np.mean(1 - np.cos(mesh.face_adjacency_angles))
    assert float(TERMS.of_faces(torch.tensor(mesh.vertices)[None], torch.tensor(mesh.faces))) == pytest.approx(expected)


def test_joined_vertices_are_those_at_one_point_of_the_initial_sphere():
    atlas = vision_atlas()
    terms = SurfaceTerms(joined=1.0)
    assert float(terms.of_faces(atlas.vertices[None], atlas.faces, atlas.joined)) == pytest.approx(0, abs=1e-12)
    moved = atlas.vertices.clone()
    moved[: len(moved) // 2] += torch.tensor([0.0, 0.0, 0.1])  # the first charts, all of each
    groups = trimesh.grouping.group_rows(atlas.vertices.numpy(), digits=9)
    pairs = [pair for group in groups for pair in combinations(group, 2)]
    apart = [float((moved[i] - moved[j]).square().sum()) for i, j in pairs]
    assert (
        float(terms.of_faces(moved[None], atlas.faces, atlas.joined)) == pytest.approx(CHAMFER_SCALE * np.mean(apart))
        and max(apart) > 0.009
    )


@pytest.mark.parametrize("strategy", ["charts", "no_copy", "no_comm"])
def test_a_training_step_has_them_added_and_validation_has_not(strategy):
    experiment = replace(OCCLUDED_TOUCH, strategy=strategy)
    plain, with_terms = (
        ReconstructionLearner(made_up(), experiment, SETTINGS, 0, extra_loss=terms) for terms in (None, TERMS)
    )
    values = []
    for learner in (plain, with_terms):
        learner.on_fit_start()
        samples = learner.validation_samples[:1]
        values.append(
            [
                learner.losses(samples, torch.Generator().manual_seed(1), learner.model, validation=validation).detach()
                for validation in (False, True)
            ]
        )
    model = with_terms.model
    prediction = model(with_terms.assemble(with_terms.validation_samples[:1]))
    added = TERMS(model, prediction).detach()
    torch.testing.assert_close(values[1][0] - values[0][0], added, rtol=1e-3, atol=1e-3)
    torch.testing.assert_close(values[1][1], values[0][1])
