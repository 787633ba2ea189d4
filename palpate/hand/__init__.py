"""The hand as plain data: kinematics, geoms with closed-form distances, sensors.

MuJoCo is imported only to read a user's model (`from_mjcf`) and to build one (`palpate.hand.model`).
"""

from pathlib import Path

from palpate.hand.allegro import allegro
from palpate.hand.hand import SENSORS, Hand

__all__ = ["SENSORS", "Hand", "allegro", "from_mjcf", "load"]


def from_mjcf(path, sensors) -> Hand:
    """A user's hand, read from a MuJoCo model file; see `palpate.hand.mjcf.from_mjcf`."""
    from palpate.hand.mjcf import from_mjcf as read

    return read(path, sensors)


def load(settings: dict | None) -> Hand:
    """The hand of the config's `grasps: hand`: `{mjcf: path, sensors: path}`, or null for the Allegro."""
    return allegro() if settings is None else from_mjcf(Path(settings["mjcf"]), Path(settings["sensors"]))
