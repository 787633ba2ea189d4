"""The hand as plain data: kinematics, geoms with closed-form distances, sensors.

MuJoCo is imported only to read a user's model (`from_mjcf`) and to build one (`palpate.hand.model`).
"""

from palpate.hand.allegro import allegro
from palpate.hand.hand import SENSORS, Hand

__all__ = ["SENSORS", "Hand", "allegro", "from_mjcf"]


def from_mjcf(path, sensors) -> Hand:
    """A user's hand, read from a MuJoCo model file; see `palpate.hand.mjcf.from_mjcf`."""
    from palpate.hand.mjcf import from_mjcf as read

    return read(path, sensors)
