"""The radius of the wrench ball against a brute force over facets and linear programs; the margin of friction cones."""

from itertools import combinations

import numpy as np
import pytest
from scipy.optimize import linprog

from palpate.grasp.contacts import EDGES, OBJECT, Contacts, cone_margin, wrench_radius


def contacts(position, normal, force):
    """Contacts with these points, normals into the object, and forces (n, 3) of the object, each on another link."""
    normal = -np.array(normal) / np.linalg.norm(normal, axis=1, keepdims=True)
    along = np.einsum("ni,ni->n", normal, force)
    links = np.arange(len(normal)), np.full(len(normal), OBJECT)
    return Contacts(np.array(position), normal, along, *links, force - along[:, None] * normal)


def frames(normal):
    """A tangent and another one of each normal."""
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return zip(normal, first, np.cross(normal, first), strict=True)


def around(count, seed=0):
    """Contacts on a ball of 30 mm that press towards its middle."""
    normal = np.random.default_rng(seed).normal(size=(count, 3))
    normal[:2] = [[0, 0, 1], [0.1, 0, -1]]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    pressed = contacts(-0.03 * normal, normal, -normal)
    return pressed._replace(position=pressed.position + [0.001, 0.002, 0])


def edges_of(pressed, friction, centre, length):
    """Wrenches (8 n, 6) of the edges of the pyramids inside the cones, one by one."""
    rows = []
    for point, (normal, one, other) in zip(pressed.position, frames(pressed.normal), strict=True):
        for turn in 2 * np.pi * np.arange(EDGES) / EDGES:
            force = normal + friction * (np.cos(turn) * one + np.sin(turn) * other)
            rows.append([*force, *np.cross(point - centre, force) / length])
    return np.array(rows)


@pytest.mark.parametrize("seed", range(3))
def test_the_ball_reaches_the_nearest_of_all_facets(seed):
    """Every plane through six wrenches that has all others on one side."""
    pressed, centre = around(3, seed), np.zeros(3)
    points = edges_of(pressed, 0.8, centre, 0.03)
    chosen = points[np.array(list(combinations(range(len(points)), 6)))]
    chosen = chosen[np.abs(np.linalg.det(chosen)) > 1e-9]
    normal = np.linalg.solve(chosen, np.ones((len(chosen), 6, 1)))[..., 0]  # n . w = 1
    outer = (normal @ points.T <= 1 + 1e-7).all(axis=1)
    expected = 3 * (1 / np.linalg.norm(normal[outer], axis=1)).min()
    inside = linprog(np.zeros(len(points)), A_eq=points.T, b_eq=np.zeros(6), bounds=(1e-6, None)).status == 0
    found = wrench_radius(pressed, 0.8, centre, 0.03)
    assert found == pytest.approx(expected if inside else 0.0, rel=1e-6)
    assert seed or found > 0.01


def test_no_wrench_inside_the_ball_is_beyond_the_contacts():
    """Linear programs: how far along random wrenches the contacts resist."""
    pressed, centre, generator = around(6), np.zeros(3), np.random.default_rng(1)
    points, radius = edges_of(pressed, 0.8, centre, 0.03), wrench_radius(pressed, 0.8, centre, 0.03)
    reach = []
    for direction in generator.normal(size=(300, 6)):
        direction /= np.linalg.norm(direction)
        program = np.column_stack([points.T, -direction])
        weights = np.append(np.ones(len(points)), 0)[None]
        found = linprog(-np.eye(len(points) + 1)[-1], weights, [1], program, np.zeros(6))
        reach.append(6 * found.x[-1])
    assert 0 < radius <= min(reach) < 2 * radius
    twin = type(pressed)(*(np.concatenate([values, values]) for values in pressed))
    near = twin.position + 1e-7 * generator.normal(size=twin.position.shape)  # contacts that are nearly the same
    twin = twin._replace(position=near, force=twin.force / 2)
    assert wrench_radius(twin, 0.8, centre, 0.03) == pytest.approx(radius, rel=1e-4)


def test_two_points_do_not_resist_turning_and_the_ball_grows_with_the_grip():
    ends, force = [[0, 0, -0.03], [0, 0, 0.03]], np.array([[0, 0, -1.0], [0, 0, 1.0]])
    assert wrench_radius(contacts(ends, [[0, 0, 1], [0, 0, -1]], force), 0.8, np.zeros(3), 0.03) == 0
    none = contacts(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)))
    assert wrench_radius(none, 0.8, np.zeros(3), 0.03) == cone_margin(none, 0.8) == 0
    pressed = around(6)
    one, twice = (wrench_radius(pressed._replace(force=k * pressed.force), 0.8, np.zeros(3), 0.03) for k in (1, 2))
    assert twice == pytest.approx(2 * one)


@pytest.mark.parametrize("friction", [0.4, 0.8])
@pytest.mark.parametrize("degrees", [0, 10, 20])
def test_the_margin_is_what_a_tilted_face_leaves(degrees, friction):
    """Jaws that press along z on faces that are tilted: 1 - tan(angle) / friction."""
    angle = np.radians(degrees)
    normal = [[0, np.sin(angle), np.cos(angle)], [0, np.sin(angle), -np.cos(angle)]]
    pressed = contacts([[0, 0, -0.03], [0, 0, 0.03]], normal, np.array([[0, 0, -5.0], [0, 0, 5.0]]))
    expected = max(0, 1 - np.tan(angle) / friction)
    assert cone_margin(pressed, friction) == pytest.approx(expected, abs=1e-12)
