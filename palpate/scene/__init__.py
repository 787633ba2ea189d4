"""Scenes as plain data: what each needs, and what it leaves out and why."""

from palpate.scene.plans import SCENES, Plan, plan

__all__ = ["SCENES", "Plan", "plan"]
