"""Packages whose public names are imported when they are used: nothing waits for an engine that it does not need."""

from collections.abc import Callable, Collection, Iterable, Mapping
from importlib import import_module
from typing import Any


def lazy_exports(
    package: str, names: Mapping[str, Iterable[str]], modules: Collection[str] = ()
) -> tuple[list[str], Callable[[str], Any]]:
    """`__all__` and `__getattr__` of a package; names: its public names by the module that defines them;
    modules: those that are attributes, too."""
    module_of = {name: module for module, own in names.items() for name in own}

    def __getattr__(name: str) -> Any:
        if name in modules:
            return import_module(f"{package}.{name}")
        if name not in module_of:
            known = f"; there are {', '.join([*sorted(module_of), *sorted(modules)])}" if modules else ""
            raise AttributeError(f"module {package!r} has no attribute {name!r}{known}")
        return getattr(import_module(f"{package}.{module_of[name]}"), name)

    return sorted(module_of), __getattr__
