"""The pages: one HTML file each, with styles, scripts, pictures and the scene in it, so that it works offline."""

import base64
import io
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from html import escape
from importlib import resources
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from palpate.atomic import atomic_write
from palpate.catalogue import SPLITS
from palpate.dataset import Dataset, GraspRecord, ObjectRecord
from palpate.viewer.scene import KINDS, Y_UP, cameras, record_scene, sensor_colour

LABELS = {
    "object": "object",
    "hand": "hand",
    "gel": "readings on the sensors",
    "cloud": "touch clouds",
    "prediction": "prediction",
    "camera": "cameras",
}
HIDDEN_AT_FIRST = ("camera",)
OPACITIES = {"object": 1, "prediction": 0.6}
THUMBNAIL = 160  # pixels
MOST_OBJECTS = 2000  # of a run's page: some 8 kB each


def object_page(
    path: Path | str,
    record: ObjectRecord,
    grasps: Sequence[int] | None = None,
    predictions: Mapping[int, trimesh.Trimesh] | None = None,
    model: str = "",
) -> Path:
    """Write the page of one object, and the scene beside it as a `.glb`; both atomically.

    path: of the page, `.html`. grasps: numbers of those that are shown; all by default. predictions: meshes in the
    world frame by the number of the grasp, of the model that `model` names. Returns the path of the GLB file. Raises
    IndexError for a grasp that the object does not have.
    """
    path = Path(path)
    shown = _grasps(record, grasps)
    glb = record_scene(record, shown, predictions).export(file_type="glb")
    scene_file = path.with_suffix(".glb")
    data = {"glb": base64.b64encode(glb).decode(), "cameras": [_viewpoint(*each) for each in cameras(record)]}
    kinds = [kind for kind in KINDS if kind != "prediction" or predictions]
    boxes = "".join(
        f'<label><input type="checkbox" data-kind="{kind}"{"" if kind in HIDDEN_AT_FIRST else " checked"}> '
        f"{escape(f'{LABELS[kind]} of {model}' if kind == 'prediction' and model else LABELS[kind])}</label> "
        for kind in kinds
    )
    sliders = "".join(
        f'<label>{kind} <input data-opacity="{kind}" type="range" min="0" max="1" step="0.05" value="{value}"></label> '
        for kind, value in OPACITIES.items()
        if kind in kinds
    )
    choices = "".join(
        f'<label><input type="radio" name="grasp" value="{grasp.number}"{"" if place else " checked"}> '
        f"{grasp.number}</label>"
        for place, grasp in enumerate(shown)
    )
    buttons = "".join(
        f' <button data-camera="{number}">as camera {number} sees it</button>' for number in range(len(data["cameras"]))
    )
    body = f"""<body class="object">
<main><canvas id="view"></canvas><p id="message"></p></main>
<aside>
<h1>{escape(record.name)}</h1>
<p class="faint">{escape(record.class_name)}, {escape(record.split)} split, {escape(record.batch)}.
Turn: drag. Move: right button. Zoom: wheel.</p>
<p>{boxes}</p>
<p>Opacity: {sliders}</p>
<p><button id="whole">whole</button>{buttons}</p>
{f"<h2>Grasp</h2><p>{choices}</p>" if shown else ""}
{"".join(_grasp_part(grasp) for grasp in shown)}
{_object_images(record)}
<p class="faint">The scene is in {escape(scene_file.name)} too, y up. Metres.</p>
</aside>
<script id="page" type="application/json">{_json(data)}</script>
<script>{_resource("three.min.js")}</script>
<script>{_resource("viewer.js")}</script>
</body>"""
    with atomic_write(scene_file) as partial:
        partial.write_bytes(glb)
    _write(path, record.name, body)
    return scene_file


def run_page(path: Path | str, dataset: Dataset, most: int = MOST_OBJECTS) -> int:
    """Write the page that lists a dataset's objects with thumbnails, and links those whose page lies beside it.

    most: objects that are shown, the first ones. Returns their number.
    """
    path = Path(path)
    counts = Counter((record.class_name, record.split) for record in dataset)
    rows = "".join(
        f"<tr><td>{escape(kind)}</td>{''.join(f'<td>{counts[kind, split]}</td>' for split in SPLITS)}</tr>"
        for kind in dataset.classes
    )
    heads = "".join(f'<th class="faint">{split}</th>' for split in SPLITS)
    shown, stages = dataset[:most], dataset.stages
    cells = "".join(_cell(record, stages, path.parent, dataset.folder) for record in shown)
    left_out = f", the first {len(shown)} shown" if len(shown) < len(dataset) else ""
    body = f"""<body class="run">
<h1>{escape(dataset.name)}</h1>
<p>{len(dataset)} objects{left_out}; {len(dataset.rejections())} rejections; stages: {", ".join(stages)}.</p>
<table><tr><th class="faint">class</th>{heads}</tr>{rows}</table>
<p><input id="filter" type="search" placeholder="name, class or split"> <span id="count" class="faint"></span></p>
<div class="grid">{cells}</div>
<script>{_resource("list.js")}</script>
</body>"""
    _write(path, dataset.name, body)
    return len(shown)


def _grasps(record: ObjectRecord, numbers: Sequence[int] | None) -> list[GraspRecord]:
    has_grasps = {"grasps", "touch", "vision"} & set(record.stages)
    found = record.grasps if has_grasps else []
    if numbers is None:
        return found
    if wrong := [number for number in numbers if not 0 <= number < len(found)]:
        raise IndexError(f"{record.name} has no grasp {wrong[0]}: it has {len(found)}, numbered from 0")
    return [found[number] for number in numbers]


def _grasp_part(grasp: GraspRecord) -> str:
    """What the page shows of one grasp beside the scene: images, readings."""
    parts = []
    if "vision" in grasp.stages:
        parts.append(f'<div class="images">{_figures([seen.occluded for seen in _seen(grasp)], "in the hand")}</div>')
    if "touch" in grasp.stages:
        figures = "".join(
            _figure(
                grasp.reading[number],
                f'<span class="dot" style="background:{sensor_colour(number)}"></span>{escape(name)}, '
                + (f"{grasp.point_count[number]} points" if grasp.success[number] else "touches nothing"),
            )
            for number, name in enumerate(grasp.sensors)
        )
        parts.append(f'<h2>Readings</h2><div class="images readings">{figures}</div>')
    return f'<section data-grasp="{grasp.number}">{"".join(parts)}</section>'


def _object_images(record: ObjectRecord) -> str:
    if "vision" not in record.stages:
        return ""
    figures = _figures([seen.unoccluded for seen in _seen(record)], "alone")
    return f'<h2>Object alone</h2><div class="images">{figures}</div>'


def _seen(record):
    """A record of an object or a grasp, by each of its cameras."""
    return [record.seen_by(number) for number in range(record.cameras)]


def _figures(images: Sequence[np.ndarray], caption: str) -> str:
    """Figures of images (p, p, b): one a camera."""
    names = [caption] if len(images) == 1 else [f"{caption}, camera {number}" for number in range(len(images))]
    return "".join(_figure(image, escape(name)) for image, name in zip(images, names, strict=True))


def _figure(image: np.ndarray, caption: str) -> str:
    return f'<figure><img src="{data_uri(image)}" alt=""><figcaption>{caption}</figcaption></figure>'


def _cell(record: ObjectRecord, stages: Sequence[str], folder: Path, run: Path) -> str:
    """One object in the page of a run: thumbnail, name, class and split."""
    picture = _thumbnail(record, stages)
    image = f'<img src="{picture}" alt="" loading="lazy">' if picture else '<span class="none">no image</span>'
    name, page = escape(record.name), f"{record.name}.html"
    if (folder / page).exists():
        image, name = (f'<a href="{escape(page)}">{each}</a>' for each in (image, name))
    else:
        image = f'<span title="{escape(f"palpate view {run} {record.name}")}">{image}</span>'
    words = f"{record.name} {record.class_name} {record.split}".lower()
    caption = f"{name}<br>{escape(record.class_name)}, {escape(record.split)}"
    return f'<figure data-words="{escape(words)}">{image}<figcaption>{caption}</figcaption></figure>\n'


def _thumbnail(record: ObjectRecord, stages: Sequence[str]) -> str:
    """The object's image in small, as a data URI; empty if the run has none. stages: those of the run."""
    for stage, name in (("vision", "unoccluded"), ("views", "image")):
        if stage in stages:
            images = getattr(record, name)
            return data_uri(images.reshape(-1, *images.shape[-3:])[0], THUMBNAIL)
    return ""


def data_uri(image: np.ndarray, size: int | None = None) -> str:
    """An image (h, w, 3 or 4) uint8 as a `data:` address: PNG, or in small as WebP with this many pixels."""
    picture, file = Image.fromarray(image), io.BytesIO()
    if size is None:
        picture.save(file, "PNG")
    else:
        picture.thumbnail((size, size))
        picture.save(file, "WEBP", quality=80)
    kind = "png" if size is None else "webp"
    return f"data:image/{kind};base64,{base64.b64encode(file.getvalue()).decode()}"


def _viewpoint(intrinsics: np.ndarray, extrinsics: np.ndarray) -> dict[str, object]:
    """A camera as the page takes it, y up: where it is and looks at, and its vertical field of view in degrees."""
    turn, shift = extrinsics[:, :3], extrinsics[:, 3]
    centre = -turn.T @ shift
    along = turn[2]
    world = Y_UP[:3, :3]
    distance = max(0.1, float(np.linalg.norm(centre - (0, 0, 0.6))))
    field = 2 * np.degrees(np.arctan(intrinsics[1, 2] / intrinsics[1, 1]))
    places = {"position": centre, "target": centre + distance * along, "up": -turn[1]}
    return {name: (world @ place).tolist() for name, place in places.items()} | {"field": float(field)}


def _json(value: object) -> str:
    """JSON that may stand in a script element."""
    return json.dumps(value).replace("<", "\\u003c")


def _resource(name: str) -> str:
    return resources.files("palpate.viewer").joinpath(name).read_text(encoding="utf-8")


def _write(path: Path, title: str, body: str) -> None:
    text = (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{escape(title)}</title>\n'
        f'<meta name="viewport" content="width=device-width">\n<style>\n{_resource("viewer.css")}</style>\n</head>\n'
        f"{body}\n</html>\n"
    )
    with atomic_write(path) as partial:
        partial.write_text(text, encoding="utf-8")
