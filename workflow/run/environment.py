"""Whether this environment has the versions that Palpate is locked to."""

import re
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PIN = re.compile(r"([A-Za-z0-9_.-]+)==([^\s;#]+)")
MOST_NAMED = 5


def differences(requirements: Path | str) -> list[str]:
    """Packages that are installed in another version than a requirements file pins, each as `name 2.0 (locked: 1.0)`.

    Builds of one version (`2.13.0+cpu`) are the same. A package that is not installed says so when it is imported.
    """
    others = []
    for line in Path(requirements).read_text().splitlines():
        if pin := PIN.match(line):
            try:
                installed = version(pin[1])
            except PackageNotFoundError:
                continue
            if installed.partition("+")[0] != pin[2].partition("+")[0]:
                others.append(f"{pin[1]} {installed} (locked: {pin[2]})")
    return others


def warning(requirements: Path | str) -> str:
    """One line that names packages of another version; empty if there are none."""
    others = differences(requirements)
    more = f" and {len(others) - MOST_NAMED} more" if len(others) > MOST_NAMED else ""
    named = ", ".join(others[:MOST_NAMED])
    return f"this environment is not the locked one: {named}{more}; `make env` builds that" if others else ""
