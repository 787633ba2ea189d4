"""The hand as plain data: kinematics, geoms with closed-form distances, sensors. MuJoCo is for models only."""

from palpate.hand.hand import DURATION, MAX_OUT_OF_RANGE, MAX_PENETRATION, Hand, allegro
from palpate.lazy import lazy_exports

of_mjcf, __getattr__ = lazy_exports(__name__, {"mjcf": ["check_files", "from_mjcf", "model_files"]})
__all__ = ["DURATION", "MAX_OUT_OF_RANGE", "MAX_PENETRATION", "Hand", "allegro", *of_mjcf]
