"""Textures of every kind of pixel that files have: 8 bits of L, RGB or RGBA, of the same colours, as glTF has them."""

import io

import bpy
import numpy as np
import PIL.Image
import pytest
import trimesh
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from palpate.mesh.part import Files

RAMP = np.arange(256, dtype=np.uint8).reshape(16, 16)
COLOUR = np.stack([RAMP, RAMP.T, RAMP[::-1]], axis=2)
ALPHA = np.where(np.eye(16, dtype=bool), 90, 255).astype(np.uint8)


def grey(values):
    return PIL.Image.fromarray(values)


# What is written, how, and the pixels (16, 16) or (16, 16, 3 or 4) that it stands for.
PALETTE = PIL.Image.fromarray(COLOUR).quantize(32)
GREY_ALPHA = PIL.Image.merge("LA", [grey(RAMP), grey(ALPHA)])
CMYK = PIL.Image.fromarray(np.dstack([255 - COLOUR, np.zeros((16, 16), np.uint8)]), "CMYK")
SCALED = RAMP.astype(float) / 255
KINDS = {
    "float": (grey(SCALED.astype(np.float32)), "TIFF", RAMP),
    "float beyond": (grey((3 * SCALED - 1).astype(np.float32)), "TIFF", np.rint(255 * np.clip(3 * SCALED - 1, 0, 1))),
    "float nan": (grey(np.where(RAMP < 9, np.nan, SCALED).astype(np.float32)), "TIFF", np.where(RAMP < 9, 0, RAMP)),
    "16 bits": (grey(RAMP.astype(np.uint16) * 257), "PNG", RAMP),
    "16 bits of a TIFF": (grey(RAMP.astype(np.uint16) * 257), "TIFF", RAMP),
    "16 bits, dark": (grey(RAMP.astype(np.uint16)), "TIFF", np.rint(RAMP / 257)),
    "32 bits": (grey(np.rint(SCALED * (2**31 - 1)).astype(np.int32)), "TIFF", RAMP),
    "1 bit": (grey(RAMP > 99).convert("1"), "PNG", np.where(RAMP > 99, 255, 0)),
    "grey and alpha": (GREY_ALPHA, "PNG", np.dstack([RAMP, RAMP, RAMP, ALPHA])),
    "palette": (PALETTE, "PNG", np.asarray(PALETTE.convert("RGB"))),
    "palette of a GIF": (PALETTE, "GIF", np.asarray(PALETTE.convert("RGB"))),
    "CMYK": (CMYK, "TIFF", COLOUR),
    "LAB": (PIL.Image.new("LAB", (16, 16), (128, 128, 128)), "TIFF", np.full((16, 16), 119)),  # of lightness 50.2
    "grey": (grey(RAMP), "PNG", RAMP),
    "colours of a BMP": (grey(COLOUR), "BMP", COLOUR),
    "colours and alpha": (grey(np.dstack([COLOUR, ALPHA])), "TIFF", np.dstack([COLOUR, ALPHA])),
}


def written(picture, kind, **options):
    picture.save(file := io.BytesIO(), kind, **options)
    return file.getvalue()


def as_blender_reads(picture, folder):
    """Pixels (h, w, 4) 0..255 of the texture in a GLB as trimesh writes it and Blender reads it."""
    visual = TextureVisuals(uv=np.zeros((3, 2)), material=PBRMaterial(baseColorTexture=picture))
    path = folder / "a.glb"
    trimesh.Trimesh(np.eye(3), [[0, 1, 2]], visual=visual, process=False).export(path)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=str(path))
    (image,) = (image for image in bpy.data.images if image.size[0])
    pixels = np.empty(image.size[0] * image.size[1] * 4, dtype=np.float32)
    image.pixels.foreach_get(pixels)
    return 255 * pixels.reshape(image.size[1], image.size[0], 4)[::-1]


def four(pixels):
    pixels = np.asarray(pixels, dtype=float)
    pixels = np.dstack([pixels] * 3) if pixels.ndim == 2 else pixels
    return pixels if pixels.shape[2] == 4 else np.dstack([pixels, np.full(pixels.shape[:2], 255.0)])


@pytest.mark.parametrize("name", KINDS)
def test_pixels_of_any_kind_are_8_bits_of_the_same_colours(name, tmp_path):
    source, kind, expected = KINDS[name]
    files = Files(tmp_path / "a.obj")
    picture = files.picture("a", written(source, kind))
    assert picture.mode in ("L", "RGB", "RGBA") and not files.problems
    np.testing.assert_allclose(four(picture), four(expected), atol=0.501)
    np.testing.assert_allclose(as_blender_reads(picture, tmp_path), four(expected), atol=1)


@pytest.mark.parametrize(
    ("source", "key"), [(grey(RAMP), 7), (grey(COLOUR), (52, 67, 196)), (PALETTE, 7)], ids=["L", "RGB", "P"]
)
def test_a_colour_that_a_png_names_as_clear_is_clear(source, key):
    picture = Files("a.obj").picture("a", written(source, "PNG", transparency=key))
    named = (np.asarray(source).reshape(16, 16, -1) == key).all(axis=2)
    assert picture.mode == "RGBA" and named.any()
    np.testing.assert_array_equal(np.asarray(picture)[..., 3], np.where(named, 0, 255))


@pytest.mark.parametrize("mode", ["L", "RGB"])
def test_a_jpeg_keeps_its_own_quantisation_and_one_of_cmyk_becomes_a_png(mode, tmp_path):
    data = written(grey(COLOUR).convert(mode), "JPEG", quality=97)
    picture = Files("a.obj").picture("a", data)
    again = PIL.Image.open(io.BytesIO(written_as_trimesh_does(picture)))
    assert again.format == "JPEG" and again.quantization == PIL.Image.open(io.BytesIO(data)).quantization
    printed = Files("a.obj").picture("a", written(CMYK, "JPEG", quality=100))
    assert printed.format is None and printed.mode == "RGB"


def written_as_trimesh_does(picture):
    picture.save(file := io.BytesIO(), format="JPEG")
    return file.getvalue()


@pytest.mark.parametrize(
    ("mode", "kind"), [("RGB", "PNG"), ("RGB", "JPEG"), ("P", "PNG"), ("I;16", "PNG"), ("F", "TIFF")]
)
def test_a_picture_that_ends_too_early_is_an_error_when_it_is_read_or_written(mode, kind):
    noise = np.random.default_rng(0).integers(256, size=(64, 64), dtype=np.uint8)
    noise = noise.astype({"I;16": np.uint16, "F": np.float32}.get(mode, np.uint8))
    picture = grey(noise) if noise.dtype != np.uint8 else grey(noise).convert(mode)
    data = written(picture, kind)
    with pytest.raises((OSError, ValueError), match="truncated|a texture can't be read, cut"):
        Files("a.obj").picture("cut", data[: len(data) // 2]).save(io.BytesIO(), kind)
