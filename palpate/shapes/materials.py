"""Parts of the procedural objects: solids with colours and pictures."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from manifold3d import Manifold
from numpy.random import Generator
from PIL import Image, ImageDraw, ImageFont
from trimesh.visual.material import PBRMaterial

from palpate.configuration import read_yaml
from palpate.shapes.solids import arctan2
from palpate.vision.image import linear

PALETTES = read_yaml(Path(__file__).with_name("palettes.yaml"))
LABEL = PALETTES.pop("label")


@dataclass(frozen=True, eq=False)
class Material:
    """A material: sRGB colour (3,) 0-255, metallic and roughness 0-1, and a picture instead of the colour."""

    name: str
    colour: tuple[int, ...]
    metallic: float = 0.0
    roughness: float = 0.5
    picture: Image.Image | None = None

    def to_pbr(self) -> PBRMaterial:
        """The material as trimesh writes it to glTF."""
        # glTF's and OBJ's colour factors are read as linear light.
        colour = (1, 1, 1) if self.picture is not None else linear(np.array(self.colour) / 255)
        return PBRMaterial(
            name=self.name,
            baseColorFactor=np.round(255 * np.array([*colour, 1])).astype(np.uint8),
            metallicFactor=float(self.metallic),
            roughnessFactor=float(self.roughness),
            baseColorTexture=self.picture,
        )


def choose(rng: Generator, palette: str, names: Sequence[str] = (), **shine: float) -> Material:
    """One of a palette's colours (or of `names` in it), a little lighter or darker, a little shifted. shine: `metallic`
    and `roughness`, in place of the palette's."""
    look = PALETTES[palette] | shine
    colours, roughness = look["colours"], look["roughness"]
    roughness = rng.uniform(*roughness) if isinstance(roughness, list) else roughness
    names = names or list(colours)
    name = names[rng.integers(len(names))]
    colour = np.array(colours[name]) * rng.uniform(0.85, 1.15) * rng.uniform(0.95, 1.05, 3)
    material = Material(name, tuple(np.clip(colour, 8, 245).astype(int).tolist()), look["metallic"], roughness)
    if palette != "wood":
        return material
    height, width = 96, 384  # of a picture with the grain along its width
    v, u = np.mgrid[0:height, 0:width] / [[[height]], [[width]]]
    waves = sum(
        rng.uniform(0.2, 1) * np.sin(2 * np.pi * (k * u + rng.uniform(-2, 2) * v) + rng.uniform(0, 6))
        for k in range(1, 5)
    )
    rings = np.sin(2 * np.pi * (rng.uniform(5, 11) * v + 0.25 * waves))
    fibre = rng.normal(size=(height, 1)) * 0.25 + rng.normal(size=(height, width // 32)).repeat(32, axis=1) * 0.15
    pixels = np.array(material.colour) * (1 + 0.14 * rings + 0.12 * fibre)[..., None]
    return replace(material, picture=Image.fromarray(np.clip(pixels, 0, 255).astype(np.uint8)))


def label(rng: Generator) -> Material:
    """A printed label: ground, frame, emblem, two lines of text."""
    width, height = 320, 200
    ground = tuple(LABEL["papers"][rng.integers(len(LABEL["papers"]))])
    ink = (30, 26, 24) if sum(ground) > 400 else (240, 226, 180)
    accent = tuple(int(c) for c in rng.integers(30, 220, 3))
    picture = Image.new("RGB", (width, height), ground)
    draw = ImageDraw.Draw(picture)
    frame = int(rng.integers(4, 14))
    draw.rectangle((frame, frame, width - frame, height - frame), outline=ink, width=3)
    draw.rectangle((0, height * 3 // 4, width, height * 3 // 4 + 12), fill=accent)
    x, y, r = width // 2, 52, 30
    emblem = rng.integers(3)
    if emblem == 0:
        draw.ellipse((x - r, y - r, x + r, y + r), fill=accent, outline=ink, width=3)
    elif emblem == 1:
        draw.polygon([(x, y - r), (x + r, y + r), (x - r, y + r)], fill=accent, outline=ink)
    else:
        draw.rectangle((x - 2 * r, y - r // 2, x + 2 * r, y + r // 2), fill=accent, outline=ink, width=3)
    brand, goods = (LABEL[key][rng.integers(len(LABEL[key]))] for key in ("brands", "goods"))
    draw.text((x, 114), brand, ink, ImageFont.load_default(44), anchor="mm")
    draw.text((x, 180), goods, ink, ImageFont.load_default(20), anchor="mm")
    return Material("label", ground, 0.0, 0.6, picture)


def interface(rng: Generator, aspect: float, old: bool) -> Material:
    """A lit phone screen; aspect = height / width. `old`: a small, flat-coloured menu of a feature phone."""
    width, height = 180, int(180 * aspect)
    top, bottom = rng.integers(20, 235, 3), rng.integers(20, 235, 3)
    mix = np.linspace(0, 1, height)[:, None, None]
    pixels = np.broadcast_to((1 - mix) * top + mix * bottom, (height, width, 3))
    picture = Image.fromarray(pixels.astype(np.uint8))
    draw = ImageDraw.Draw(picture)
    ink = (250, 250, 250) if (top + bottom).sum() < 780 else (20, 20, 24)
    clock = f"{rng.integers(0, 24):02d}:{rng.integers(0, 60):02d}"
    if old:
        draw.rectangle((0, 0, width, height // 8), fill=(30, 40, 90))
        draw.text((width // 2, height // 16), clock, (255, 255, 255), ImageFont.load_default(18), anchor="mm")
        for row, name in enumerate(("Messages", "Calls", "Camera", "Games")):
            draw.text((14, height * (0.2 + 0.19 * row)), name, ink, ImageFont.load_default(22))
        return Material("screen", (120, 140, 160), 0.0, 0.15, picture)
    draw.text((width // 2, 40), clock, ink, ImageFont.load_default(44), anchor="mm")
    rows = max(2, int((height - 130) // 42))
    for row in range(rows):
        for column in range(4):
            if rng.uniform() < 0.25:
                continue
            x, y = 12 + 41 * column, 76 + 42 * row
            draw.rounded_rectangle((x, y, x + 30, y + 30), 8, fill=tuple(int(c) for c in rng.integers(30, 250, 3)))
    draw.rounded_rectangle((6, height - 44, width - 6, height - 6), 12, fill=tuple(int(c) for c in (top + 30) % 256))
    return Material("screen", (90, 110, 140), 0.0, 0.12, picture)


def across(vertices: np.ndarray) -> np.ndarray:
    """Texture coordinates of a picture laid from +x over the bounds of vertices (n, 3), its width along y."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    return ((vertices - low) / np.maximum(high - low, 1e-9))[:, 1:]


def around(vertices: np.ndarray) -> np.ndarray:
    """Texture coordinates of a picture wrapped around z over the span of vertices (n, 3), seam at -x."""
    x, y, z = vertices.T
    return across(np.column_stack([x, arctan2(y, x), z]))


@dataclass(frozen=True)
class Part:
    """A closed solid of one material. `uv` maps vertices (n, 3) to texture coordinates (n, 2); default: `across`."""

    solid: Manifold
    material: Material
    uv: Callable[[np.ndarray], np.ndarray] = across
