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
from palpate.touch.gel import Layer, face, indent
from palpate.touch.reading import shade_pressed
from palpate.touch.shading import flattened, monomials, normals

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
AROUND = 2.5  # radii of the contact: half the edge of the square that is fitted and measured
PIXELS = 20_000  # that are fitted, evenly of all images
WIDEST = 0.97  # of the ball's radius: wider contacts are taken as this wide (circles by hand err by some pixels)
DIFFUSE = 255.0
MOST, WORTH, LEAST = 4, 0.05, 0.1  # lights of a colour; share of the error and grey levels that one more has to save
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
    indentations: list[Indentation]  # in the sensor's pixels, with centres and circles that were found
    real: np.ndarray
    simulated: np.ndarray
    fitted: np.ndarray  # (n,) bool; the others measure
    error: np.ndarray  # (n,) mean absolute error around the contact, grey levels
    untouched_error: np.ndarray  # (n,) that of the untouched image
    noise: np.ndarray  # (n,) the untouched image's error elsewhere


def read_folder(
    folder: Path, ball_radius: float | None = None, circles: Path | None = None
) -> tuple[Path, list[Indentation]]:
    """The untouched image of a folder and its other images: those of its table, or all, of a ball (m) then. circles:
    CSV with a column `image` and any of the other fields of `Indentation`; default `circles.csv` in the folder, if it
    is there. Raises `ConfigError` for an image or indenter that is missing, and numbers that are none."""
    files = sorted(path for path in Path(folder).iterdir() if path.suffix.lower() in SUFFIXES)
    images = [path for path in files if not path.with_suffix(".yaml").exists()]  # else a sensor's background
    untouched = [path for path in images if path.stem == "untouched"]
    if len(untouched) != 1:
        raise ConfigError(f"{folder}: expected one image named untouched, as untouched.png, got {len(untouched)}")
    table, indentations = Path(circles or Path(folder, "circles.csv")), []
    rows = [{"image": path.name} for path in images if path not in untouched]
    if circles or table.exists():
        rows = list(csv.DictReader(table.read_text("utf-8").splitlines(), skipinitialspace=True))
    for number, row in enumerate(rows, 2):
        path = Path(folder, str(row.get("image") or "?"))
        if not path.is_file():
            raise ConfigError(f"{table}, line {number}: image: no file {path}")
        try:
            values = {key: float(row[key]) for key in Indentation._fields[1:] if row.get(key)}
        except (TypeError, ValueError) as error:
            raise ConfigError(f"{table}, line {number}: {error}") from None
        if ball_radius and not values.keys() & {"ball_radius", "punch_radius"}:
            values["ball_radius"] = ball_radius
        lengths = [value for key, value in values.items() if key not in ("row", "column")]
        if ("ball_radius" in values) == ("punch_radius" in values) or not all(length > 0 for length in lengths):
            raise ConfigError(f"{path}: expected a ball or a punch, radii and depths above 0: {values or 'nothing'}")
        if "punch_radius" in values and "depth" not in values:
            raise ConfigError(f"{path}: a punch needs a depth: its circle does not state it")
        indentations.append(Indentation(path, **values))
    if len(indentations) < 2:
        raise ConfigError(f"{folder}: expected two or more images beside the untouched one, got {len(indentations)}")
    return untouched[0], indentations


def find_circle(change: np.ndarray, ball: float) -> tuple[float, float, float]:
    """Row, column and radius, pixels, of a ball's contact in an image less the untouched one (r, c, 3); ball: its
    radius. The change is most symmetric about the centre; its size goes with the slope of a half-space under a ball of
    the fitted radius of contact (Hertz; Johnson, Contact Mechanics, 1985, eq. 3.42)."""
    from scipy import ndimage, signal

    size = np.abs(ndimage.gaussian_filter(change.astype(float), (1, 1, 0))).sum(axis=2)
    strong = np.maximum(size - 2 * np.median(size), 0)
    symmetry = signal.fftconvolve(strong, strong)  # of each point with that half a turn about a centre
    row, column = np.array(np.unravel_index(np.argmax(symmetry), symmetry.shape)) / 2
    z, y = np.indices(size.shape)
    ring, places = np.rint(np.hypot(z - row, y - column)), np.arange(1, int(3.5 * ball))
    places = places[places <= ring.max()]
    profile, weight = ndimage.mean(size, ring, places), np.sqrt(places)

    def misfit(radius: float) -> float:
        t = places / radius
        inverse = np.minimum(1 / t, 1)
        slope = np.where(t < 1, t, 2 / np.pi * (t * np.arcsin(inverse) - np.sqrt(1 - inverse**2))) * radius / ball
        model = np.stack([slope / np.sqrt(1 + slope**2), np.ones(len(t))], axis=1) * weight[:, None]
        return float(np.linalg.lstsq(model, profile * weight, rcond=None)[1].sum())

    return row, column, float(min(np.arange(2, max(3, WIDEST * ball), 0.25), key=misfit))


def offsets(indentation: Indentation, sensor: Sensor) -> tuple[np.ndarray, ...]:
    """(r, c) m of the sensor's pixels from a contact's centre, along the rows' and the columns' direction: z, y."""
    places = zip(np.indices(sensor.resolution), indentation[1:3], sensor.pixel, strict=True)
    return tuple((place - centre) * edge for place, centre, edge in places)


def press_indenter(indentation: Indentation, sensor: Sensor) -> tuple[np.ndarray, float]:
    """The face (r, c), m into the gel, under an indenter with a known centre (pixels of the sensor), and the contact's
    radius, m. It goes in along a convex face's normal, a ball without a depth until its contact has the circle's area.
    Raises ValueError for a circle wider than the ball and a contact outside the image."""
    layer, sag, (height, width) = Layer(**sensor.require_material()), sensor.face_sag, sensor.pixel
    given: Any = indentation[1:]
    row, column, radius, depth, ball, punch = given
    z, y = offsets(indentation, sensor)
    away, wanted = np.hypot(y, z), 0
    cap = 0 if ball is None else ball - np.sqrt(np.maximum(ball**2 - away**2, 0))
    gap = np.where(away <= punch if ball is None else away < ball, cap, np.inf)
    if depth is None:
        radius *= np.sqrt(height * width)
        if not radius < 1.1 * ball:
            mm = f"{1e3 * radius:.3g} mm is no contact of a ball of radius {1e3 * ball:.3g} mm"
            raise ValueError(f"{indentation.image}: a circle of radius {mm}")
        radius = min(radius, WIDEST * ball)
        depth, wanted = radius**2 / ball, np.count_nonzero(away <= radius)  # at first the half-space's
    centre = tuple(int(np.clip(np.rint(p), 0, n - 1)) for p, n in zip((row, column), gap.shape, strict=True))
    along_z, along_y = (slope[centre] for slope in np.gradient(sag, *sensor.pixel))
    gap = gap + sag - sag[centre] - along_z * z - along_y * y
    gel = face(layer, gap.shape, sensor.pixel)
    for _ in range(6):
        if not (gap < depth).any():
            raise ValueError(f"{indentation.image}: the contact lies outside the image")
        pressure, (*_, move), _ = indent(gel, gap, depth=depth)
        count = np.count_nonzero(pressure)
        if not wanted or abs(wanted - count) <= 0.01 * wanted:
            break
        depth *= wanted / count
    return move, float(np.sqrt(count * height * width / np.pi))


def calibrate(
    folder: Path,
    sensor: Sensor,
    ball_radius: float | None = None,
    circles: Path | None = None,
    table: bool = False,
    press: Callable[[Indentation, Sensor], tuple[np.ndarray, float]] = press_indenter,
) -> Calibration:
    """Fit a sensor's light to every second image of a folder (`read_folder`), and measure on the others. sensor: its
    size, pixels and gel are kept. table: colours over normals rather than lights. press: another geometry of the face.
    Raises `ConfigError` for a folder or a gel that is not as expected, ValueError for an impossible circle."""
    sensor.require_material()
    untouched, indentations = read_folder(folder, ball_radius, circles)
    background = read_background(untouched, sensor.resolution)
    real = np.stack([read_background(indentation.image, sensor.resolution) for indentation in indentations])
    changes, placed, moves, windows = real.astype(float) - background, [], [], []
    for indentation, change in zip(indentations, changes, strict=True):
        placed.append(_place(indentation, change, sensor))
        move, radius = press(placed[-1], sensor)
        moves.append(move)
        windows.append((np.abs(offsets(placed[-1], sensor)).max(axis=0) <= AROUND * radius) & sensor.on_gel)
    fitted, around = np.arange(len(real)) % 2 == 0, np.array(windows)
    number, row, column = np.nonzero(around & fitted[:, None, None])
    used = tuple(places[:: 1 + len(row) // PIXELS] for places in (number, row, column))
    normal = normals(np.array(moves) + sensor.face_sag, sensor.pixel)[used]
    free = normals(sensor.face_sag, sensor.pixel)[used[1:]]
    if table:
        lights: Any = fit_table(normal, free, np.stack(used[:0:-1], axis=1), changes[used], sensor.resolution)
    else:
        lights = fit_lights(normal, free, changes[used])
    sensor = replace(sensor, lights=lights, diffuse=DIFFUSE, smoothing=None, background=background)
    simulated = np.stack([shade_pressed(move, sensor) for move in moves])
    error, still = np.abs(real - simulated.astype(float)).mean(axis=3), np.abs(changes).mean(axis=3)
    pairs = (error, around), (still, around), (still, ~around)
    means = [image.mean(axis=(1, 2), where=where) for image, where in pairs]
    return Calibration(sensor, placed, real, simulated, fitted, *means)


def _place(indentation: Indentation, change: np.ndarray, sensor: Sensor) -> Indentation:
    """The indentation in the sensor's pixels. A centre that is not given is found in the image, and so is the circle's
    radius if there is no depth either."""
    with Image.open(indentation.image) as picture:
        scale = sensor.resolution[0] / picture.height, sensor.resolution[1] / picture.width
    row, column, radius = indentation[1:4]
    shown: Sequence[float | None] = (None, None, None)
    if None in (row, column) or (radius or indentation.depth) is None:
        width = indentation.ball_radius or indentation.punch_radius
        shown = find_circle(change, width / np.sqrt(sensor.pixel[0] * sensor.pixel[1]))
    return indentation._replace(
        row=shown[0] if row is None else (row + 0.5) * scale[0] - 0.5,
        column=shown[1] if column is None else (column + 0.5) * scale[1] - 0.5,
        radius=radius * np.sqrt(scale[0] * scale[1]) if radius else shown[2],
    )


def fit_lights(normal: np.ndarray, free: np.ndarray, change: np.ndarray) -> list[dict[str, Any]]:
    """Distant lights, of one colour each, that explain a change of grey levels (n, 3), where normals `free` (n, 3) have
    become `normal`: one by one, where each explains most of what is left, while the error falls; then all of a colour
    anew."""
    from scipy.optimize import least_squares

    def shading(lights: np.ndarray) -> np.ndarray:
        return np.maximum(normal @ lights.T, 0) - np.maximum(free @ lights.T, 0)

    def wrong(lights: np.ndarray, goal: np.ndarray) -> np.ndarray:
        return shading(lights.reshape(-1, 3)).sum(axis=1) - goal

    up, turn = (a.ravel() for a in np.meshgrid(np.deg2rad([10, 30, 50, 70]), np.arange(0, 2 * np.pi, np.pi / 12)))
    starts = np.stack([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)], axis=1)
    terms, found = shading(starts), []
    power = (terms**2).sum(axis=0) + 1e-9
    for colour, goal in zip(np.eye(3), change.T, strict=True):
        lights, error = np.zeros((0, 3)), np.abs(goal).mean()  # directions as long as their grey levels
        while len(lights) < MOST:
            strength = np.maximum(-terms.T @ wrong(lights, goal) / power, 1)
            best = np.argmax(strength**2 * power)
            start = np.concatenate([lights, [starts[best] * strength[best]]])
            start[:, 2] = np.maximum(start[:, 2], 1e-6)
            bounds = np.tile([-np.inf, -np.inf, 0], len(start)), np.inf  # none from behind the face
            how = {"bounds": bounds, "loss": "soft_l1", "f_scale": SMALL_ERROR, "args": (goal,)}
            fit = least_squares(wrong, start.ravel(), **how).x
            now = np.abs(wrong(fit, goal)).mean()
            if error - now < max(WORTH * error, LEAST):
                break
            lights, error = fit.reshape(-1, 3), now
        for light in lights:
            direction, share = light / np.linalg.norm(light), colour * np.linalg.norm(light) / DIFFUSE
            found.append({"direction": np.round(direction, 5).tolist(), "colour": np.round(share, 5).tolist()})
    return found


def fit_table(
    normal: np.ndarray, free: np.ndarray, place: np.ndarray, change: np.ndarray, resolution: Sequence[int]
) -> dict[str, Any]:
    """The table of colours over normals (`Sensor.colour_table`) for such a change; place: (n, 2) columns and rows."""
    steepest = float(np.quantile(np.hypot(normal[:, 0], normal[:, 1]), 0.999))
    across, down = (2 * place / (np.array(resolution[::-1]) - 1) - 1).T
    over_image = list(monomials(across, down, PLACE_DEGREE, 0))
    parts = [flattened(unit.astype(float), steepest) for unit in (normal, free)]
    pairs = zip(*(monomials(y, z, NORMAL_DEGREE, 1) for y, z in parts), strict=True)
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
    image = path.with_suffix(".png")
    with atomic_write(image) as partial:
        Image.fromarray(np.asarray(sensor.background)).save(partial)
    description = sensor.description() | {"name": path.stem, "background": image.name}
    with atomic_write(path) as partial:
        partial.write_text(yaml.safe_dump(description, sort_keys=False, default_flow_style=None, width=120))
