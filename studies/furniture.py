"""Lays out a folder of real objects from two Debian packages, as `config/furniture.yaml` takes it.

    python -m studies.furniture ~/furniture [--packages FOLDER]

The packages are `sweethome3d-furniture` and `sweethome3d`: 920 pieces of furniture, vessels, lamps, plants, figures and
vehicles by some 200 authors. `apt-get download` fetches them, without root; `--packages` names a folder that has the
two files already. `config/furniture.csv` says which piece is in which class. Each piece gets a folder,
`<class>/<piece>/`, with its OBJ file, materials and textures; `licences.csv` has its author and licence. The catalogues
of the packages state how a model is turned before it stands as its front is seen: the copies are turned so.
"""

import argparse
import csv
import re
import subprocess
import sys
import tempfile
import zipfile
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath

import numpy as np

from palpate.atomic import atomic_write

PACKAGES = ("sweethome3d-furniture", "sweethome3d")
CLASSES = Path(__file__).parents[1] / "config/furniture.csv"
TURNED = (b"v", b"vn")  # lines of an OBJ file that a rotation changes


def download(folder: Path) -> None:
    """Fetch the two packages into a folder. Raises SystemExit, saying what to do, if that fails."""
    try:
        subprocess.run(["apt-get", "download", *PACKAGES], cwd=folder, check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        sys.exit(
            f"{error}: on a Debian system `apt-get update` first; elsewhere fetch the packages {' and '.join(PACKAGES)}"
            " from a Debian mirror, and name their folder by --packages"
        )


def libraries(packages: Path, unpacked: Path) -> list[Path]:
    """The archives with catalogues and models in the packages. Raises SystemExit if a package is missing."""
    for package in PACKAGES:
        files = sorted(packages.glob(f"{package}_*.deb"))
        if not files:
            sys.exit(f"{packages} has no {package}_*.deb")
        subprocess.run(["dpkg-deb", "--extract", files[-1], unpacked], check=True)
    return sorted(unpacked.glob("usr/share/sweethome3d/furniture/*.sh3f")) + [
        unpacked / "usr/share/sweethome3d/sweethome3d.jar"
    ]


def pieces(library: zipfile.ZipFile) -> Iterator[dict[str, str]]:
    """The pieces of a catalogue: id, name, model, creator and what else it states of each, and the licence."""
    (catalogue,) = [name for name in library.namelist() if name.endswith("FurnitureCatalog.properties")]
    by_number: dict[str, dict[str, str]] = defaultdict(dict)
    licence = ""
    for line in library.read(catalogue).decode("latin-1").splitlines():
        if match := re.fullmatch(r"(\w+)#(\d+)=(.*)", line):
            by_number[match[2]][match[1]] = match[3].strip()
        elif line.startswith("license="):
            licence = line.removeprefix("license=").strip()
    for piece in by_number.values():
        yield {**piece, "licence": licence}


def turned(obj: bytes, rotation: np.ndarray) -> bytes:
    """An OBJ file with its vertices and normals turned by a rotation (3, 3)."""
    lines = obj.splitlines(keepends=True)
    for number, line in enumerate(lines):
        word, *values = line.split()[:4] or [b""]
        if word in TURNED:
            x, y, z = rotation @ np.array(values, dtype=float)
            lines[number] = b"%s %.9g %.9g %.9g\n" % (word, x, y, z)
    return b"".join(lines)


def write_piece(library: zipfile.ZipFile, piece: Mapping[str, str], folder: Path) -> None:
    """Write a piece's OBJ file, and all files beside it in the library that it or its materials name."""
    model = PurePosixPath(piece["model"].lstrip("/"))
    content = library.read(str(model))
    if rotation := piece.get("modelRotation"):
        content = turned(content, np.array(rotation.split(), dtype=float).reshape(3, 3))
    folder.mkdir(parents=True)
    (folder / model.name).write_bytes(content)
    named = {*re.findall(rb"^mtllib\s+(.+?)\s*$", content, re.MULTILINE)}
    members = {*library.namelist()}
    for name in sorted(named):
        materials = str(model.parent / name.decode("latin-1"))
        if materials in members:
            text = library.read(materials)
            (folder / PurePosixPath(materials).name).write_bytes(text)
            for line in {*re.findall(r"^\s*map_\w+\s+(.+?)\s*$", text.decode("latin-1"), re.MULTILINE)}:
                words = line.split(" ")  # options, then a name, which may have spaces
                images = (str(model.parent / " ".join(words[first:])) for first in range(len(words)))
                if image := next((image for image in images if image in members), None):
                    (folder / PurePosixPath(image).name).write_bytes(library.read(image))


def lay_out(packages: Path, target: Path) -> Counter[str]:
    """Write the folder of objects, whole or not at all; returns how many each class has."""
    with CLASSES.open(newline="", encoding="utf-8") as table:
        class_of = {row["id"]: row["class"] for row in csv.DictReader(table)}
    licences = []
    with atomic_write(target) as partial, tempfile.TemporaryDirectory() as unpacked:
        for archive in libraries(packages, Path(unpacked)):
            with zipfile.ZipFile(archive) as library:
                for piece in pieces(library):
                    if class_name := class_of.pop(piece["id"], ""):
                        name = re.sub(r"[^a-z0-9]+", "-", piece["id"].lower()).strip("-")
                        write_piece(library, piece, partial / class_name / name)
                        licences.append((class_name, name, piece["name"], piece["creator"], piece["licence"]))
        if class_of:
            sys.exit(f"the packages lack {len(class_of)} pieces of {CLASSES}, such as {next(iter(class_of))}")
        with (partial / "licences.csv").open("w", newline="", encoding="utf-8") as table:
            csv.writer(table).writerows([("class", "piece", "name", "author", "licence"), *sorted(licences)])
    return Counter(class_name for class_name, *_ in licences)


def main() -> None:
    """Download, lay out, and say what there is."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("target", type=Path, help="the folder to write")
    parser.add_argument("--packages", type=Path, help="a folder with the two packages; without it they are downloaded")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if not args.packages:
            download(Path(folder))
        counts = lay_out(args.packages or Path(folder), args.target.expanduser())
    print(f"{args.target}: {counts.total()} objects:", ", ".join(f"{count} {name}" for name, count in counts.items()))


if __name__ == "__main__":
    main()
