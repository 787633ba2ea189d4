"""Grasps, on the surface or across the object: placement of the palm, targets of the fingers, closing in MuJoCo,
penetration check, selection; and whether they hold."""

from palpate.grasp.antipodal import grasper_type
from palpate.grasp.frames import closing_frames, hold_grasps
from palpate.grasp.grasp import Grasper, GraspSet, check_hand, grasp_object

__all__ = ["GraspSet", "Grasper", "check_hand", "closing_frames", "grasp_object", "grasper_type", "hold_grasps"]
