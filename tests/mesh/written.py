"""One object written in every format by hand, so that what a reader makes of it can be compared."""

import base64
import json
import zipfile
from pathlib import Path

import numpy as np
import PIL.Image
import trimesh
from PIL import ImageDraw

BODY = trimesh.creation.icosphere(subdivisions=3)
AROUND = np.arctan2(BODY.vertices[:, 1], BODY.vertices[:, 0]) / (2 * np.pi) + 0.5
UV = np.stack([AROUND, BODY.vertices[:, 2] / 2 + 0.5], axis=1)  # origin at the lower left
FORMATS = ("obj", "glb", "gltf", "stl", "ply", "off", "dae", "3mf")
# Linear light; what a format has as sRGB is made of it.
RED, WHITE = (0.6, 0.03, 0.02), (0.9, 0.9, 0.9)


def picture() -> PIL.Image.Image:
    """Stripes and patches of several colours, dark and light."""
    image = PIL.Image.new("RGB", (256, 128), (250, 250, 245))
    draw = ImageDraw.Draw(image)
    for k in range(8):
        draw.rectangle((32 * k, 0, 32 * k + 15, 127), fill=(30 + 25 * k, 90, 200 - 20 * k))
    draw.ellipse((96, 30, 160, 100), fill=(200, 30, 30))
    return image


def srgb(linear) -> list[int]:
    linear = np.asarray(linear, dtype=float)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return np.round(255 * encoded).astype(int).tolist()


def write(folder: Path, suffix: str, colour=None, texture: bool = False, by: str = "material") -> Path:
    """The body in a folder, with a colour (linear) or the picture as its texture; by: material, vertex or face."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"body.{suffix}"
    if texture:
        picture().save(folder / "picture.png")
    {"glb": gltf, "3mf": threemf}.get(suffix, globals().get(suffix))(path, colour, texture, by)
    return path


def obj(path, colour, texture, by):
    lines = ["mtllib body.mtl", "usemtl skin"] if colour or texture else []
    shade = " {:g} {:g} {:g}".format(*np.array(srgb(colour)) / 255) if by == "vertex" else ""
    lines += ["v {:.7g} {:.7g} {:.7g}".format(*v) + shade for v in BODY.vertices]
    lines += ["vt {:.7g} {:.7g}".format(*t) for t in UV] if texture else []
    corner = "{0}/{0}" if texture else "{0}"
    lines += ["f " + " ".join(corner.format(i + 1) for i in face) for face in BODY.faces]
    path.write_text("\n".join(lines[2:] if by == "vertex" else lines) + "\n")
    map_kd = "Kd 0.1 0.1 0.1\nmap_Kd picture.png\n" if texture else "Kd {} {} {}\n".format(*colour or WHITE)
    path.with_suffix(".mtl").write_text("newmtl skin\n" + map_kd)


def gltf(path, colour, texture, by):
    """With the right material: metallic 0, roughness 1."""
    flipped = np.stack([UV[:, 0], 1 - UV[:, 1]], axis=1)
    blobs = [BODY.vertices.astype("<f4"), BODY.faces.astype("<u4").ravel(), flipped.astype("<f4")]
    data = b"".join(blob.tobytes() for blob in blobs)
    starts = np.cumsum([0] + [blob.nbytes for blob in blobs])
    low, high = BODY.vertices.min(axis=0).tolist(), BODY.vertices.max(axis=0).tolist()
    views = [{"buffer": 0, "byteOffset": int(s), "byteLength": b.nbytes} for s, b in zip(starts, blobs, strict=False)]
    material = {"metallicFactor": 0, "roughnessFactor": 1, "baseColorFactor": [*(colour or (1, 1, 1)), 1]}
    if texture:
        material["baseColorTexture"] = {"index": 0}
    tree = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 2}, "indices": 1, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": material}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(blobs[0]), "type": "VEC3", "min": low, "max": high},
            {"bufferView": 1, "componentType": 5125, "count": len(blobs[1]), "type": "SCALAR"},
            {"bufferView": 2, "componentType": 5126, "count": len(blobs[2]), "type": "VEC2"},
        ],
        "bufferViews": views, "buffers": [{"byteLength": len(data)}],
    }  # fmt: skip
    if texture:
        tree |= {"textures": [{"source": 0}], "images": [{"uri": "picture.png"}]}
    if path.suffix == ".gltf":
        if texture:
            path.with_suffix(".bin").write_bytes(data)
            tree["buffers"][0]["uri"] = "body.bin"
        else:
            tree["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
        path.write_text(json.dumps(tree))
        return
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = len(text).to_bytes(4, "little") + b"JSON" + text + len(data).to_bytes(4, "little") + b"BIN\0" + data
    path.write_bytes(b"glTF" + (2).to_bytes(4, "little") + (12 + len(chunks)).to_bytes(4, "little") + chunks)


def stl(path, *_):
    path.write_bytes(BODY.export(file_type="stl"))


def ply(path, colour, texture, by):
    head = ["ply", "format ascii 1.0"] + (["comment TextureFile picture.png"] if texture else [])
    head += [f"element vertex {len(BODY.vertices)}", *(f"property float {axis}" for axis in "xyz")]
    head += ["property float s", "property float t"] if texture else []
    rgb = [f"property uchar {name}" for name in ("red", "green", "blue")] if colour else []
    head += rgb if by != "face" else []
    head += [f"element face {len(BODY.faces)}", "property list uchar int vertex_indices"]
    head += rgb if by == "face" else []
    shade = " {} {} {}".format(*srgb(colour)) if colour else ""
    body = []
    for place, uv in zip(BODY.vertices, UV, strict=True):
        line = "{:.7g} {:.7g} {:.7g}".format(*place) + (" {:.7g} {:.7g}".format(*uv) if texture else "")
        body.append(line + (shade if by != "face" else ""))
    body += ["3 {} {} {}".format(*face) + (shade if by == "face" else "") for face in BODY.faces]
    path.write_text("\n".join([*head, "end_header", *body]) + "\n")


def off(path, colour, texture, by):
    shade = " {} {} {} 255".format(*srgb(colour)) if colour else ""
    lines = ["OFF" if by == "face" or not colour else "COFF", f"{len(BODY.vertices)} {len(BODY.faces)} 0"]
    lines += ["{:.7g} {:.7g} {:.7g}".format(*v) + (shade if by != "face" else "") for v in BODY.vertices]
    lines += ["3 {} {} {}".format(*face) + (shade if by == "face" else "") for face in BODY.faces]
    path.write_text("\n".join(lines) + "\n")


def dae(path, colour, texture, by, up="Z_UP"):
    def numbers(values):
        return " ".join(f"{value:.7g}" for value in np.ravel(values))

    diffuse = '<texture texture="sampler" texcoord="UV"/>' if texture else f"<color>{numbers([*colour, 1])}</color>"
    image = '<library_images><image id="i"><init_from>picture.png</init_from></image></library_images>'
    sampler = (
        '<newparam sid="surface"><surface type="2D"><init_from>i</init_from></surface></newparam>'
        '<newparam sid="sampler"><sampler2D><source>surface</source></sampler2D></newparam>'
    )
    path.write_text(f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>2020-01-01T00:00:00Z</created><modified>2020-01-01T00:00:00Z</modified><up_axis>{up}</up_axis></asset>
{image if texture else ""}
<library_effects><effect id="e"><profile_COMMON>{sampler if texture else ""}
<technique sid="common"><lambert><diffuse>{diffuse}</diffuse></lambert></technique></profile_COMMON></effect>
</library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="v"><float_array id="va" count="{BODY.vertices.size}">{numbers(BODY.vertices)}</float_array>
<technique_common><accessor source="#va" count="{len(BODY.vertices)}" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<source id="t"><float_array id="ta" count="{UV.size}">{numbers(UV)}</float_array><technique_common>
<accessor source="#ta" count="{len(UV)}" stride="2"><param name="S" type="float"/><param name="T" type="float"/>
</accessor></technique_common></source>
<vertices id="p"><input semantic="POSITION" source="#v"/></vertices>
<triangles count="{len(BODY.faces)}" material="s"><input semantic="VERTEX" source="#p" offset="0"/>
<input semantic="TEXCOORD" source="#t" offset="0" set="0"/><p>{" ".join(map(str, BODY.faces.ravel()))}</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="w"><node id="n"><instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="s" target="#m"><bind_vertex_input semantic="UV" input_semantic="TEXCOORD" input_set="0"/>
</instance_material></technique_common></bind_material></instance_geometry></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#w"/></scene></COLLADA>
""")


def threemf(path, colour, texture, by):
    path.write_bytes(BODY.export(file_type="3mf"))
    assert zipfile.is_zipfile(path)
