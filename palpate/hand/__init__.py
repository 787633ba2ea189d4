"""The hand as plain data: kinematics, geoms with closed-form distances, sensors.

MuJoCo is imported only to read a user's model (`from_mjcf`, `check_files`, `model_files`) and to build one
(`palpate.hand.model`).
"""

from palpate.hand.allegro import allegro
from palpate.hand.hand import DURATION, MAX_OUT_OF_RANGE, MAX_PENETRATION, Hand
from palpate.lazy import lazy_exports

of_mjcf, __getattr__ = lazy_exports(__name__, {"mjcf": ["check_files", "from_mjcf", "model_files"]})
__all__ = ["DURATION", "MAX_OUT_OF_RANGE", "MAX_PENETRATION", "Hand", "allegro", *of_mjcf]
