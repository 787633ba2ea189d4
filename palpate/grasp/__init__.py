"""Grasps: where the palm goes, what the fingers aim at, how they close, and which grasps are kept."""

from palpate.grasp.grasp import GraspSet, grasp_object

__all__ = ["GraspSet", "grasp_object"]
