"""The hand as plain data: kinematics, geoms with closed-form distances, sensors.

MuJoCo is imported only to read a user's model (`from_mjcf`, `model_files`) and to build one
(`palpate.hand.model`).
"""

from pathlib import Path

from palpate.hand.allegro import allegro
from palpate.hand.hand import MAX_OUT_OF_RANGE, MAX_PENETRATION, Hand
from palpate.sensor import DIGIT, Sensor

__all__ = ["MAX_OUT_OF_RANGE", "MAX_PENETRATION", "Hand", "allegro", "check_files", "from_mjcf", "model_files"]


def from_mjcf(path, sensors, gel_face: float = DIGIT.gel_face) -> Hand:
    """A user's hand, read from a MuJoCo model file; see `palpate.hand.mjcf.from_mjcf`."""
    from palpate.hand.mjcf import from_mjcf as read

    return read(path, sensors, gel_face)


def check_files(model, sensors, sensor: Sensor) -> list[str]:
    """What is likely a mistake in an own hand's files; see `palpate.hand.mjcf.check_files`."""
    from palpate.hand.mjcf import check_files as check

    return check(model, sensors, sensor)


def model_files(path) -> list[Path]:
    """The files that a user's model file needs; see `palpate.hand.mjcf.model_files`."""
    from palpate.hand.mjcf import model_files as find

    return find(path)
