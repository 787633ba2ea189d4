"""Palpate: from CAD meshes to a visuo-tactile dataset.

Importing the package loads no engine; each of its packages imports its own when it is used.
"""

__version__ = "0.1.0"

# Public names, and the modules that they are imported from when they are used.
LAZY_EXPORTS = {"Dataset": "palpate.dataset", "reconstruct": "palpate.evaluation.reconstruct"}


def __getattr__(name: str):
    if name in LAZY_EXPORTS:
        import importlib

        return getattr(importlib.import_module(LAZY_EXPORTS[name]), name)
    raise AttributeError(f"module 'palpate' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*globals(), *LAZY_EXPORTS])
