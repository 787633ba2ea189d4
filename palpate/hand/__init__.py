"""The hand as plain data: kinematics, geoms with closed-form distances, sensors.

MuJoCo is imported only to read a user's model (`from_mjcf`, `check_files`, `model_files`) and to build one
(`palpate.hand.model`).
"""

from palpate.hand.allegro import allegro
from palpate.hand.hand import MAX_OUT_OF_RANGE, MAX_PENETRATION, Hand

OF_MJCF = ("check_files", "from_mjcf", "model_files")
__all__ = ["MAX_OUT_OF_RANGE", "MAX_PENETRATION", "Hand", "allegro", *OF_MJCF]


def __getattr__(name: str):
    if name in OF_MJCF:
        from palpate.hand import mjcf

        return getattr(mjcf, name)
    raise AttributeError(f"module 'palpate.hand' has no attribute {name!r}")
