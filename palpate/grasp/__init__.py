"""Grasps: placement of the palm, targets of the fingers, closing in MuJoCo, penetration check, selection."""

from palpate.grasp.grasp import GraspSet, grasp_object

__all__ = ["GraspSet", "grasp_object"]
