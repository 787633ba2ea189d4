"""A sensor's own light, fitted to real images of balls and punches that are pressed into its gel.

An image tells where the contact is, and its circle or a stated depth how deep the indenter is. The elastic layer of
`palpate.touch.gel` gives the face; lights or a table of colours are fitted to how the face changes the untouched image.
The stiffness of the gel is not fitted: at a stated depth the face's shape does not depend on it.
"""

import csv
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from PIL import Image

from palpate.atomic import atomic_write
from palpate.configuration import ConfigError
from palpate.sensor import Sensor, read_background
from palpate.touch.gel import TOLERANCE, Layer, contact, face, response
from palpate.touch.pressing import shade_pressed
from palpate.touch.shading import flattened, monomials, normals

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
AROUND = 2.5  # radii of the contact: half the edge of the square that is fitted and measured, in the image
PIXELS = 40_000  # that are fitted, evenly of all images
WIDEST = 0.97  # of the ball's radius: contacts beyond are taken as this wide (circles by hand err by some pixels)
DIFFUSE = 255.0
MOST = 4  # lights of a colour
WORTH, LEAST = 0.05, 0.1  # share and grey levels by which one more has to lower the error
MERGED = np.deg2rad(4)  # lights of several colours nearer than this are one
NORMAL_DEGREE, PLACE_DEGREE = 5, 2  # of the table: place as Taxim's
ROUNDS, RIDGE, SMALL_ERROR = 4, 1e-6, 2.0  # of a fit of least absolute errors; grey levels below which squares count


class Indentation(NamedTuple):
    """What an image shows. Rows, columns and the radius are pixels of the image's file; (0, 0) is a pixel's centre."""

    image: Path
    row: float | None = None  # centre of the contact; None: found
    column: float | None = None
    radius: float | None = None  # of the contact's circle; None: found, if there is no depth
    depth: float | None = None  # m of the indenter from its first touch; None: as the circle states
    ball_radius: float | None = None  # m, of a ball
    punch_radius: float | None = None  # m, of a flat punch with a circular end


class Calibration(NamedTuple):
    """A fitted sensor and the images it was fitted to and measured on, as the sensor's pixels: (n, r, c, 3) uint8."""

    sensor: Sensor
    indentations: list[Indentation]  # with centres and circles that were found
    real: np.ndarray
    simulated: np.ndarray
    fitted: np.ndarray  # (n,) bool; the others measure
    error: np.ndarray  # (n,) mean absolute error around the contact, grey levels
    untouched_error: np.ndarray  # (n,) that of the untouched image
    noise: np.ndarray  # (n,) the untouched image's error elsewhere


def read_folder(
    folder: Path, ball_radius: float | None = None, circles: Path | None = None
) -> tuple[Path, list[Indentation]]:
    """The untouched image of a folder and its other images: those of its table, or all, of a ball (m) then.

    circles: CSV with a column `image` and any of the other fields of `Indentation`; default `circles.csv` in the
    folder, if it is there. Raises `ConfigError` for an image or indenter that is missing, and numbers that are none.
    """
    folder = Path(folder)
    images = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
    images = [path for path in images if not path.with_suffix(".yaml").exists()]  # the background of a sensor
    untouched = [path for path in images if path.stem == "untouched"]
    if len(untouched) != 1:
        raise ConfigError(f"{folder}: expected one image named untouched, as untouched.png, got {len(untouched)}")
    table = Path(circles) if circles else folder / "circles.csv"
    if circles or table.exists():
        with open(table, newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file, skipinitialspace=True))
    else:
        rows = [{"image": path.name} for path in images if path not in untouched]
    indentations = []
    for number, row in enumerate(rows, 2):
        if not (path := folder / str(row.get("image") or "?")).is_file():
            raise ConfigError(f"{table}, line {number}: image: no file {path}")
        try:
            values = {key: float(row[key]) for key in Indentation._fields[1:] if row.get(key)}
        except (TypeError, ValueError) as error:
            raise ConfigError(f"{table}, line {number}: {error}") from None
        if not values.keys() & {"ball_radius", "punch_radius"} and ball_radius:
            values["ball_radius"] = ball_radius
        shapes = values.keys() & {"ball_radius", "punch_radius"}
        if len(shapes) != 1 or any(not values[key] > 0 for key in shapes | (values.keys() & {"radius", "depth"})):
            raise ConfigError(
                f"{path}: expected a ball or a punch, and radii and depths above 0: {values or 'nothing'}"
            )
        if "punch_radius" in values and "depth" not in values:
            raise ConfigError(f"{path}: a punch needs a depth: its circle does not state it")
        indentations.append(Indentation(path, **values))
    if len(indentations) < 2:
        raise ConfigError(f"{folder}: expected two or more images beside the untouched one, got {len(indentations)}")
    return untouched[0], indentations


def find_circle(change: np.ndarray, ball: float | None = None) -> tuple[float, float, float | None]:
    """Row, column and radius, in pixels, of the contact of a ball in an image less the untouched one (r, c, 3).

    The centre is where the change's size is most symmetric under half a turn. Around it the size goes with the slope of
    a half-space under a ball (Hertz; Johnson, Contact Mechanics, 1985, eq. 3.42), whose contact's radius is fitted.
    ball: its radius, pixels; None: no radius is looked for.
    """
    from scipy import fft, ndimage

    size = np.abs(ndimage.gaussian_filter(change.astype(float), (1, 1, 0))).sum(axis=2)
    strong = np.maximum(size - 2 * np.median(size), 0)
    shape = [2 * n for n in size.shape]
    symmetry = fft.irfft2(
        fft.rfft2(strong, s=shape) ** 2, s=shape
    )  # of each point with that half a turn about a centre
    row, column = np.array(np.unravel_index(np.argmax(symmetry), shape)) / 2
    if ball is None:
        return row, column, None
    z, y = np.indices(size.shape)
    ring = np.rint(np.hypot(z - row, y - column)).astype(int).ravel()
    count = np.bincount(ring)[: int(3.5 * ball)]
    profile = np.bincount(ring, size.ravel())[: len(count)] / np.maximum(count, 1)
    places, weight = np.arange(len(count)), np.sqrt(np.arange(len(count)) + 1.0)
    errors, radii = [], np.arange(4, WIDEST * ball, 0.25)
    for radius in radii:
        t = np.maximum(places / radius, 1e-9)
        beyond = 2 / np.pi * (t * np.arcsin(1 / np.maximum(t, 1)) - np.sqrt(1 - 1 / np.maximum(t, 1) ** 2))
        slope = np.where(t < 1, t, beyond) * radius / ball
        model = np.stack([slope / np.sqrt(1 + slope**2), np.ones(len(t))], axis=1) * weight[:, None]
        fit = np.linalg.lstsq(model, profile * weight, rcond=None)[0]
        errors.append(np.sum((model @ fit - profile * weight) ** 2))
    return row, column, float(radii[np.argmin(errors)])


def contact_depth(radius: float, ball_radius: float, layer: Layer) -> float:
    """m that a ball goes into a layer if the contact has this radius, m. Raises ValueError if the ball is smaller."""
    if not radius < 1.1 * ball_radius:
        raise ValueError(
            f"a circle of radius {1e3 * radius:.3g} mm is no contact of a ball of radius {1e3 * ball_radius:.3g} mm"
        )
    radius = min(radius, WIDEST * ball_radius)
    edge, depth = radius / 16, radius**2 / ball_radius  # of pixels, the half-space's depth
    z, y = (np.indices((90, 90)) - 44.5) * edge
    for _ in range(4):
        pressure, _ = _pressed(_ball_gap(np.hypot(y, z), ball_radius), depth, (edge, edge), layer)
        depth *= radius**2 / (np.count_nonzero(pressure) * edge**2 / np.pi)
    return depth


def _ball_gap(away: np.ndarray, radius: float) -> np.ndarray:
    return np.where(away < radius, radius - np.sqrt(np.maximum(radius**2 - away**2, 0)), np.inf)


def _pressed(gap: np.ndarray, depth: float, pixel: tuple[float, float], layer: Layer) -> tuple[np.ndarray, np.ndarray]:
    """Pressure and indentation (r, c) of a face under a surface that is `gap` away at its first touch, at a depth."""
    start = np.maximum(depth - gap, 0)
    width = np.sqrt(np.count_nonzero(start) * pixel[0] * pixel[1])
    if not width:
        raise ValueError("the contact lies outside the image")
    moved = face(layer, gap.shape, tuple(pixel)).indentation
    pressure, move, _ = contact(moved, gap - depth, None, start / response(np.pi / width, layer).normal, TOLERANCE)
    return pressure, move


def press_indenter(indentation: Indentation, sensor: Sensor) -> tuple[np.ndarray, float]:
    """The face (r, c), m into the gel, that an indenter with a known centre makes, and the contact's radius, m.

    row, column, radius: pixels of the sensor. Of a convex face the indenter goes in along the face's normal.
    """
    layer = Layer(**sensor.require_material())
    z, y = np.indices(sensor.resolution)
    z, y = (z - indentation.row) * sensor.pixel[0], (y - indentation.column) * sensor.pixel[1]
    away, depth = np.hypot(y, z), indentation.depth
    if indentation.punch_radius:
        gap = np.where(away <= indentation.punch_radius, 0, np.inf)
    else:
        gap = _ball_gap(away, indentation.ball_radius)
        if depth is None:
            radius = indentation.radius * np.sqrt(sensor.pixel[0] * sensor.pixel[1])
            depth = contact_depth(radius, indentation.ball_radius, layer)
    centre = tuple(int(np.clip(np.rint(p), 0, n - 1)) for p, n in zip(indentation[1:3], sensor.resolution, strict=True))
    slopes = [slope[centre] for slope in np.gradient(sensor.face_sag, *sensor.pixel)]
    gap = gap + sensor.face_sag - sensor.face_sag[centre] - slopes[0] * z - slopes[1] * y
    pressure, move = _pressed(gap, depth, sensor.pixel, layer)
    return move, float(np.sqrt(np.count_nonzero(pressure) * sensor.pixel[0] * sensor.pixel[1] / np.pi))


def calibrate(
    folder: Path,
    sensor: Sensor,
    ball_radius: float | None = None,
    circles: Path | None = None,
    table: bool = False,
    press: Callable[[Indentation, Sensor], tuple[np.ndarray, float]] = press_indenter,
) -> Calibration:
    """Fit a sensor's light to every second image of a folder (`read_folder`), and measure on the others.

    sensor: its size, pixels and gel are kept; images are resized to its pixels. table: colours over normals rather than
    lights. press: another geometry of the face, to compare with. Raises `ConfigError` for a folder or a gel that is not
    as expected, ValueError for an impossible circle.
    """
    sensor.require_material()
    untouched, indentations = read_folder(folder, ball_radius, circles)
    background = read_background(untouched, sensor.resolution)
    real = np.stack([read_background(indentation.image, sensor.resolution) for indentation in indentations])
    changes, placed, moves, windows = real.astype(float) - background, [], [], []
    for indentation, change in zip(indentations, changes, strict=True):
        with Image.open(indentation.image) as picture:
            scale = sensor.resolution[0] / picture.height, sensor.resolution[1] / picture.width
        scaled = _placed(_scaled(indentation, *scale), change, sensor)
        placed.append(_scaled(scaled, 1 / scale[0], 1 / scale[1]))
        try:
            move, radius = press(scaled, sensor)
        except ValueError as error:
            raise ValueError(f"{indentation.image}: {error}") from None
        moves.append(move)
        windows.append(_window(scaled, radius, sensor))
    fitted, free, samples = np.arange(len(real)) % 2 == 0, normals(sensor.face_sag, sensor.pixel), []
    share = 1 + np.count_nonzero(np.array(windows)[fitted]) // PIXELS
    for number in np.flatnonzero(fitted):
        rows, columns = (places[number % share :: share] for places in np.nonzero(windows[number]))
        normal = normals(moves[number] + sensor.face_sag, sensor.pixel)[rows, columns]
        place = np.stack([columns, rows], axis=1)
        samples.append((normal, free[rows, columns], place, changes[number, rows, columns]))
    normal, flat, place, change = (np.concatenate(parts) for parts in zip(*samples, strict=True))
    lights = fit_table(normal, flat, place, change, sensor.resolution) if table else fit_lights(normal, flat, change)
    sensor = replace(sensor, lights=lights, diffuse=DIFFUSE, smoothing=None, background=background)
    simulated = np.stack([shade_pressed(move, sensor) for move in moves])
    error, still = (np.abs(images).mean(axis=3) for images in (real - simulated.astype(float), changes))
    means = [(error[n][near].mean(), still[n][near].mean(), still[n][~near].mean()) for n, near in enumerate(windows)]
    return Calibration(sensor, placed, real, simulated, fitted, *np.array(means).T)


def _scaled(indentation: Indentation, along_rows: float, along_columns: float) -> Indentation:
    """The same in other pixels: so many times as many in the rows' and the columns' direction."""
    row, column, radius = indentation[1:4]
    return indentation._replace(
        row=None if row is None else (row + 0.5) * along_rows - 0.5,
        column=None if column is None else (column + 0.5) * along_columns - 0.5,
        radius=radius and radius * np.sqrt(along_rows * along_columns),
    )


def _placed(indentation: Indentation, change: np.ndarray, sensor: Sensor) -> Indentation:
    """The same with the centre and, if nothing states the depth, the circle that the image shows."""
    find = indentation.depth is None and indentation.radius is None
    ball = indentation.ball_radius / np.sqrt(sensor.pixel[0] * sensor.pixel[1]) if find else None
    row, column, radius = find_circle(change, ball)
    if None in indentation[1:3]:
        indentation = indentation._replace(row=row, column=column)
    return indentation._replace(radius=radius) if find else indentation


def _window(indentation: Indentation, radius: float, sensor: Sensor) -> np.ndarray:
    """(r, c) bool, the square of `AROUND` radii (m) around the contact, on the gel."""
    z, y = np.indices(sensor.resolution)
    near = np.maximum(np.abs(z - indentation.row) * sensor.pixel[0], np.abs(y - indentation.column) * sensor.pixel[1])
    return (near <= AROUND * radius) & sensor.on_gel


def fit_lights(normal: np.ndarray, free: np.ndarray, change: np.ndarray) -> list[dict[str, Any]]:
    """Distant lights that explain a change of grey levels (n, 3), where normals `free` (n, 3) have become `normal`.

    Of each colour as many as lower the error. Lights of several colours in nearly one direction become one.
    """
    vectors = [(light, channel) for channel, goal in enumerate(change.T) for light in _one_colour(normal, free, goal)]
    lights: list[tuple[np.ndarray, np.ndarray]] = []  # sums of vectors, colours
    for light, channel in sorted(vectors, key=lambda pair: -np.linalg.norm(pair[0])):
        strength = np.linalg.norm(light)
        cosines = [light @ total / (strength * np.linalg.norm(total)) for total, _ in lights]
        if not lights or max(cosines) < np.cos(MERGED):
            lights.append((np.zeros(3), np.zeros(3)))
            cosines.append(1)
        total, colour = lights[int(np.argmax(cosines))]
        total += light
        colour[channel] += strength / DIFFUSE
    return [
        {"direction": np.round(total / np.linalg.norm(total), 5).tolist(), "colour": np.round(colour, 5).tolist()}
        for total, colour in lights
    ]


def _one_colour(normal: np.ndarray, free: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """(k, 3) lights of one colour for its change (n,): directions as long as their grey levels.

    One by one, each begun where it explains most of what is left, then all fitted anew.
    """
    from scipy.optimize import least_squares

    def shading(lights: np.ndarray) -> np.ndarray:
        return np.maximum(normal @ lights.T, 0) - np.maximum(free @ lights.T, 0)

    def wrong(lights: np.ndarray) -> np.ndarray:
        return shading(lights.reshape(-1, 3)).sum(axis=1) - goal

    def slope(lights: np.ndarray) -> np.ndarray:
        parts = [normal * (normal @ v > 0)[:, None] - free * (free @ v > 0)[:, None] for v in lights.reshape(-1, 3)]
        return np.concatenate(parts, axis=1)

    up, turn = (each.ravel() for each in np.meshgrid(np.deg2rad([10, 30, 50, 70]), np.arange(0, 2 * np.pi, np.pi / 12)))
    starts = np.stack([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)], axis=1)
    power = ((terms := shading(starts)) ** 2).sum(axis=0) + 1e-9
    lights, error = np.zeros((0, 3)), np.abs(goal).mean()
    while len(lights) < MOST:
        strength = np.maximum(-terms.T @ wrong(lights) / power, 1)
        best = np.argmax(strength**2 * power)
        start = np.concatenate([lights, [starts[best] * strength[best]]])
        start[:, 2] = np.maximum(start[:, 2], 1e-6)
        bounds = np.tile([-np.inf, -np.inf, 0], len(start)), np.inf  # none from behind the face
        fit = least_squares(wrong, start.ravel(), slope, bounds, loss="soft_l1", f_scale=SMALL_ERROR)
        now = np.abs(wrong(fit.x)).mean()
        if error - now < max(WORTH * error, LEAST):
            break
        lights, error = fit.x.reshape(-1, 3), now
    return lights


def fit_table(normal, free, place, change, resolution: Sequence[int]) -> dict[str, Any]:
    """The table of colours over normals (`Sensor.colour_table`) for such a change; place: (n, 2) columns and rows."""
    steepest = float(np.quantile(np.hypot(normal[:, 0], normal[:, 1]), 0.999))
    over_image = list(monomials(*(2 * place / (np.array(resolution[::-1]) - 1) - 1).T, PLACE_DEGREE, 0))
    parts = [flattened(each.astype(float), steepest) for each in (normal, free)]
    pairs = zip(*(monomials(*part, NORMAL_DEGREE, 1) for part in parts), strict=True)
    terms = DIFFUSE * np.stack([(one - other) * where for one, other in pairs for where in over_image], axis=1)
    factors = np.zeros((terms.shape[1], 3))
    for turn in range(ROUNDS):  # least squares, then least absolute errors by weights
        for channel, goal in enumerate(change.T):
            wrong = np.abs(terms @ factors[:, channel] - goal) if turn else np.zeros(len(goal))
            weighted = terms / np.maximum(wrong, SMALL_ERROR)[:, None]
            gram = weighted.T @ terms
            gram[np.diag_indices_from(gram)] += RIDGE * np.trace(gram) / len(gram)
            factors[:, channel] = np.linalg.solve(gram, weighted.T @ goal)
    polynomial = [[float(f"{factor:.6g}") for factor in row] for row in factors]
    return {"polynomial": polynomial, "normal": NORMAL_DEGREE, "place": PLACE_DEGREE, "steepest": round(steepest, 5)}


def write_sensor(sensor: Sensor, path: Path) -> None:
    """Write a sensor's file, and its background beside it as a PNG of the same name."""
    path = Path(path)
    image = path.with_suffix(".png")
    with atomic_write(image) as partial:
        Image.fromarray(sensor.background).save(partial)
    description = sensor.description() | {"name": path.stem, "background": image.name}
    with atomic_write(path) as partial:
        partial.write_text(yaml.safe_dump(description, sort_keys=False, default_flow_style=None, width=120))
