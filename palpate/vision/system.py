"""System libraries that Blender and MeshLab need: `python -m palpate.vision.system` names what is missing."""

import argparse
import ctypes
import os
import shutil
import subprocess
import sys
from collections.abc import Iterable

# Libraries that `bpy` 4.5 links against (`ldd`) and does not bring along, by Debian package (`dpkg -S`). The last is
# `pymeshlab`'s: without it most of its filters are missing.
PACKAGES = {
    **{"libX11.so.6": "libx11-6", "libXrender.so.1": "libxrender1", "libXfixes.so.3": "libxfixes3"},
    **{"libXi.so.6": "libxi6", "libxkbcommon.so.0": "libxkbcommon0", "libSM.so.6": "libsm6"},
    **{"libICE.so.6": "libice6", "libGL.so.1": "libgl1", "libOpenGL.so.0": "libopengl0"},
}


def missing_libraries() -> dict[str, str]:
    """The shared libraries that can't be loaded, each with the Debian package that has it."""
    missing = {}
    for library, package in PACKAGES.items():
        try:
            ctypes.CDLL(library)
        except OSError:
            missing[library] = package
    return missing


def install_command(packages: Iterable[str]) -> str:
    """The command that installs Debian packages."""
    return "apt-get install --yes --no-install-recommends " + " ".join(sorted(set(packages)))


def main(arguments: list[str] | None = None) -> int:
    """Name what is missing, or install it with `--install`; returns the exit status, 1 if libraries are missing."""
    parser = argparse.ArgumentParser(description="Name the system libraries that are missing.")
    parser.add_argument("--install", action="store_true", help="install them, as root on a system with apt")
    install = parser.parse_args(arguments).install
    missing = missing_libraries()
    if missing and install and os.geteuid() == 0 and shutil.which("apt-get"):
        command = install_command(missing.values())
        print(f"Blender and MeshLab need {', '.join(missing)}: {command}", file=sys.stderr)
        subprocess.run(["apt-get", "update", "--quiet"], check=False)
        subprocess.run(command.split(), check=False)
        missing = missing_libraries()
    if missing:
        print(f"Blender and MeshLab need {', '.join(missing)}. On Debian and Ubuntu, as root:", file=sys.stderr)
        print(install_command(missing.values()))
    elif not install:
        print("The system libraries of Blender and MeshLab are all there.")
    return int(bool(missing))


if __name__ == "__main__":
    sys.exit(main())
