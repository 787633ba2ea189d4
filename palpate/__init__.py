"""Palpate: from CAD meshes to a visuo-tactile dataset.

Importing the package loads no engine; each of its packages imports its own when it is used.

    palpate.Dataset         reads a run
    palpate.reconstruct     predicts a mesh with a trained model; palpate.Reconstructor keeps the model
"""

import pkgutil
from typing import TYPE_CHECKING

from palpate.lazy import lazy_exports

if TYPE_CHECKING:
    from palpate.dataset import Dataset
    from palpate.learning.reconstruct import Reconstructor, reconstruct
    from palpate.store import StoreError

__version__ = "0.4.0"
__all__ = ["Dataset", "Reconstructor", "StoreError", "__version__", "reconstruct"]

EXPORTS = {"dataset": ["Dataset"], "learning.reconstruct": ["Reconstructor", "reconstruct"], "store": ["StoreError"]}
MODULES = {module.name for module in pkgutil.iter_modules(__path__)}
_, __getattr__ = lazy_exports(__name__, EXPORTS, MODULES)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, *MODULES})
