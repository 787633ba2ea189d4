"""Validation of pressed readings: right ones pass, and each kind of damage is caught."""

import numpy as np
import pytest
import trimesh

from palpate.dataset import checks
from palpate.dataset.checks import CHECKS, CheckedObject, check_touch
from palpate.sensor import load
from palpate.touch import RayCaster, face_sensor, press_sensors, sense


@pytest.fixture
def item(monkeypatch, tmp_path):
    """A ball before two sensors, of which one is pressed; and a third that it does not touch."""
    monkeypatch.setattr(checks, "can_check", lambda check: False)
    digit = load("digit")
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=0.006)
    mesh.apply_translation((digit.gel_face + 0.0065, 0.001, 0.002))
    position, rotation = np.zeros((1, 3, 3)), np.tile(np.eye(3), (1, 3, 1, 1))
    position[0, 2] = 1
    sensed = sense(RayCaster(mesh, sensor=digit), position, rotation)
    caster = RayCaster(mesh, sensor=face_sensor(digit))
    pressed = press_sensors(caster, digit, position, rotation, np.array([[0.5, 0.0, 0.0]]))
    pressed["reading"][~sensed.success] = 0
    rows = {"position": position, "rotation": rotation, **sensed._asdict(), **pressed}
    return CheckedObject({"touch": rows}, tmp_path, None, digit)


def worst(item) -> dict[str, float]:
    return {check: float(np.max(values)) for check, values in check_touch(item)}


def test_right_arrays_pass(item):
    assert all(value <= CHECKS[check].limit for check, value in worst(item).items())


@pytest.mark.parametrize(
    ("array", "sensor", "factor", "check"),
    [
        ("pressure", 0, 1.01, "pressed"),
        ("force", 0, 2, "pressed"),
        ("inside", 0, 0.5, "pressed"),
        ("indentation", 0, 1.5, "reading"),
        ("reading", 1, 0, "reading"),
    ],
)
def test_damage_is_caught(item, array, sensor, factor, check):
    values = item.rows["touch"][array]
    values[0, sensor] = (values[0, sensor] * factor).astype(values.dtype)
    assert worst(item)[check] > CHECKS[check].limit
