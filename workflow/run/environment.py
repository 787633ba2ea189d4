"""Whether this environment has the versions that Palpate is locked to."""

import re
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PIN = re.compile(r"([A-Za-z0-9_.-]+)==([^\s;#]+)")
MOST_NAMED = 5


def warning(requirements: Path | str) -> str:
    """One line that names packages in another version than a requirements file pins; empty if there are none.

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
    more = f" and {len(others) - MOST_NAMED} more" if len(others) > MOST_NAMED else ""
    named = ", ".join(others[:MOST_NAMED])
    return f"this environment is not the locked one: {named}{more}; `make env` builds that" if others else ""
