"""What the pages share: templates of Jinja, files of this package that go into them, pictures as `data:` addresses."""

import base64
import io
from importlib import resources
from pathlib import Path

import jinja2
import numpy as np
from markupsafe import Markup
from PIL import Image

from palpate.atomic import atomic_write


def data_uri(image: np.ndarray | Image.Image, size: int | None = None) -> str:
    """An image (h, w, 3 or 4) uint8 as a `data:` address: PNG; with `size` WebP, at most so large."""
    picture, file = image if isinstance(image, Image.Image) else Image.fromarray(image), io.BytesIO()
    if size is None:
        picture.save(file, "PNG")
    else:
        picture.thumbnail((size, size))
        picture.save(file, "WEBP", quality=80, method=2)
    kind = "png" if size is None else "webp"
    return f"data:image/{kind};base64,{base64.b64encode(file.getvalue()).decode()}"


def resource(name: str) -> Markup:
    return Markup(resources.files("palpate.viewer").joinpath(name).read_text(encoding="utf-8"))


def render(path: Path, template: str, **values: object) -> None:
    """Write a page from a template of this package, whole or not at all. All values but `Markup` are escaped."""
    environment = jinja2.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja2.StrictUndefined
    )
    text = environment.from_string(str(resource(template))).render(values)
    with atomic_write(path) as partial:
        partial.write_text(text, encoding="utf-8")
