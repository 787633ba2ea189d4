"""The exact depth of rays against closed forms and longer arithmetic."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate.touch import PIXEL_CENTRES, SENSOR_RANGE
from studies.exact_depth import Y, Z, exact_depth
from tests.studies.lumps import lumpy, poses


def test_reference_of_a_slanted_plane():
    y, z = np.array([-1, 1, 1, -1]) * 0.02, np.array([-1, -1, 1, 1]) * 0.02
    corners = np.column_stack([0.024 + 0.2 * y - 0.1 * z, y, z])
    expected = 0.024 + 0.2 * Y - 0.1 * Z
    expected[expected > SENSOR_RANGE] = np.inf
    assert 0.1 < np.isinf(expected).mean() < 0.9
    turn, place = Rotation.from_rotvec([0.4, -1.0, 2.0]).as_matrix(), np.array([0.1, -0.2, 0.3])
    triangles = corners[[[0, 1, 2], [0, 2, 3]]] @ turn.T + place
    np.testing.assert_allclose(exact_depth(triangles, place, turn).reshape(100, 100), expected, atol=1e-15)
    assert np.isinf(exact_depth(triangles[:0], place, turn)).all()


def test_reference_is_as_good_as_exact():
    """Longer arithmetic (64 bits of mantissa) changes no depth by 1e-12 m, and no pixel."""
    assert np.finfo(np.longdouble).eps < np.finfo(float).eps, "no longer arithmetic on this machine"
    made = lumpy()
    for position, rotation in zip(*poses(made, 4), strict=True):
        depth = exact_depth(made.triangles, position, rotation)
        longer = (part.astype(np.longdouble) for part in (made.triangles, position, rotation))
        exact = exact_depth(*longer)
        assert exact.dtype == np.longdouble and np.isfinite(depth).any()
        np.testing.assert_array_equal(np.isfinite(depth), np.isfinite(exact))
        touched = np.isfinite(depth)
        assert np.abs(depth[touched] - exact[touched]).max() < 1e-12


def test_reference_leaves_out_no_face():
    """As solving start + t x = a + u (b - a) + v (c - a) for every face, in the mesh's frame."""
    made = lumpy()
    position, rotation = (part[0] for part in poses(made, 1))
    rows, columns = np.random.default_rng(0).integers(100, size=(2, 200))
    depth = exact_depth(made.triangles, position, rotation).reshape(100, 100)[rows, columns]
    a, b, c = np.asarray(made.triangles).swapaxes(0, 1)
    system = np.stack([b - a, c - a, np.broadcast_to(-rotation[:, 0], a.shape)], axis=2)
    for found, y, z in zip(depth, PIXEL_CENTRES[columns], PIXEL_CENTRES[rows], strict=True):
        start = position + rotation @ [0, y, z]
        u, v, t = np.linalg.solve(system, (start - a)[..., None])[..., 0].T
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0) & (t <= SENSOR_RANGE)
        assert found == pytest.approx(t[hit].min(initial=np.inf), abs=1e-12)
