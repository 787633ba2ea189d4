"""A scene as plain data; and, until they are gone, the plans of the engines that still have one."""

from palpate.scene.plans import SCENES, Plan, plan

__all__ = ["GRASP_ARRAYS", "SCENES", "Lights", "Plan", "Scene", "plan"]


def __getattr__(name: str):
    if name in ("GRASP_ARRAYS", "Lights", "Scene"):  # not before `palpate.mesh`, which imports plans
        from palpate.scene import scene

        return getattr(scene, name)
    raise AttributeError(f"module 'palpate.scene' has no attribute {name!r}")
