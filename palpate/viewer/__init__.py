"""Pages to look at a run: `object_page` shows one object with its grasps to turn with the mouse, `run_page` lists all.

A page is one HTML file that needs no network; it holds three.js (three.min.js, MIT).
"""

from palpate.viewer.page import object_page, run_page
from palpate.viewer.scene import record_scene

__all__ = ["object_page", "record_scene", "run_page"]
