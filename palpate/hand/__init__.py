"""The hand as plain data: kinematics, geoms with closed-form distances, sensors; MuJoCo only to read and build models."""

from palpate.hand.allegro import allegro
from palpate.hand.hand import SENSORS, Hand

__all__ = ["SENSORS", "Hand", "allegro"]
