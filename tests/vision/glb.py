"""Files in glTF's binary form, changed."""

import base64
import io
import json
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
from PIL import Image as PillowImage

TEXTURE = 1024  # pixels, the side of the texture that is added and used by nothing


def rewrite_glb(glb: bytes, change: Callable[[dict[str, Any]], None]) -> bytes:
    """A glb file whose JSON a function has changed in place."""
    length = struct.unpack_from("<I", glb, 12)[0]
    tree = json.loads(glb[20 : 20 + length])
    change(tree)
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    rest = glb[20 + length :]
    return struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON") + text + rest


def add_unused_texture(tree: dict[str, Any]) -> None:
    """Add a material with a texture of noise, which no triangle uses, to a glTF's JSON."""
    noise = np.random.default_rng(0).integers(0, 256, (TEXTURE, TEXTURE, 3), dtype=np.uint8)
    data = io.BytesIO()
    PillowImage.fromarray(noise).save(data, "png", compress_level=1)
    uri = "data:image/png;base64," + base64.b64encode(data.getvalue()).decode()
    images, textures = tree.setdefault("images", []), tree.setdefault("textures", [])
    images.append({"uri": uri, "name": "unused"})
    textures.append({"source": len(images) - 1})
    colour = {"baseColorTexture": {"index": len(textures) - 1}}
    tree.setdefault("materials", []).append({"name": "unused", "pbrMetallicRoughness": colour})
