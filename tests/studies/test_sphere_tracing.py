"""Sphere tracing, the paper's method, against ray casting and closed forms."""

import numpy as np

from palpate.touch import RayCaster
from studies.sphere_tracing import SphereTracer
from tests.touch.test_depth import IDENTITY, ORIGIN, Y, Z, lumpy, poses_near, sheet


def test_sphere_tracing_agrees_with_ray_casting():
    mesh = lumpy(2)
    position, rotation = poses_near(mesh, 6, seed=2, gap=(0.012, 0.02))
    cast = RayCaster(mesh).trace(position, rotation)
    traced = SphereTracer(mesh, tolerance=1e-6).trace(position, rotation)
    assert (np.isfinite(cast) != np.isfinite(traced)).mean() < 1e-3
    both = np.isfinite(cast) & np.isfinite(traced)
    assert both.sum() > 10_000
    early = cast[both] - traced[both]
    # Sphere tracing stops early, by the tolerance over the cosine of incidence; rays that pass within the
    # tolerance of an edge stop there.
    assert np.quantile(np.abs(early), 0.999) < 5e-5
    assert early.min() > -1e-7


def test_sphere_tracing_converges_with_its_tolerance():
    mesh = sheet(0.016, 0.5, 0.3)
    errors = [
        np.abs(SphereTracer(mesh, tolerance=t).trace(ORIGIN, IDENTITY)[0] - (0.016 + 0.5 * Y + 0.3 * Z)).max()
        for t in (1e-4, 1e-5, 1e-6)
    ]
    incidence = np.sqrt(1 + 0.5**2 + 0.3**2)
    assert errors[0] <= 1.01e-4 * incidence
    assert errors[1] <= 1.01e-5 * incidence
    assert errors[2] <= 1.01e-6 * incidence
