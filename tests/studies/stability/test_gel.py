"""The cases of a pressed gel hold, and fail without the code that guards them."""

import numpy as np
import pytest

from palpate.touch import gel as layer
from studies.stability import gel
from studies.stability.cases import FAILS, HOLDS, REJECTED, examine

CASES = {case.name: case for case in gel.CASES if case.name != "gels of 0.3 mm and 20 mm"}  # some seconds


@pytest.mark.parametrize("name", CASES)
def test_holds(name):
    rows = examine("gel", CASES[name], None)
    assert not [row for row in rows if row["verdict"] == FAILS]
    assert {row["verdict"] for row in rows} <= {HOLDS, REJECTED}


def plain_response(wavenumber, gel):
    """The layer's response with the hyperbolic functions as they are written."""
    k, (h, modulus, poisson) = np.maximum(wavenumber, 1e-6), gel
    kolosov, x = 3 - 4 * poisson, np.maximum(wavenumber, 1e-6) * h
    denominator = 2 * kolosov * np.cosh(2 * x) + 4 * x**2 + 1 + kolosov**2
    upright = (1 - poisson) * (2 * kolosov * np.sinh(2 * x) - 4 * x) / (modulus * k * denominator)
    return layer.Response(upright, upright, upright, upright)


def test_fails_if_the_response_overflows(monkeypatch):
    monkeypatch.setattr(layer, "response", plain_response)
    layer.face.cache_clear()
    case = next(case for case in gel.CASES if case.name == "gels of 0.3 mm and 20 mm")
    rows = examine("gel", case, None)
    layer.face.cache_clear()
    assert [row for row in rows if row["verdict"] == FAILS]
