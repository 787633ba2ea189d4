"""A config looked at before its run, in seconds: its objects, its hand, and one object through every stage."""

import logging
import re
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import accumulate, zip_longest
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from palpate import catalogue, named_files, sensor
from palpate import hand as hands
from palpate.atomic import atomic_write
from palpate.batch import UnusableObject, generator
from palpate.catalogue import Source, SourceObject
from palpate.catalogue.source import FORMAT_UP, LAYOUTS
from palpate.configuration import ConfigError, absolute, check, read_config
from palpate.experiments import Experiments
from palpate.hand import DURATION, Hand
from palpate.learning.recipes import Recipe, tuning_grid
from palpate.sensor import Sensor

DEFAULT, SCHEMA = "config/config.yaml", "workflow/schemas/config.schema.yaml"
FILES = "the config (config/config.yaml with --configfile and --config)"  # as messages name it
# Meshes that are opened, of each class in turn: so many at most, and so many bytes after the first.
MOST_OPENED, MOST_BYTES = 24, 30_000_000
TRIED = 3  # objects that are tried for the example of a class
EXAMPLES, EXAMPLE_SECONDS = 6, 60.0  # classes that have one, at most; after this time no other begins
COMPARED_BYTES = 300_000_000  # of files of one size, whose checksums are compared
MOST_READ = 1000  # mesh files whose beginnings are looked at
NAMED = 3  # files or groups that a line names
IMAGE = {"size": 192, "samples": 8}  # of the example, at most


class Settings(NamedTuple):
    """What a config means."""

    folder: str  # the run's
    source: Source
    classes: dict[str, int | str]  # objects of each
    entries: list[SourceObject]
    batch_size: int
    batches: dict[str, str]  # of each object that the run has had
    hand: tuple[str, str] | None  # absolute paths of an own hand's files: its model and its sensors
    sensor: Sensor
    experiments: Experiments
    recipe: Recipe


def checked(path: str) -> str:
    """The path. Raises `ConfigError` for one in which Snakemake would see a wildcard."""
    if re.search(r"\{\s*\w+\s*(,([^{}]|\{[\d,]+\})*)?\}|<[a-z][a-z0-9_]*>", path):
        raise ConfigError(f"{path}: Snakemake takes {{...}} and <...> in a path for placeholders: rename it")
    return path


def resolve(config: Mapping[str, Any], project: Path | str) -> Settings:
    """What a config that fits the schema means; no mesh is opened. Relative paths are the project's. Raises
    `ConfigError` and `catalogue.CatalogueError`, with the remedy, for what is missing, invalid or contradictory, and
    for another run's folder."""
    folder = str(Path(absolute(config["results"], project), config["run"]))
    catalogue.check_same_run(folder, config, project)
    settings, schemas, training = Path(project, "config"), Path(project, "workflow/schemas"), config["training"]
    experiments = Experiments.read(settings / "experiments.yaml", schemas / "experiments.schema.yaml")
    chosen = training["recipe"], training["override"]
    recipe = Recipe.read(settings / "recipes.yaml", *chosen, schemas / "recipes.schema.yaml")
    tuning_grid(settings / "tuning.yaml", config["tuning"]["grid"])
    source = Source.from_config(config, project)
    classes = catalogue.class_counts(config, source)
    entries = catalogue.scan(source, classes)
    for entry in entries:
        checked(f"{source.path}/{entry.source}")
    batch_size, places = catalogue.read_batches(folder, config["batch_size"], len(entries))
    grasps, own = config["grasps"], config["grasps"]["hand"]
    hand = (absolute(own["mjcf"], project), absolute(own["sensors"], project)) if own else None
    touch_sensor = sensor.load(config["touch"]["sensor"], project)
    for path in hand or ():
        if not Path(path).is_file():
            raise ConfigError(f"config grasps.hand: {path}: no such file")
    if config["touch"]["pressed"] or config["press"]["count"]:
        touch_sensor.require_material()
    frames, states = config["frames"], round(DURATION / grasps["timestep"]) + 1
    contradictions = {
        "grasps: attempts must be at least per_object": grasps["per_object"] > grasps["attempts"],
        "grasps: max_attempts must be at least attempts": grasps["attempts"] > grasps["max_attempts"],
        f"frames.count: at a time step of {grasps['timestep']} s at most {states}": frames["count"] > states,
        f"frames.images: at most frames.count, {frames['count']}": frames["images"] > frames["count"],
    }
    if source.kind == "released":
        another = touch_sensor.geometry != sensor.DIGIT.geometry
        contradictions |= {
            "touch.sensor: released data are of the DIGIT: leave it `digit`": another,
            "hold: released data have no grasps that could be tested: set test to false": config["hold"]["test"],
            "touch.pressed: released data have no forces: set it to false": config["touch"]["pressed"],
            "press: released data have no meshes that could be pressed: set count to 0": config["press"]["count"],
            "frames: released data have no grasps that could be closed again: set count to 0": frames["count"],
            "vision.cameras: released data have the paper's camera: set it to null": config["vision"]["cameras"],
        }
    for message, holds in contradictions.items():
        if holds:
            raise ConfigError(f"config {message}")
    return Settings(folder, source, classes, entries, batch_size, places, hand, touch_sensor, experiments, recipe)


say = partial(print, sep="\n", flush=True)


def check_config(overlays: Sequence[Path | str], name: str | None = None, picture: Path | None = None) -> None:
    """Print what a run with these overlays would work on, and draw its hand and one object: this one, or one that
    is soon done. Raises `ConfigError` and `catalogue.CatalogueError` as the workflow says them."""
    start, project = time.monotonic(), Path(__file__).parents[1]  # an editable install, of the workflow's folder
    if not (project / DEFAULT).is_file():
        raise ConfigError("`palpate check` runs with the workflow: install Palpate with `make env` in its own folder")
    logging.getLogger("palpate").addHandler(logging.NullHandler())  # warnings of textures are lines of the check
    config = read_config(project / DEFAULT, overlays)
    check(config, project / SCHEMA, FILES)
    settings = resolve(config, project)
    checksums = same_size_checksums(settings)
    say(*object_lines(settings, config, checksums))
    if settings.source.kind == "released":
        return say("released data are read, not simulated: there is nothing to try")
    from palpate.vision import blender

    blender.load()  # before trimesh, which all that follows loads
    from palpate import grasp, scene

    scene.draw(config["vision"], config["seed"], "")
    own, face = settings.hand, settings.sensor.gel_face
    hand = hands.from_mjcf(*own, face) if own else hands.allegro(face)
    for line in hands.check_files(*own, settings.sensor) if own else ():
        say(line)
    grasp.check_hand(hand, config["grasps"]["timestep"], config["grasps"]["max_penetration"])
    with tempfile.TemporaryDirectory(prefix="palpate-check-") as scratch:
        root = Path(scratch if settings.source.kind == "procedural" else settings.source.path)
        looks = [look(entry, root) for entry in _opened(settings, name, config["seed"], root)]
        say(*mesh_lines(looks, settings, config, checksums))
        sensors = f"{', '.join(hand.sensor_names)}: {settings.sensor.name}, {1e3 * settings.sensor.range:g} mm deep"
        say(f"hand: {hand.name}, {len(hand.joint_link)} joints; sensors {sensors}")
        places = {"sensor plane": 0, "gel's face": face, "end of range": settings.sensor.range}  # m along a sensor's x
        for sensor_name, surface in zip(hand.sensor_names, hand.contact_distance(), strict=True):
            stated = ", ".join(f"{what} {1e3 * (place - surface):+.0f}" for what, place in places.items())
            where = f", mm out of the surface of its link: {stated}" if surface else ": its x misses its link"
            say(f"  {sensor_name}{where}")
        pictures: dict[str, np.ndarray] = {}
        by_class: dict[str, list[Look]] = defaultdict(list)  # those of the fewest faces first, no hulls
        for opened in sorted(looks, key=lambda opened: opened.faces):
            entry = opened.entry
            if not opened.problem and (entry.object == name or not name and not catalogue.is_collision(entry.source)):
                by_class[entry.class_name].append(opened)
        for class_name in list(by_class)[:EXAMPLES]:
            if pictures and time.monotonic() - start > EXAMPLE_SECONDS:
                break
            for trial in by_class[class_name][:TRIED]:
                say(f"{trial.entry.object}, through every stage:")
                try:
                    made = make_example(trial.entry, root, config, settings.sensor, hand, Path(scratch))
                    pictures |= {f"{class_name}: {title}": picture for title, picture in made.items()}
                    break
                except UnusableObject as error:
                    say(f"  can't be used: {error}")
    from palpate.results import page
    from palpate.results.dataset_figures import check_sheet

    path = picture or Path(settings.folder, "check.png")
    with atomic_write(path) as temporary:
        page.save(check_sheet(hand, settings.sensor, pictures), temporary)
    say(f"{path}: the hand with its sensor frames{', images and readings' if pictures else ''}")
    options = f" --configfile {' '.join(map(str, overlays))}" if overlays else ""
    say(f"checked in {time.monotonic() - start:.0f} s. To make the dataset: snakemake --cores 2 dataset{options}")


def object_lines(settings: Settings, config: Mapping[str, Any], checksums: Mapping[str, str]) -> Iterator[str]:
    """The source, its objects by class and split, files that are passed over, and splits that lack objects."""
    source, entries = settings.source, settings.entries
    splits = catalogue.splits_of(entries, config["split"], config["seed"], catalogue.copies(checksums))
    counts = Counter((entry.class_name, splits[entry.object]) for entry in entries)
    yield f"source: {source.kind}, {'made by Palpate' if source.kind == 'procedural' else source.path}"
    classes = f"{len(settings.classes)} class{'es' * (len(settings.classes) > 1)}"
    formats = sorted(Counter(Path(entry.source).suffix.lower() for entry in entries).items())
    yield f"{len(entries)} objects in {classes}: {', '.join(f'{suffix} {count}' for suffix, count in formats)}"
    silent = [entry for entry in entries if Path(entry.source).suffix.lower() not in (*FORMAT_UP, ".dae")]
    if source.up == "format" and silent and all(entry.up == "z" for entry in silent):
        yield "  but for glTF and COLLADA no format says what is up, z is taken: if objects lie, set source.up to y"
    for name in settings.classes:
        of_splits = [f"{split} {counts[name, split]}" for split in catalogue.SPLITS if counts[name, split]]
        yield f"  {name}: {', '.join(of_splits)}"
    if same := [(entry.source, *entry.others) for entry in entries if entry.others]:
        examples = catalogue.listed([" = ".join(files[: NAMED + 1]) for files in same], NAMED)
        number = sum(map(len, same)) - len(same)
        yield f"  {number} further files of the same objects are not used, the first is taken: {examples}"
        yield f"    {_advice(same[0], source)}"
    if config["classes"] == "all" and source.has_class_folders and not source.pattern:
        folders = source.class_folders(Path(source.path))
        without = [folder for folder in folders if source.class_of(folder) not in settings.classes]
        yield from (f"  no class: {folder} (no mesh in it)" for folder in without)
    yield from (f"  {line}" for line in catalogue.unread_lines(source))
    unlike = defaultdict(list)  # mesh files, of some of many, that are something else by their content
    looked = entries[:: 1 + len(entries) // MOST_READ] if source.kind in LAYOUTS else ()
    for file in (file for entry in looked for file in (entry.source, *entry.others)):
        path = Path(source.path, file)
        if not named_files.unusable(path) and path.is_file() and (what := named_files.what_it_is(path)):
            unlike[what].append(file)
    yield from (f"  {len(files)} x {what} ({catalogue.listed(files, NAMED)})" for what, files in unlike.items())
    try:
        catalogue.check_splits(splits, catalogue.SPLITS, "training with its tables")
    except catalogue.CatalogueError as error:
        yield f"  {error}"


def same_size_checksums(settings: Settings) -> dict[str, str]:
    """Checksums of objects by name; empty but for files of one size, of which `COMPARED_BYTES` are read at most."""
    checksums, sizes = dict.fromkeys([entry.object for entry in settings.entries], ""), defaultdict(list)
    for entry in settings.entries if settings.source.kind in LAYOUTS else ():
        path = Path(settings.source.path, entry.source)
        if path.is_file():
            sizes[path.stat().st_size].append((entry.object, path))
    total = 0
    for size, same in sorted((size, same) for size, same in sizes.items() if len(same) > 1):
        total += size * len(same)
        if total <= COMPARED_BYTES:
            checksums |= {name: catalogue.checksum(path, settings.source.path) for name, path in same}
    return checksums


def _advice(files: Sequence[str], source: Source) -> str:
    """How to take the first of some files that show the same, and no other."""
    first, *others = map(Path, files)
    start, advice = "{class}/" if source.has_class_folders else "", ""
    for last, own in ((f"*{first.suffix}", "suffix"), (first.name, "name")):
        if not advice and getattr(first, own) not in {getattr(other, own) for other in others}:
            advice = f'`source: {{pattern: "{start}**/{last}"}}` takes such files alone; '
    return f"{advice}a line `{others[0]},yes` of source.objects (path,exclude) leaves a file out"


class Look(NamedTuple):
    """A mesh file that was opened."""

    entry: SourceObject
    extent: float = 0.0  # its box from corner to corner in its own unit
    faces: int = 0
    missing: Mapping[str, str] = {}  # what is wrong with files that it names, by their names
    shape: Sequence[float] = ()  # as `palpate.mesh.facts` has it
    problem: str = ""  # why it can't be used


def _opened(settings: Settings, name: str | None, seed: int, root: Path) -> list[SourceObject]:
    """The objects whose meshes are opened, of each class in turn, first the named one; procedural: made in root."""
    by_class = ([entry for entry in settings.entries if entry.class_name == kind] for kind in settings.classes)
    turns = [entry for turn in zip_longest(*by_class) for entry in turn if entry]
    known = [entry.object for entry in turns]
    if name and name not in known:
        raise ConfigError(f"no object {name!r} in this run; its objects are {catalogue.listed(known)}")
    turns.sort(key=lambda entry: entry.object != name)
    if settings.source.kind == "procedural":  # all sound, and they have to be made first
        from palpate import shapes

        turns = turns[: max(TRIED, min(len(settings.classes), EXAMPLES))]
        for entry in turns:
            (root / entry.class_name).mkdir(exist_ok=True)
            shapes.write(entry.class_name, int(entry.object.rpartition("-")[2]), root / entry.source, seed)
        return turns
    turns = turns[:MOST_OPENED]
    files = [root / entry.source for entry in turns]  # one that is missing is reported later
    totals = accumulate(path.stat().st_size if path.is_file() else 0 for path in files)
    return [entry for entry, total in zip(turns, totals, strict=True) if entry is turns[0] or total <= MOST_BYTES]


def look(entry: SourceObject, root: Path) -> Look:
    """Open an object's mesh, in a process of its own. root: of the sources."""
    from palpate.mesh import build, isolation  # once, and not in each of the processes

    path = root / entry.source
    try:
        return Look(entry, *isolation.isolated(build.measure, path, entry.scale, root, seconds=20.0))
    except (UnusableObject, RuntimeError, OSError, MemoryError) as error:
        return Look(entry, problem=str(error).strip().splitlines()[-1].removeprefix(f"{path}: "))


def mesh_lines(
    looks: Sequence[Look], settings: Settings, config: Mapping[str, Any], checksums: Mapping[str, str]
) -> Iterator[str]:
    """What opened meshes lack, their sizes with a hint at their unit, those that can't be used, and copies."""
    from palpate.mesh import LARGEST

    sound = [opened for opened in looks if not opened.problem]
    share = "" if len(looks) == len(settings.entries) else f" of {len(settings.entries)}"
    yield f"opened {len(looks)}{share} meshes, of which {len(sound)} can be used"
    if sound:
        extents, faces = sorted(opened.extent for opened in sound), [opened.faces for opened in sound]
        sizes = f"{extents[0]:.3g} to {extents[-1]:.3g} units of the file across"
        sizes += f", {min(faces):,} to {max(faces):,} faces"
        yield f"  {sizes}; scale {settings.source.scale}, up {settings.source.up}"
        if extents[len(extents) // 2] > LARGEST and settings.source.scale == "diagonal":
            yield "  units look like millimetres or centimetres: `source: {scale: 0.001}`, or 0.01, would keep sizes"
    for opened in looks:
        yield from (f"  {opened.entry.object}: {name}: {what}" for name, what in opened.missing.items())
        if opened.problem:
            yield f"  {opened.entry.object} can't be used: {opened.problem}"
    if settings.source.kind not in LAYOUTS:
        return
    groups = catalogue.copies(checksums, {opened.entry.object: opened.shape for opened in sound})
    splits = catalogue.splits_of(settings.entries, config["split"], config["seed"], groups)
    if groups:
        files = {entry.object: entry.source for entry in settings.entries}
        yield from (f"  {line}" for line in catalogue.copy_lines(groups, checksums, splits))
        yield f"    {_advice([files[name] for name in groups[0]], settings.source)}"
    if hulls := [entry.object for entry in settings.entries if catalogue.is_collision(entry.source)]:
        yield f"  {len(hulls)} objects have a collision mesh only, by its name ({catalogue.listed(hulls, NAMED)})"


def make_example(
    entry: SourceObject, root: Path, config: Mapping[str, Any], touch_sensor: Sensor, hand: Hand, scratch: Path
) -> dict[str, np.ndarray]:
    """Take an object through every stage, with one grasp and small images, and print what came out; returns images
    and readings, (rows, columns, 3 or 4) uint8 by their titles. Raises `UnusableObject` for one without a surface."""
    from palpate import grasp, mesh, scene, surface, touch
    from palpate.dataset.run import fill_untouched
    from palpate.vision import Renderer

    seed, name, folder = config["seed"], entry.object, scratch / "made" / entry.object
    mesh.prepare(
        root / entry.source, folder, up=entry.up, turn=entry.turn, scale=entry.scale, root=root, **config["mesh"]
    )
    visual, collision = mesh.load_visual(folder), mesh.load_collision(folder)
    points = surface.sample(visual, config["surface"]["points"], generator(seed, name, "surface"))
    points += mesh.OBJECT_POSITION
    vision = scene.draw(config["vision"], seed, name)
    appearance = scene.look(vision)
    made, readings = scene.Scene(folder, **appearance), {}
    chosen = ("hand", "placement", "object", "grip", "keep")
    one = {key: value for key, value in config["grasps"].items() if key not in chosen}
    one |= {"per_object": 1, "attempts": 1, "grasper_type": grasp.grasper_type(config["grasps"], config["hold"])}
    try:
        rng = generator(seed, name, "grasps")
        grasps = grasp.grasp_object(visual, collision, points, hand, rng, sensor=touch_sensor, **one)
        poses = {key: getattr(grasps, key) for key in scene.GRASP_ARRAYS}
        made = scene.Scene.from_grasps(folder, poses, hand, **appearance)
        sensed = touch.sense_scene(made, touch.scene_tracer(made, touch_sensor))
        filled = fill_untouched(sensed.reading[0], sensed.success[0], touch.empty_reading(touch_sensor))
        for sensor_name, reading, on in zip(hand.sensor_names, filled, sensed.success[0], strict=True):
            readings[sensor_name if on else f"{sensor_name}: no touch"] = reading
        attempts = f"{grasps.attempts} attempt{'s' * (grasps.attempts != 1)}"
        say(f"  grasp after {attempts}, {sensed.success.sum()} of {sensed.success.size} sensors touch")
        if "sensor_force" in grasps.more:
            pressed = zip(hand.sensor_names, grasps.more["sensor_force"][0], strict=True)
            say(f"  on the object, N: {', '.join(f'{name} {force:.1f}' for name, force in pressed)}")
    except UnusableObject as error:
        say(f"  no grasp: {error}")
    small = {**vision, **{key: min(vision[key], most) for key, most in IMAGE.items()}}
    pictures = Renderer(small["samples"], small["device"]).render_cameras(made, scene.cameras(small))
    images = {}
    for number, (alone, held) in enumerate(pictures):
        which = f", camera {number}" if len(pictures) > 1 else ""
        images[f"image{which}"] = alone.rgb
        if held:
            images[f"in the hand{which}"] = held[0].rgb
    return images | readings
