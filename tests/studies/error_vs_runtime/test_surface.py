"""The study of surface sampling: its references against closed forms and against each other."""

import numpy as np
import pytest
import trimesh

from palpate import shapes
from palpate.surface import sample
from studies.error_vs_runtime.surface import (
    Sampled,
    cup,
    overlapping_spheres,
    sobol_sphere,
    study,
    traced_case,
    visible,
)

SETTINGS = {"surface": {"points": 2000}}


def first(case, count):
    """The first places of a case, which are as random as all."""
    return case._replace(points=case.points[:count], face=case.face[:count], exterior=case.exterior[:count])


def test_a_quarter_of_each_overlapping_sphere_is_hidden():
    """A cap of height r - d/2 has (r - d/2) / 2r of a sphere's area."""
    assert (~overlapping_spheres().exterior).mean() == pytest.approx(0.25, abs=0.01)


@pytest.mark.parametrize("case", [overlapping_spheres(), cup(4)], ids=["spheres", "cup"])
def test_rays_of_the_reference_find_the_exterior_known_in_closed_form(case):
    case = first(case, 1500)
    np.testing.assert_array_equal(visible(case.mesh, case.points, case.face, sobol_sphere(1024)), case.exterior)


@pytest.mark.parametrize("class_name", ["bottle", "knife"])
def test_the_reference_is_converged(class_name):
    """Four times the directions say the same of all but one place in 200."""
    mesh = shapes.make(class_name, 1).to_geometry()
    few, many = (traced_case(mesh, 400, directions) for directions in (1024, 4096))
    assert 0 < many.exterior.mean() < 1
    assert (few.exterior <= many.exterior).all() and (few.exterior != many.exterior).sum() <= 2


@pytest.mark.parametrize("scale", [1e-4, 1e4])
def test_the_reference_does_not_depend_on_the_unit(scale):
    case = first(overlapping_spheres(), 500)
    mesh = case.mesh.copy().apply_scale(scale)
    found = visible(mesh, scale * case.points, case.face, sobol_sphere(256))
    np.testing.assert_array_equal(found, case.exterior)


def test_directions_are_even():
    directions = sobol_sphere(1024)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)
    np.testing.assert_allclose(directions.mean(axis=0), 0, atol=0.01)
    np.testing.assert_allclose(directions.T @ directions / 1024, np.eye(3) / 3, atol=0.01)


def test_errors_of_known_answers(monkeypatch):
    case = overlapping_spheres()
    made = study(None, [], SETTINGS)
    exact = case.points[case.exterior]
    monkeypatch.setattr(made, "classify", lambda result, case: case.exterior)
    assert made.errors(case, Sampled(exact, 64)) == {"misclassified": 0, "Chamfer distance": 0}
    # Everything taken for exterior: a hidden quarter for three quarters that are not.
    monkeypatch.setattr(made, "classify", lambda result, case: np.ones(len(case.points), bool))
    moved = made.errors(case, Sampled(exact + [0, 0, 1e-6], 64))
    assert moved["misclassified"] == pytest.approx(100 / 3, abs=1.5)
    assert moved["Chamfer distance"] == pytest.approx(2e-3, rel=0.01)


def test_what_is_chosen_is_what_the_run_does():
    mesh = trimesh.creation.torus(0.2, 0.06)
    (chosen,) = [m for m in study(None, [], SETTINGS).methods() if m.chosen]
    assert chosen.value == 64
    expected = sample(mesh, 2000, np.random.default_rng(0))
    np.testing.assert_array_equal(chosen.run(traced_case(mesh, 10)).points, expected)


def test_more_directions_see_deeper_into_a_cup():
    case, made = first(cup(4), 5000), study(None, [], SETTINGS)
    rays = [made.errors(case, m.run(case))["misclassified"] for m in made.methods() if m.value != 128]
    assert (np.diff(rays) <= 0).all() and rays[0] > 10 and rays[-1] == 0
