"""Pages to look at a run: `run_page` shows all of it, `object_page` one object with its grasps to turn with the mouse.

A page is one HTML file that needs no network; that of an object holds three.js (three.min.js, MIT).
"""

from palpate.lazy import lazy_exports

EXPORTS = {"page": ["object_page"], "scene": ["record_scene"], "index": ["run_page"]}
__all__, __getattr__ = lazy_exports(__name__, EXPORTS)
