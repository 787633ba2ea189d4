"""Palpate: from CAD meshes to a visuo-tactile dataset.

Importing the package loads no engine; each of its packages imports its own when it is used.

    palpate.Dataset         reads a run
    palpate.reconstruct     predicts a mesh with a trained model; palpate.Reconstructor keeps the model
"""

import importlib
import pkgutil
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from palpate.dataset import Dataset
    from palpate.learning.reconstruct import Reconstructor, reconstruct
    from palpate.store import StoreError

__version__ = "0.4.0"
__all__ = ["Dataset", "Reconstructor", "StoreError", "__version__", "reconstruct"]

# Public names, and the modules that they are imported from when they are used.
LAZY_EXPORTS = {
    "Dataset": "palpate.dataset",
    "Reconstructor": "palpate.learning.reconstruct",
    "StoreError": "palpate.store",
    "reconstruct": "palpate.learning.reconstruct",
}
MODULES = {module.name for module in pkgutil.iter_modules(__path__)}


def __getattr__(name: str) -> Any:
    if name in LAZY_EXPORTS:
        return getattr(importlib.import_module(LAZY_EXPORTS[name]), name)
    if name in MODULES:
        return importlib.import_module(f"palpate.{name}")
    known = ", ".join([*sorted(LAZY_EXPORTS), *sorted(MODULES)])
    raise AttributeError(f"module 'palpate' has no attribute {name!r}; there are {known}")


def __dir__() -> list[str]:
    return sorted({*globals(), *LAZY_EXPORTS, *MODULES})
