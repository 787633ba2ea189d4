"""The study of a pressed gel: its methods against finite elements, at one small depth."""

import numpy as np
import pytest

from studies import finite_elements
from studies.error_vs_runtime import gel


@pytest.fixture(scope="module")
def case():
    profile = finite_elements.ball(0.003)
    pressed = finite_elements.Gel(*gel.LAYER, fine=0.0025, columns=40, rows=8).press(profile, 0.3e-3)
    return gel.Case(profile, 0.3e-3, pressed)


def test_errors(case):
    study = gel.study()
    errors = {(m.knob, m.value): study.errors(case, m.run(case)) for m in study.methods() if m.value != 200}
    chosen = next(errors[m.knob, m.value] for m in study.methods() if m.chosen)
    assert chosen["force"] < 6 and chosen["shape"] < 3 and chosen["sideways"] < 3
    taxim, raw = errors["Gaussians", 7], errors["Gaussians", 0]
    assert chosen["shape"] < 0.2 * min(taxim["shape"], raw["shape"])
    assert np.isnan(taxim["force"]) and errors["precision", "single"]["shape"] == pytest.approx(
        chosen["shape"], abs=0.05
    )
    assert errors["tolerance", 1e-1]["shape"] > errors["tolerance", 1e-5]["shape"] - 0.05
