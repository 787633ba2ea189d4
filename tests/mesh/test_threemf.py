"""3MF: what its build shows, with the core specification's and the production extension's references."""

import zipfile

import numpy as np
import pytest
import trimesh

from palpate import mesh
from palpate.batch import UnusableObject
from palpate.mesh.load import load
from tests.mesh.reading import CASES, CORNERS, SIDES, assert_same, measured, triangles

CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
EXTENSIONS = {
    "p": "http://schemas.microsoft.com/3dmanufacturing/production/2015/06",
    "m": "http://schemas.microsoft.com/3dmanufacturing/material/2015/02",
    "b": "http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02",
}
MODEL = "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"
TRIANGLES = [corner for a, b, c, d in SIDES for corner in ((a, b, c), (a, c, d))]


def box(number, kind="model", colours=("",) * 12, attributes=""):
    vertices = "".join('<vertex x="{:g}" y="{:g}" z="{:g}"/>'.format(*corner) for corner in CORNERS)
    faces = "".join(
        '<triangle v1="{}" v2="{}" v3="{}" {}/>'.format(*face, colour)
        for face, colour in zip(TRIANGLES, colours, strict=True)
    )
    return (
        f'<object id="{number}" type="{kind}" {attributes}><mesh><vertices>{vertices}</vertices><triangles>{faces}'
        "</triangles></mesh></object>"
    )


def holder(number, *components, attributes=""):
    inner = "".join(f"<component {component}/>" for component in components)
    return f'<object id="{number}" {attributes}><components>{inner}</components></object>'


def model(resources, *items, attributes=""):
    spaces = " ".join(f'xmlns:{prefix}="{space}"' for prefix, space in EXTENSIONS.items())
    build = "".join(f"<item {item}/>" for item in items)
    return (
        f'<?xml version="1.0"?><model xmlns="{CORE}" {spaces} {attributes}><resources>{resources}</resources>'
        f"<build>{build}</build></model>"
    )


def write(path, resources, *items, attributes="", others=(), start="/3D/3dmodel.model"):
    with zipfile.ZipFile(path, "w") as archive:
        relation = f'<Relationship Id="r" Target="{start}" Type="{MODEL}"/>'
        space = "http://schemas.openxmlformats.org/package/2006/relationships"
        archive.writestr("_rels/.rels", f'<Relationships xmlns="{space}">{relation}</Relationships>')
        archive.writestr(start[1:], model(resources, *items, attributes=attributes))
        for name, content in dict(others).items():
            archive.writestr(name, content)
    return load(path)[0]


def at(x, y=0, z=0, scale=1):
    return f'transform="{scale} 0 0 0 {scale} 0 0 0 {scale} {x} {y} {z}"'


def test_cases():
    block, two = (load(CASES / name)[0] for name in ("3mf-millimetre/block.3mf", "3mf-production-two-parts/two.3mf"))
    assert block.unit == 0.001 and np.ptp(triangles(block.parts), axis=(0, 1)).tolist() == [40, 30, 20]
    assert np.ptp(triangles(two.parts), axis=(0, 1)).tolist() == [40, 10, 40]
    assert sum(len(part.faces) for part in two.parts) == 24
    assert measured(triangles(two.parts))["volume"] == pytest.approx(5000)


def test_what_is_built_is_shown_as_often_and_nothing_else(tmp_path):
    resources = box(1) + box(2) + box(3, "support") + box(4, "other")
    loaded = write(
        tmp_path / "a.3mf", resources, 'objectid="1"', f'objectid="1" {at(3)}', 'objectid="3"', f'objectid="4" {at(6)}'
    )
    assert measured(triangles(loaded.parts))["box"] == [[0, 0, 0], [7, 1, 1]]
    assert measured(triangles(loaded.parts))["volume"] == pytest.approx(3)


def test_components_within_components_and_mirrors(tmp_path):
    """A turn about z and a shift of a component, then the item's: rows of coordinates times the matrix."""
    turn = 'transform="0 2 0 -2 0 0 0 0 2 1 2 3"'
    resources = (
        box(1) + holder(2, f'objectid="1" {turn}', f'objectid="1" {at(10)}') + holder(3, f'objectid="2" {at(0, 0, 20)}')
    )
    loaded = write(tmp_path / "a.3mf", resources, 'objectid="3" transform="-1 0 0 0 1 0 0 0 1 0 0 0"')
    first = CORNERS @ [[0, 2, 0], [-2, 0, 0], [0, 0, 2]] + [1, 2, 23]
    np.testing.assert_allclose(loaded.parts[0].vertices, first * [-1, 1, 1])
    assert measured(triangles(loaded.parts))["volume"] == pytest.approx(8 + 1)  # outwards, though mirrored
    assert measured(triangles(loaded.parts))["box"] == [[-11, 0, 20], [1, 4, 25]]


def test_parts_in_other_files(tmp_path):
    """Of an item and a component, with names of another case, and a model file of another name."""
    others = {"3D/Objects/a.model": model(box(7) + holder(8, f'objectid="7" {at(3)}'))}
    resources = holder(2, 'p:path="/3D/objects/A.model" objectid="8"')
    item = 'p:path="/3D/Objects/a.model" objectid="7"'
    loaded = write(tmp_path / "a.3mf", resources, 'objectid="2"', item, others=others, start="/3D/main.model",
                   attributes='requiredextensions="p"')  # fmt: skip
    assert measured(triangles(loaded.parts))["box"] == [[0, 0, 0], [4, 1, 1]]


@pytest.mark.parametrize(
    ("unit", "metres"),
    [("micron", 1e-6), ("millimeter", 1e-3), ("centimeter", 0.01), ("inch", 0.0254), ("foot", 0.3048), ("meter", 1),
     ("", 1e-3)],
)  # fmt: skip
def test_units(tmp_path, unit, metres):
    attributes = f'unit="{unit}"' if unit else ""
    assert write(tmp_path / "a.3mf", box(1), 'objectid="1"', attributes=attributes).unit == metres


@pytest.mark.parametrize("of", ["object", "triangle"])
def test_colours_and_textures_are_named_and_not_read(tmp_path, of):
    colour = 'pid="5" pindex="0"' if of == "object" else 'pid="5" p1="0"'
    group = '<basematerials id="5"><base name="a" displaycolor="#C81E1E"/></basematerials>'
    attributes, colours = (colour, [""] * 12) if of == "object" else ("", [*[""] * 11, colour])
    resources = group + box(1, colours=colours, attributes=attributes)
    (part,) = write(tmp_path / "a.3mf", resources, 'objectid="1"').parts
    assert measured(triangles([part]))["volume"] == pytest.approx(1)
    assert part.visual.material.baseColorFactor[0] == 204
    assert load(tmp_path / "a.3mf")[1] == {"a.3mf": "its colours and textures are not read: drawn in a plain grey"}


@pytest.mark.parametrize(
    ("resources", "attributes", "message"),
    [
        (box(1), 'requiredextensions="p b"', "requires an extension that is not read: .*beamlattice"),
        (box(1), 'requiredextensions="x"', "requires an extension that is not read: x"),
        (box(2), "", "object 1 of .* is missing"),
        (holder(1, 'objectid="1"'), "", "within itself"),
        (holder(1, 'objectid="7" p:path="/3D/gone.model"'), "", "gone.model"),
    ],
)
def test_what_cannot_be_read_is_said(tmp_path, resources, attributes, message):
    with pytest.raises(UnusableObject, match=message):
        write(tmp_path / "a.3mf", resources, 'objectid="1"', attributes=attributes)


def test_it_is_as_large_as_it_says(tmp_path):
    record = mesh.prepare(CASES / "3mf-millimetre/block.3mf", tmp_path / "out", scale="keep")
    assert record["diagonal"] == pytest.approx(np.linalg.norm([0.04, 0.03, 0.02]), rel=1e-5)


def test_beside_trimesh(tmp_path):
    ball, torus = (
        trimesh.creation.icosphere(subdivisions=2),
        trimesh.creation.torus(2, 0.5).apply_translation((0, 0, 3)),
    )
    scene = trimesh.Scene([ball, torus])
    scene.export(tmp_path / "a.3mf")
    assert_same(measured(triangles(load(tmp_path / "a.3mf")[0].parts)), measured(triangles([ball, torus])))
