"""The layout of furniture, from two small packages of the same form as Debian's."""

import subprocess
import zipfile

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from studies import furniture

CUBE = b"""mtllib cube.mtl
v 0 0 0
v 1 0 0
v 0 2 0
v 0 0 3
vn 0 0 1
usemtl wood
f 1//1 2//1 3//1
f 1//1 2//1 4//1
"""
CATALOGUE = """# models
license=Free
id#1=maker#cube
name#1=Cube
creator#1=A. Maker
model#1=/models/cube.obj
id#2=maker#turned
name#2=Turned
creator#2=B. Maker
model#2=/models/cube.obj
modelRotation#2=0 -1 0 1 0 0 0 0 1
id#3=maker#left
name#3=Left
creator#3=C. Maker
model#3=/models/none.obj
"""
FILES = {
    "models/cube.obj": CUBE,
    "models/cube.mtl": b"newmtl wood\nmap_Kd -s 1 1 1 wood.png\n",
    "models/wood.png": b"png",
}


@pytest.fixture
def packages(tmp_path, monkeypatch):
    """A folder with the two packages; the first has the pieces, the second none."""
    table = tmp_path / "classes.csv"
    table.write_text("id,class\nmaker#cube,box\nmaker#turned,box\n")
    monkeypatch.setattr(furniture, "CLASSES", table)
    folder = tmp_path / "packages"
    folder.mkdir()
    for package, archive, catalogue in zip(
        furniture.PACKAGES, ("furniture/pieces.sh3f", "sweethome3d.jar"), (CATALOGUE, "license=Free\n"), strict=True
    ):
        root = tmp_path / package
        (root / "DEBIAN").mkdir(parents=True)
        fields = {"Package": package, "Version": "1", "Architecture": "all", "Maintainer": "-", "Description": "-"}
        (root / "DEBIAN/control").write_text("".join(f"{key}: {value}\n" for key, value in fields.items()))
        library = root / "usr/share/sweethome3d" / archive
        library.parent.mkdir(parents=True)
        with zipfile.ZipFile(library, "w") as content:
            content.writestr("PluginFurnitureCatalog.properties", catalogue)
            for name, data in FILES.items():
                content.writestr(name, data)
        subprocess.run(["dpkg-deb", "--build", root, folder / f"{package}_1_all.deb"], check=True, capture_output=True)
    return folder


def test_pieces_are_laid_out_by_class_with_what_they_name(packages, tmp_path):
    target = tmp_path / "laid out"
    assert furniture.lay_out(packages, target) == {"box": 2}
    files = sorted(str(path.relative_to(target)) for path in target.rglob("*") if path.is_file())
    names = ("cube.mtl", "cube.obj", "wood.png")
    cube = [f"box/maker-{piece}/{name}" for piece in ("cube", "turned") for name in names]
    assert files == [*cube, "licences.csv"]
    assert (target / "licences.csv").read_text().splitlines()[1:] == [
        "box,maker-cube,Cube,A. Maker,Free",
        "box,maker-turned,Turned,B. Maker,Free",
    ]


def test_a_piece_is_turned_as_its_catalogue_says(packages, tmp_path):
    furniture.lay_out(packages, tmp_path / "laid out")
    plain, turned = (
        trimesh.load(tmp_path / f"laid out/box/maker-{piece}/cube.obj", process=False) for piece in ("cube", "turned")
    )
    quarter = Rotation.from_euler("z", 90, degrees=True)
    np.testing.assert_allclose(turned.vertices, quarter.apply(plain.vertices.copy()), atol=1e-8)
    np.testing.assert_allclose(turned.face_normals, quarter.apply(plain.face_normals.copy()), atol=1e-8)


def test_a_piece_that_the_packages_lack_is_named(packages, tmp_path):
    with furniture.CLASSES.open("a") as table:
        table.write("maker#gone,box\n")
    with pytest.raises(SystemExit, match="lack 1 pieces .* such as maker#gone"):
        furniture.lay_out(packages, tmp_path / "laid out")
    assert not (tmp_path / "laid out").exists()


def test_a_missing_package_is_named(tmp_path):
    with pytest.raises(SystemExit, match="has no sweethome3d-furniture_"):
        furniture.lay_out(tmp_path, tmp_path / "laid out")
