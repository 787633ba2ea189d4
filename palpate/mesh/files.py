"""The files that a mesh file names, read once; those that can't be used are reported by name."""

import io
import logging
from functools import partial
from pathlib import Path

import numpy as np
import PIL.Image

from palpate import named_files
from palpate.named_files import LARGEST_SIDE

PIL.Image.MAX_IMAGE_PIXELS = None  # sides are looked at instead; by itself PIL refuses textures of 16k
log = logging.getLogger(__name__)
OUTSIDE = "it lies outside the source's folder: copy it there, or link it"
DRAWN_GREY = "drawn in neutral grey"


class Files:
    """Reads what a mesh file names. root: the folder that it has to be in, as for `palpate.named_files.find`."""

    def __init__(self, path: Path, root: Path | str | None = None):
        self.path, self.root = path, root
        self.problems: dict[str, str] = {}  # by the name of a file or a part: what is wrong with it, and what follows

    def note(self, name: str, problem: str) -> None:
        """Record, and log once, what is wrong with a file or a part that the mesh file names, and what follows."""
        if name not in self.problems:
            log.warning("%s: %s: %s", self.path, name, problem)
        self.problems[name] = problem

    def read(self, name: str) -> bytes:
        """The content of a named file. Raises FileNotFoundError, with the reason."""
        place = named_files.find(self.path, name, self.root)
        if place is None:
            outside = named_files.is_outside(self.path, name, self.root)
            raise FileNotFoundError(f"{name}: {OUTSIDE if outside else 'there is no such file'}")
        return (self.path.parent / place).read_bytes()

    def picture(self, name: str, data: bytes | None = None, follows: str = DRAWN_GREY) -> PIL.Image.Image | None:
        """A named texture, or the one whose bytes are given; None, and a note of its name, if it can't be used. Raises
        ValueError, or at its export what PIL does, for one that is cut off."""
        problem = ""
        try:
            image = PIL.Image.open(io.BytesIO(self.read(name) if data is None else data))
            if max(image.size) > LARGEST_SIDE:
                problem = "it has {} x {} pixels, and at most {} a side can be used".format(*image.size, LARGEST_SIDE)
        except FileNotFoundError as error:
            problem = str(error).removeprefix(f"{name}: ")
        except Exception as error:  # whatever a broken file makes a reader trip over
            problem = f"it is no image that can be read ({type(error).__name__})"
        if problem:
            self.note(name, f"{problem}: {follows}")
            return None
        try:
            return _eight_bit(image)
        except (OSError, SyntaxError, ValueError) as error:  # PIL's
            raise ValueError(f"a texture can't be read, {name} ({type(error).__name__}: {error})") from None


def _eight_bit(image: PIL.Image.Image) -> PIL.Image.Image:
    """A picture as glTF can have it: 8 bits of L, RGB or RGBA. A JPEG of these is written as it was."""
    if image.mode in ("L", "RGB", "RGBA") and "transparency" not in image.info:
        if image.format == "JPEG":
            # Its own quantisation, not the writer's lower default.
            image.save = partial(image.save, quality="keep")  # type: ignore[method-assign]
        return image
    if image.mode[0] in "IF":
        values = np.nan_to_num(np.asarray(image, dtype=float))
        largest = 65535 if "16" in image.mode or values.max() <= 65535 else 2**31 - 1
        values = np.clip(values / (1 if image.mode == "F" else largest), 0, 1)
        return PIL.Image.fromarray(np.rint(255 * values).astype(np.uint8))
    return image.convert("RGBA" if image.has_transparency_data else "L" if image.mode == "1" else "RGB")
