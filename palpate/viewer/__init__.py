"""Pages to look at a run: `run_page` shows all of it, `object_page` one object with its grasps to turn with the mouse.
A page is one HTML file that needs no network; that of an object holds three.js (three.min.js, MIT)."""

from palpate.lazy import lazy_exports

EXPORTS = {"page": ["object_page", "record_scene"], "index": ["run_page"]}
__all__, __getattr__ = lazy_exports(__name__, EXPORTS)


def duration(seconds: float) -> str:
    """Hours, minutes, or seconds, as one reads them: `1 h 20 min`, `3 min 5 s`, `12 s`."""
    seconds = round(seconds)
    if seconds >= 3600:
        return f"{seconds // 3600} h {seconds % 3600 // 60} min"
    return f"{seconds // 60} min {seconds % 60} s" if seconds >= 60 else f"{seconds} s"
