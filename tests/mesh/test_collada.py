"""COLLADA in the forms that others write, against what the file says, and beside Blender's import."""

import numpy as np
import PIL.Image
import pytest
from trimesh.transformations import rotation_matrix, scale_matrix, translation_matrix

from palpate.batch import UnusableObject
from palpate.mesh.load import load
from tests.mesh.reading import CASES, CORNERS, SIDES, assert_same, by_blender, measured, triangles

SCENE = '<library_visual_scenes><visual_scene id="s">{}</visual_scene></library_visual_scenes>'
SHOWN = '<scene><instance_visual_scene url="#s"/></scene>'
BOX = {"volume": pytest.approx(1), "area": pytest.approx(6)}
TWO_TURNS = "<rotate>0 0 1 90</rotate><rotate>1 0 0 90</rotate>"


def numbers(values):
    return " ".join(f"{value:.9g}" for value in np.ravel(values))


def source(name, values, params="XYZ"):
    values, accessor = np.asarray(values, float), "".join(f'<param name="{param}" type="float"/>' for param in params)
    return (
        f'<source id="{name}"><float_array id="{name}a" count="{values.size}">{numbers(values)}</float_array>'
        f'<technique_common><accessor source="#{name}a" count="{len(values)}" stride="{len(params)}">{accessor}'
        "</accessor></technique_common></source>"
    )


def geometry(primitives, name="g", positions=CORNERS, sources="", inputs=""):
    return (
        f'<geometry id="{name}"><mesh>{source(name + "p", positions)}{sources}<vertices id="{name}v">'
        f'<input semantic="POSITION" source="#{name}p"/>{inputs}</vertices>{primitives}</mesh></geometry>'
    )


def polylist(name="g", material="", inputs="", sides=SIDES, width=1):
    indices = np.repeat(np.concatenate(sides), width)
    return (
        f'<polylist count="{len(sides)}" {material}><input semantic="VERTEX" source="#{name}v" offset="0"/>{inputs}'
        f"<vcount>{numbers([len(side) for side in sides])}</vcount><p>{numbers(indices)}</p></polylist>"
    )


ONE = geometry(polylist())


def write(path, *, geometries=ONE, scene='<node><instance_geometry url="#g"/></node>', head="", shown=SHOWN,
          version="1.4.1", space="http://www.collada.org/2005/11/COLLADASchema", libraries=""):  # fmt: skip
    scene = SCENE.format(scene) if "<library_visual_scenes>" not in scene else scene
    path.write_text(
        f'<?xml version="1.0" encoding="utf-8"?><COLLADA xmlns="{space}" version="{version}"><asset>{head}'
        f"<up_axis>Z_UP</up_axis></asset>{libraries}<library_geometries>{geometries}</library_geometries>{scene}{shown}"
        "</COLLADA>"
    )
    return path


def facts(path):
    loaded, problems = load(path)
    return measured(triangles(loaded.parts)) | {"parts": loaded.parts, "unit": loaded.unit, "problems": problems}


def is_box(found, size=1):
    return found["volume"] == pytest.approx(size**3) and found["area"] == pytest.approx(6 * size**2)


# The cases.


def test_cases():
    hole, profile = facts(CASES / "dae-polygon-hole/frame.dae"), facts(CASES / "concave-polygon/u_profile.dae")
    assert (hole["area"], hole["volume"]) == (pytest.approx(32), pytest.approx(8))
    assert (profile["area"], profile["volume"]) == (pytest.approx(30), pytest.approx(7))
    assert facts(CASES / "dae-unit-inch/block.dae")["unit"] == 0.0254
    assert facts(CASES / "dae-unit-comma/block.dae")["unit"] == 0.01
    commas = facts(CASES / "dae-comma-colour/box.dae")
    assert is_box(commas)
    np.testing.assert_allclose(commas["parts"][0].visual.material.baseColorFactor, [204, 5, 5, 255])
    lost = facts(CASES / "dae-lost-material/two_boxes.dae")
    assert lost["volume"] == pytest.approx(2) and [len(part.faces) for part in lost["parts"]] == [12, 12]
    assert lost["problems"] == {"lost": "there is no such material: drawn in neutral grey"}
    assert [part.visual.material.baseColorFactor[0] for part in lost["parts"]] == [204, 128]


# Primitives.


@pytest.mark.parametrize("kind", ["triangles", "trifans", "tristrips", "polygons", "polylist", "several"])
def test_primitives(tmp_path, kind):
    """A box of sides as each kind can have them: of a quad, a fan has its corners around, a strip in z order."""
    strips = [(side[0], side[1], side[3], side[2]) for side in SIDES]
    triangle_list = [corner for a, b, c, d in SIDES for corner in (a, b, c, a, c, d)]
    lists = {"triangles": [triangle_list], "trifans": SIDES, "tristrips": strips, "polygons": SIDES}
    head = '<input semantic="VERTEX" source="#gv" offset="0"/>'
    made = {
        name: f"<{name} count='1'>{head}{''.join(f'<p>{numbers(p)}</p>' for p in each)}</{name}>"
        for name, each in lists.items()
    }
    made["polylist"] = polylist()
    made["lines"] = f"<lines count='1'>{head}<p>0 1</p></lines>"
    if kind == "several":  # half of the sides as strips, the other as fans; lines are none of the surface
        made[kind] = made["lines"] + "".join(
            f"<{name} count='1'>{head}{''.join(f'<p>{numbers(p)}</p>' for p in each)}</{name}>"
            for name, each in (("tristrips", strips[:3]), ("trifans", SIDES[3:]))
        )
    assert is_box(facts(write(tmp_path / "a.dae", geometries=geometry(made[kind]))))


def test_offsets_and_sets(tmp_path):
    """Normals, two sets of texture coordinates and colours with offsets of their own, and another order of columns."""
    uv = CORNERS[:, :2]
    sources = source("n", CORNERS - 0.5) + source("t0", 5 + uv, "ST") + source("t1", np.c_[uv, 0 * uv[:, :1]], "STP")
    inputs = (
        '<input semantic="TEXCOORD" source="#t1" offset="2" set="3"/><input semantic="NORMAL" source="#n" offset="1"/>'
        '<input semantic="TEXCOORD" source="#t0" offset="1" set="0"/>'
    )
    shapes = geometry(polylist(inputs=inputs, width=3, material='material="m"'), sources=sources)
    PIL.Image.new("RGB", (4, 4), (1, 2, 3)).save(tmp_path / "a b.png")
    bind = '<bind_vertex_input semantic="UV1" input_semantic="TEXCOORD" input_set="3"/>'
    path = write(tmp_path / "a.dae", geometries=shapes, scene=bound(bind), libraries=looks(TEXTURED, "a b.png"))
    found = facts(path)
    (part,) = found["parts"]
    assert is_box(found) and len(part.vertices) == 8
    np.testing.assert_allclose(part.visual.uv, part.vertices[:, :2])
    np.testing.assert_allclose(part.metadata["vertex_normals"] * np.sqrt(0.75), part.vertices - 0.5)
    assert part.visual.material.baseColorTexture.getpixel((0, 0)) == (1, 2, 3)


def test_colours_of_vertices_are_linear_light_of_parts_without_a_material(tmp_path):
    colours, inputs = np.random.default_rng(0).random((8, 4)), '<input semantic="COLOR" source="#c" offset="0"/>'
    for material, params in (("", "RGBA"), ("", "RGB"), ('material="m"', "RGB")):
        shapes = geometry(
            polylist(inputs=inputs, material=material), sources=source("c", colours[:, : len(params)], params)
        )
        path = write(tmp_path / "a.dae", geometries=shapes, scene=bound(), libraries=looks(DIFFUSE))
        (part,) = facts(path)["parts"]
        if material:
            assert "color" not in part.visual.vertex_attributes
        else:
            given = (
                np.round(255 * colours) if len(params) == 4 else np.c_[np.round(255 * colours[:, :3]), np.full(8, 255)]
            )
            np.testing.assert_array_equal(part.visual.vertex_attributes["color"], given)


# Nodes.


@pytest.mark.parametrize(
    ("transform", "expected"),
    [
        ("<translate>1 2 3</translate>", translation_matrix((1, 2, 3))),
        ("<scale>1 2 -3</scale>", np.diag([1.0, 2, -3, 1])),
        ("<rotate>1 2 3 40</rotate>", rotation_matrix(np.radians(40), (1, 2, 3))),
        (TWO_TURNS, rotation_matrix(np.pi / 2, (0, 0, 1)) @ rotation_matrix(np.pi / 2, (1, 0, 0))),
        ("<translate>1 0 0</translate><scale>2 2 2</scale>", translation_matrix((1, 0, 0)) @ scale_matrix(2)),
        ("<matrix>0 -1 0 5 1 0 0 6\n0 0 2 7 0 0 0 1</matrix>",
         [[0, -1, 0, 5], [1, 0, 0, 6], [0, 0, 2, 7], [0, 0, 0, 1]]),
    ],
)  # fmt: skip
def test_transforms(tmp_path, transform, expected):
    path = write(tmp_path / "a.dae", scene=f'<node>{transform}<instance_geometry url="#g"/></node>')
    (part,) = facts(path)["parts"]
    expected = np.array(expected, dtype=float)
    moved = CORNERS @ expected[:3, :3].T + expected[:3, 3]
    np.testing.assert_allclose(np.sort(part.vertices, axis=0), np.sort(moved, axis=0), atol=1e-12)
    assert part.volume == pytest.approx(abs(np.linalg.det(expected)))  # outwards, mirrored or not


NESTED = (
    "<library_nodes><node id='part'><translate>0 0 5</translate><instance_geometry url='#g'/><node><translate>0 0 5"
    "</translate><instance_geometry url='#g'/></node></node></library_nodes>"
)


def test_instances_within_instances(tmp_path):
    scene = (
        "".join(f"<node id='n{x}'><translate>{x} 0 0</translate><instance_node url='#part'/></node>" for x in (0, 3, 6))
        + "<node><instance_node url='#n3'/></node>"
        + "<node><translate>0 3 0</translate><instance_geometry url='#g'/></node>"
    )
    found = facts(write(tmp_path / "a.dae", scene=scene, libraries=NESTED))
    assert len(found["parts"]) == 9 and found["volume"] == pytest.approx(9)
    np.testing.assert_allclose(found["box"], [[0, 0, 0], [7, 4, 11]])


def test_the_scene_that_is_shown_and_all_if_none_is_named(tmp_path):
    scenes = "".join(
        f'<visual_scene id="{name}"><node><translate>{x} 0 0</translate><instance_geometry url="#g"/></node>'
        "</visual_scene>"
        for name, x in (("r", 0), ("s", 4))
    )
    scenes = f"<library_visual_scenes>{scenes}</library_visual_scenes>"
    assert facts(write(tmp_path / "a.dae", scene=scenes))["box"] == [[4, 0, 0], [5, 1, 1]]
    assert facts(write(tmp_path / "a.dae", scene=scenes, shown=""))["box"] == [[0, 0, 0], [5, 1, 1]]


def test_other_versions_and_spaces(tmp_path):
    for version, space in (("1.5.0", "http://www.collada.org/2008/03/COLLADASchema"), ("1.4.1", "")):
        assert is_box(facts(write(tmp_path / "a.dae", version=version, space=space)))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scene": '<node><instance_geometry url="#other"/></node>'}, "no geometry '#other'"),
        ({"scene": '<node><instance_node url="parts.dae#wheel"/></node>'}, "no node 'parts.dae#wheel'"),
        ({"scene": '<node id="n"><instance_node url="#n"/></node>'}, "within itself"),
        ({"scene": "<node><skew>45 0 1 0 1 0 0</skew></node>"}, "has a <skew>, which is not read"),
        ({"scene": "<library_visual_scenes/>", "shown": ""}, "no visual scene that shows"),
        ({"geometries": geometry(polylist(sides=[*SIDES, (0, 1, 8)]))}, "index 8 is out of bounds"),
        ({"geometries": geometry(polylist(sides=[*SIDES, (0, 1, -1)]))}, "negative"),
        ({"geometries": geometry(polylist()).replace(">0 0 0 ", ">0 0 ", 1)}, "cut off"),
        ({"geometries": geometry(polylist()).replace("<vcount>4", "<vcount>5", 1)}, "cut off"),
        ({"geometries": geometry(polylist()).replace(">0 0 0 ", ">0,5,1 0 0 ", 1)}, "commas, not decimal points"),
    ],
)  # fmt: skip
def test_what_is_missing_is_named(tmp_path, changes, message):
    with pytest.raises(UnusableObject, match=message):
        load(write(tmp_path / "a.dae", **changes))


def test_decimal_commas_everywhere(tmp_path):
    scene = '<node><translate>0,5 0 0</translate><instance_geometry url="#g"/></node>'
    shapes = geometry(polylist(), positions=CORNERS * 0.5).replace("0.5", "0,5")
    found = facts(write(tmp_path / "a.dae", geometries=shapes, scene=scene, head='<unit meter="0,01"/>'))
    assert is_box(found, 0.5) and found["box"][0] == [0.5, 0, 0] and found["unit"] == 0.01


# Materials.

DIFFUSE = "<phong><diffuse><color>0.1 0.2 0.3 0.5</color></diffuse><shininess><float>6</float></shininess></phong>"
TEXTURED = '<lambert><diffuse><texture texture="sam" texcoord="UV1"/></diffuse></lambert>'


def looks(shader, file="", image=None, params=None):
    """An effect's shader, and the image that `sam` names through a sampler and a surface, unless others are given."""
    if params is None:
        params = (
            '<newparam sid="sur"><surface type="2D"><init_from>img</init_from></surface></newparam>'
            '<newparam sid="sam"><sampler2D><source>sur</source></sampler2D></newparam>'
        )
    image = f"<init_from>{file}</init_from>" if image is None else image
    return (
        f'<library_images><image id="img">{image}</image></library_images><library_effects><effect id="e">'
        f'<profile_COMMON>{params}<technique sid="c">{shader}</technique></profile_COMMON></effect></library_effects>'
        '<library_materials><material id="red" name="Red"><instance_effect url="#e"/></material></library_materials>'
    )


def bound(inner="", target="#red"):
    return (
        '<node><instance_geometry url="#g"><bind_material><technique_common>'
        f'<instance_material symbol="m" target="{target}">{inner}</instance_material></technique_common>'
        "</bind_material></instance_geometry></node>"
    )


def material(path, libraries, scene=None):
    uv = source("t", CORNERS[:, :2], "ST")
    inputs = '<input semantic="TEXCOORD" source="#t" offset="0" set="0"/>'
    shapes = geometry(polylist(inputs=inputs, material='material="m"'), sources=uv)
    found = facts(write(path, geometries=shapes, scene=scene or bound(), libraries=libraries))
    assert is_box(found)
    return found["parts"][0].visual.material, found["problems"]


@pytest.mark.parametrize("shader", ["lambert", "phong", "blinn", "constant"])
def test_colours_are_linear_light(tmp_path, shader):
    of = "emission" if shader == "constant" else "diffuse"
    made, _ = material(tmp_path / "a.dae", looks(f"<{shader}><{of}><color>0.1 0.2 0.3 1</color></{of}></{shader}>"))
    np.testing.assert_array_equal(made.baseColorFactor, np.round(255 * np.array([0.1, 0.2, 0.3, 1])))
    assert made.metallicFactor == 0 and made.roughnessFactor == 1 and made.name == "Red" and made.emissiveFactor is None


def test_shininess_transparency_parameters_and_nothing_at_all(tmp_path):
    made, _ = material(tmp_path / "a.dae", looks(DIFFUSE))
    assert made.roughnessFactor == pytest.approx(0.5) and made.baseColorFactor[3] == 255
    param = '<newparam sid="tint"><float4>0.1 0.2 0.3 1</float4></newparam>'
    made, _ = material(
        tmp_path / "b.dae", looks('<lambert><diffuse><param ref="tint"/></diffuse></lambert>', params=param)
    )
    assert made.baseColorFactor[:3].tolist() == [26, 51, 76]
    made, problems = material(tmp_path / "c.dae", looks("<lambert/>"))
    assert made.baseColorFactor[:3].tolist() == [204] * 3 and not problems


IMAGE = ('<lambert><diffuse><texture texture="img" texcoord="UV1"/></diffuse></lambert>', "")
INSTANCE = '<newparam sid="sam"><sampler2D><instance_image url="#img"/></sampler2D></newparam>'


@pytest.mark.parametrize(
    "file", ["maps/a b.png", "maps/a%20b.png", "file://maps/a%20b.png", "file:///else/maps/a b.png", "./maps\\a b.png"]
)
@pytest.mark.parametrize("way", ["surface", "image", "instance", "ref"])
def test_textures(tmp_path, file, way):
    (tmp_path / "maps").mkdir()
    PIL.Image.new("RGB", (4, 4), (1, 2, 3)).save(tmp_path / "maps/a b.png")
    if "else" in file:  # the last part of a path elsewhere, beside the file
        (tmp_path / "maps/a b.png").rename(tmp_path / "a b.png")
    libraries = {
        "surface": looks(TEXTURED, file),
        "image": looks(IMAGE[0], file, params=""),
        "instance": looks(TEXTURED, file, params=INSTANCE),
        "ref": looks(TEXTURED, image=f"<init_from>\n <ref>{file}</ref>\n</init_from>"),
    }
    made, problems = material(tmp_path / "a.dae", libraries[way])
    assert not problems and made.baseColorTexture.getpixel((0, 0)) == (1, 2, 3)
    assert made.baseColorFactor.tolist() == [255] * 4


def test_what_materials_lack_is_grey_and_named(tmp_path):
    lacks = {
        "gone.png": looks(TEXTURED, "gone.png"),
        "img": looks(TEXTURED, image='<init_from><hex format="PNG">89504E47</hex></init_from>'),
        "nothing": looks('<lambert><diffuse><texture texture="nothing" texcoord="UV1"/></diffuse></lambert>'),
        "red": looks(DIFFUSE).replace('effect id="e"', 'effect id="f"'),
    }
    for name, libraries in lacks.items():
        made, problems = material(tmp_path / "a.dae", libraries)
        assert list(problems) == [name] and made.baseColorFactor[:3].tolist() == [128] * 3


# Skins and morphs.

MORPH = """<library_controllers><controller id="c"><morph source="#g" method="{method}">
<source id="mt"><IDREF_array id="mta" count="2">h k</IDREF_array><technique_common><accessor source="#mta" count="2">
<param name="IDREF" type="IDREF"/></accessor></technique_common></source>
<source id="mw"><float_array id="mwa" count="2">{weights}</float_array><technique_common>
<accessor source="#mwa" count="2"><param name="W" type="float"/></accessor></technique_common></source>
<targets><input semantic="MORPH_TARGET" source="#mt"/><input semantic="MORPH_WEIGHT" source="#mw"/></targets>
</morph></controller></library_controllers>"""
SKIN = """<library_controllers><controller id="c"><skin source="#g"><bind_shape_matrix>{bind}</bind_shape_matrix>
<source id="j"><Name_array id="ja" count="2">upper lower</Name_array><technique_common><accessor source="#ja" count="2">
<param name="JOINT" type="name"/></accessor></technique_common></source>
<source id="i"><float_array id="ia" count="32">{inverse}</float_array><technique_common>
<accessor source="#ia" count="2" stride="16"><param name="T" type="float4x4"/></accessor></technique_common></source>
<source id="w"><float_array id="wa" count="2">1 0.5</float_array><technique_common><accessor source="#wa" count="2">
<param name="WEIGHT" type="float"/></accessor></technique_common></source>
<joints><input semantic="JOINT" source="#j"/><input semantic="INV_BIND_MATRIX" source="#i"/></joints>
<vertex_weights count="8"><input semantic="JOINT" source="#j" offset="0"/>
<input semantic="WEIGHT" source="#w" offset="1"/><vcount>1 1 1 1 1 1 1 2</vcount>
<v>1 0 0 0 1 0 0 0 1 0 0 0 1 0 0 1 1 1</v></vertex_weights></skin></controller></library_controllers>"""
CONTROLLED = '<node>{}<instance_controller url="#c"><skeleton>#root</skeleton></instance_controller></node>'


@pytest.mark.parametrize(("method", "expected"), [("NORMALIZED", (2, 1, 1)), ("RELATIVE", (2.5, 1.5, 1.5))])
def test_morphs(tmp_path, method, expected):
    """Half way to a shape three times as wide, or half of that more."""
    shapes = "".join(
        geometry(polylist(name), name, CORNERS * (factor, 1, 1)) for name, factor in (("g", 1), ("h", 3), ("k", 9))
    )
    scene, morph = CONTROLLED.format(""), MORPH.format(method=method, weights="0.5 0")
    found = facts(write(tmp_path / "a.dae", geometries=shapes, scene=scene, libraries=morph))
    np.testing.assert_allclose(found["box"], [[0, 0, 0], expected])


def skinned(path, upper="0 0 1", names="upper lower"):
    """A box of two bones; bound where it is moved by (5, 0, 0) and the upper bone is at (0, 0, 1)."""
    bind, back = translation_matrix((5, 0, 0)), [np.eye(4), np.eye(4)]
    back[0] = translation_matrix((0, 0, -1))
    bones = (
        "<node id='root' sid='lower' type='JOINT'><node id='up' sid='upper' type='JOINT'>"
        f"<translate>{upper}</translate></node></node>"
    )
    skin = SKIN.format(bind=numbers(bind), inverse=numbers(back)).replace("upper lower", names)
    scene = CONTROLLED.format("<translate>0 0 70</translate>") + bones
    return write(path, scene=scene, libraries=skin)


def test_skins(tmp_path):
    """As it was bound: not where its node is. With the upper bone 2 higher its corners, z = 1, are so, one by half."""
    bound_at = facts(skinned(tmp_path / "a.dae"))
    np.testing.assert_allclose(bound_at["box"], [[5, 0, 0], [6, 1, 1]])
    posed = facts(skinned(tmp_path / "b.dae", "0 0 3"))
    (part,) = posed["parts"]
    expected = CORNERS + [5, 0, 0]
    expected[CORNERS[:, 2] == 1, 2] = 3
    expected[7, 2] = 2
    np.testing.assert_allclose(part.vertices[np.lexsort(part.vertices.T[::-1])], expected[np.lexsort(expected.T[::-1])])
    missing = facts(skinned(tmp_path / "c.dae", names="upper other"))
    np.testing.assert_allclose(missing["box"], [[5, 0, 0], [6, 1, 1]])
    assert "a joint is not in the scene" in missing["problems"]["c"]


def test_beside_blender(tmp_path):
    scene = "".join(
        f"<node id='n{x}'><translate>{x} 0 0</translate>{TWO_TURNS}<scale>1 2 {1 - x}</scale>"
        "<node><translate>0 0 5</translate><instance_geometry url='#g'/></node></node>"
        for x in (0, 3)
    )
    paths = [CASES / f"dae-{name}.dae" for name in ("lost-material/two_boxes", "unit-inch/block")]
    paths += [CASES / "concave-polygon/u_profile.dae", write(tmp_path / "a.dae", scene=scene)]
    for path, expected in zip(paths, by_blender(*paths), strict=True):
        found = facts(path)
        factor = found["unit"]
        found = measured(triangles(found["parts"]) * factor)
        assert_same(found, expected)
