# What the config means for the workflow: checked first, then the run's folder, its objects and its batches.
import contextlib
import errno
import gc
import itertools
import json
import os
import re
import shlex
import signal
import sys
import threading
import time
from collections import Counter
from functools import cache
from importlib import metadata

import psutil
import yaml
from snakemake.io import contains_wildcard
from snakemake.logging import logger
from snakemake.utils import update_config

from palpate import atomic, catalogue, lock, locked, named_files, sensor, stages, terminal
from palpate.batch import QUIET
from palpate.batch import one_line_error as one_line
from palpate.check import FILES, resolve
from palpate.configuration import ConfigError, absolute, check, read_yaml, typed, whole_numbers
from palpate.experiments import Experiments
from palpate.inference import inputs
from palpate.training.recipes import Recipe

# Jobs find Palpate in this checkout, also in an environment that has only its dependencies (envs/palpate.yaml).
os.environ.setdefault("PYTHONPATH", str(PROJECT))
# Jobs have one thread each. Snakemake limits OpenMP and BLAS by itself; libigl would take every core.
os.environ.setdefault("IGL_NUM_THREADS", "1")

# A plan is millions of Python objects that stay. To look for cycles among them again and again takes a sixth of the
# time of planning 100,000 objects.
gc.set_threshold(200_000, 50, 100)

if workflow.is_main_process:
    sys.excepthook = terminal.excepthook

SCHEMAS = PROJECT / "workflow/schemas"
CONDA = str(PROJECT / "envs/palpate.yaml")
VERSIONS = ("snakemake", "mujoco", "bpy", "trimesh", "numpy", "zarr", "torch")  # that a run's page names
WHOLE_OUTPUT = re.compile(r"batch-.*|\.snakemake")  # folders in which nothing is written in part
CLASS_FILE = r"[A-Za-z0-9_][A-Za-z0-9_.-]*"  # a class in a file's name: `catalogue.file_name`


def stop(message):
    """End the workflow with a message, and without the place in a rule file that Snakemake would add."""
    logger.error(str(message))
    sys.exit(1)


def checked(path):
    """The path, if Snakemake takes it as it is."""
    if contains_wildcard(path) or re.search(r"<[a-z][a-z0-9_]*>", path):
        raise ConfigError(f"{path}: Snakemake takes {{...}} and <...> in a path for placeholders: rename it")
    return path


given = workflow.config_settings.config or {}
update_config(config, {key: typed(value) for key, value in given.items() if isinstance(value, (dict, list))})
try:
    for path in workflow.configfiles:
        read_yaml(path)
    check(config, SCHEMAS / "config.schema.yaml", FILES)
    config.update(whole_numbers(config))
    EXPERIMENTS = Experiments.read(PROJECT / "config/experiments.yaml", SCHEMAS / "experiments.schema.yaml")
    RECIPE = Recipe.read(
        PROJECT / "config/recipes.yaml",
        config["training"]["recipe"],
        config["training"]["override"],
        SCHEMAS / "recipes.schema.yaml",
    )
    RUN_FOLDER = str(Path(absolute(config["results"], PROJECT), config["run"]))
    if workflow.is_main_process:  # its jobs have been let in by it
        catalogue.check_same_run(RUN_FOLDER, config, PROJECT)
    SOURCE, CLASS_COUNTS, ENTRIES, HAND, SENSOR = resolve(config, PROJECT)
    # As jobs see it: what is made in the run's folder moves with it.
    SOURCE_PATH = "sources" if SOURCE.kind == "procedural" else SOURCE.path
    NAMED_IN = SOURCE.files_root  # what meshes name has to be in it
    for entry in ENTRIES:
        checked(f"{SOURCE.path}/{entry.source}")
    BATCH_SIZE = catalogue.resolve_batch_size(config["batch_size"], len(ENTRIES), RUN_FOLDER)
    KNOWN_PLACES = catalogue.read_places(RUN_FOLDER, BATCH_SIZE)
    PLACES = catalogue.assign_batches([entry.object for entry in ENTRIES], BATCH_SIZE, KNOWN_PLACES)
    ENTRIES = catalogue.in_order(ENTRIES, PLACES)
    BATCH_ENTRIES = {
        batch: list(entries) for batch, entries in itertools.groupby(ENTRIES, lambda entry: PLACES[entry.object])
    }
    BATCHES = list(BATCH_ENTRIES)
    SENSOR_BACKGROUND = sensor.read(sensor.sensor_file(config["touch"]["sensor"], PROJECT)).get("background") or []
    if HAND and workflow.is_main_process:
        from palpate import hand  # loads MuJoCo

        for line in hand.check_files(HAND.mjcf, HAND.sensors, SENSOR):
            logger.warning(line)
    LOOK = [config["vision"][key] for key in ("cameras", "lights", "background")]
    if workflow.is_main_process and LOOK != [None, None, [1, 1, 1]]:
        from palpate import scene

        scene.draw(config["vision"], config["seed"], "")
    TRAINING_MACHINE = {key: config["training"][key] for key in ("device", "devices", "precision")}
    TRAINING_GPUS = 0 if config["training"]["device"] == "cpu" else config["training"]["devices"]
except (ConfigError, catalogue.CatalogueError) as error:
    stop(error)

try:
    os.makedirs(RUN_FOLDER, exist_ok=True)
    if not os.access(RUN_FOLDER, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
except OSError as error:
    stop(f"{RUN_FOLDER}: {error.strerror}: set `results` in the config to a folder that can be written to")


def take_folder():
    """At the start of a run: have its folder for it alone, as its config says, without what killed runs left."""
    try:
        lock.hold(RUN_FOLDER, logger.warning)
        catalogue.check_same_run(RUN_FOLDER, config, PROJECT)  # again: a run may have begun in the meantime
        if catalogue.read_places(RUN_FOLDER, BATCH_SIZE) != KNOWN_PLACES:
            stop(f"{RUN_FOLDER}: another run has added objects since this one was started: start it again")
        catalogue.write_places(RUN_FOLDER, BATCH_SIZE, PLACES)
        catalogue.write_record(RUN_FOLDER, config)
        atomic.sweep(RUN_FOLDER, WHOLE_OUTPUT)
    except (lock.FolderInUse, catalogue.CatalogueError) as error:
        stop(error)


def check_environment():
    """At the start of a run: say in one line where the environment is not the locked one."""
    if others := locked.differences(PROJECT / "envs/requirements.txt"):
        more = f" and {len(others) - 5} more" if len(others) > 5 else ""
        logger.warning(f"this environment is not the locked one: {', '.join(others[:5])}{more}; `make env` builds that")


def take_terminal():
    """From the start on: a line of progress in place of a page a job, unless --printshellcmds or --verbose asks for it."""
    global PROGRESS
    PROGRESS = terminal.Progress(Counter(job.rule.name for job in workflow.dag.needrun_jobs()))
    pages = workflow.output_settings.printshellcmds or workflow.output_settings.verbose
    for handler in [] if pages else terminal_handlers():
        handler.addFilter(PROGRESS)
        os.environ[QUIET] = "1"
        PROGRESS.start()


def terminal_handlers():
    return [handler for handler in logger.handlers if handler.name == "DefaultStreamHandler"]


def schedule_at_events():
    """Look for jobs to start when one ends, and not every second besides.

    Snakemake's limit of 100 jobs started a second begins a timer with each job that ends. Each of these looks through
    the jobs every second to the end of the run: after 100 jobs that takes a third of a core, after 400 a whole one.
    A limit that was asked for stays.
    """
    limit = workflow.scheduling_settings.max_jobs_per_timespan
    if limit and (limit.max_jobs, limit.timespan) == (100, 1):
        workflow.scheduler.job_rate_limiter = None


def take_signals():
    """From the start on: Ctrl-C and SIGTERM end the jobs, and then the run.

    Jobs don't get the terminal's Ctrl-C themselves, where each would print where it was.
    """
    for executor in filter(None, (workflow.scheduler._executor, workflow.scheduler._local_executor)):
        if pool := getattr(executor, "pool", None):  # jobs start in its threads, with their mask of signals
            pool._initializer = lambda: signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    for each in (signal.SIGINT, signal.SIGTERM):
        signal.signal(each, interrupt)


def interrupt(*_):
    if not PROGRESS.interrupted:
        PROGRESS.interrupt()
        for handler in terminal_handlers():
            handler.addFilter(PROGRESS)
        threading.Thread(target=stop_jobs, daemon=True).start()
        raise KeyboardInterrupt


def stop_jobs():
    """End all processes that this one has started, and that are started meanwhile, until it ends itself."""
    for attempt in itertools.count():
        for process in psutil.Process().children(recursive=True):
            with contextlib.suppress(psutil.NoSuchProcess):
                process.terminate() if attempt < 10 else process.kill()
        time.sleep(0.3)


def say_end(object_pages):
    """At the end of a run: what it has come to, in its page and on the terminal. object_pages: how many are written."""
    from palpate.dataset import summary  # loads Zarr and HDF5

    signal.signal(signal.SIGINT, signal.default_int_handler)
    PROGRESS.stop()
    if PROGRESS.interrupted:
        return logger.warning(terminal.INTERRUPTED)
    seconds = PROGRESS.estimate.now() - PROGRESS.estimate.start
    if os.path.exists(f"{RUN_FOLDER}/catalogue.csv") or PROGRESS.failures:
        write_page(seconds, object_pages)
    for line in terminal.end_lines(RUN_FOLDER, summary(RUN_FOLDER), len(PROGRESS.failures), PROGRESS.done, seconds):
        logger.warning(line)


def write_page(seconds, object_pages):
    """The run's index.html, and what it says of this start: last_run.json. No file of the workflow depends on them."""
    from palpate import __version__
    from palpate.viewer import run_page

    # A start that had nothing to do says nothing of how the run was made.
    last = {
        "ended": time.strftime("%Y-%m-%d %H:%M"),
        "command": shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        "jobs": PROGRESS.done,
        "seconds": round(seconds),
        "failures": PROGRESS.failures,
        "versions": {"palpate": __version__} | {name: metadata.version(name) for name in VERSIONS},
    }
    try:
        if PROGRESS.done or PROGRESS.failures:
            with atomic.atomic_write(f"{RUN_FOLDER}/last_run.json") as path:
                path.write_text(json.dumps(last, indent=1) + "\n")
        run_page(RUN_FOLDER, object_pages=object_pages)
    except Exception as error:  # the run itself is not worse for it
        logger.warning(f"{RUN_FOLDER}/index.html was not written: {one_line(error)}")


# The authors' dataset is read and not simulated: it comes without meshes and grasps.
RELEASED = SOURCE.kind == "released"
STAGES = [stages.RELEASED] if RELEASED else [name for name in stages.DATASET_STAGES if name != stages.RELEASED]


@cache
def mesh_files(path):
    """A mesh file with the materials, textures and buffers that it names: a change to any re-runs its batch.

    Of a long OBJ only the head is read for them, at every start; the catalogue's checksums read all of it. What can't
    be a mesh's file is none of Snakemake's inputs: the job says why.
    """
    if named_files.unusable(path):
        return []
    folder, names = Path(path).parent, catalogue.companions(Path(path), NAMED_IN, named_files.HEAD)
    return [path, *(os.path.normpath(folder / name) for name in names)]


def batch_entries(wildcards):
    if wildcards.batch not in BATCH_ENTRIES:
        stop(f"the run has no {wildcards.batch}; its batches are {BATCHES[0]} to {BATCHES[-1]}")
    return BATCH_ENTRIES[wildcards.batch]


@cache
def sources_of(batch):
    """Files that a batch's meshes come from; procedural objects come as one folder a class."""
    entries = BATCH_ENTRIES[batch]
    if SOURCE.kind == "procedural":
        return sorted({f"sources/{entry.class_name}" for entry in entries})
    files = [file for entry in entries for file in mesh_files(f"{SOURCE.path}/{entry.source}")]
    return [checked(file) for file in dict.fromkeys(files)]


@cache
def texture_mb(batch):
    """MB that the largest textures of an object of a batch take: 16 bytes a pixel, in the meshes stage and in Blender."""
    paths = [Path(SOURCE.path, entry.source) for entry in BATCH_ENTRIES[batch] if SOURCE.kind != "procedural"]
    return int(16e-6 * max((named_files.texture_pixels(path, NAMED_IN) for path in paths), default=0))


def mesh_memory(wildcards):
    """MB that the meshes of a batch take: 30 for a MB of the OBJ in work, and those of its textures."""
    stored = max((stored_mb([path]) for path in sources_of(wildcards.batch)), default=0)
    return 2000 + 30 * stored + texture_mb(wildcards.batch)


def render_memory(wildcards):
    """MB that Blender takes for the objects of a batch."""
    return 2000 + texture_mb(wildcards.batch)


def batch_sources(wildcards):
    batch_entries(wildcards)  # an error if there is no such batch
    return sources_of(wildcards.batch)


def batch_objects(wildcards):
    return {entry.object: entry.source for entry in batch_entries(wildcards)}


def batch_objects_with_splits(wildcards):
    """The fields of a batch's objects, as `catalogue.SourceObject` has them, and then their splits."""
    return [(*entry, splits()[entry.object]) for entry in batch_entries(wildcards)]


def batch_meshes(wildcards):
    """The mesh file of each object of a batch, its up axis and its scale."""
    return {entry.object: (entry.source, entry.up, entry.scale) for entry in batch_entries(wildcards)}


@cache
def own_hand_files():
    from palpate.hand import model_files  # loads MuJoCo

    return [checked(str(path)) for path in model_files(HAND.mjcf)]


def hand_files(wildcards):
    """Meshes and whatever else the model file of an own hand names."""
    return own_hand_files() if HAND else []


@cache
def splits():
    return catalogue.splits_of(ENTRIES, config["split"])


def catalogue_with(needed, what):
    """The catalogue, for what needs objects in some splits; that there are none is an error before anything runs."""
    try:
        catalogue.check_splits(splits(), needed, what, by_name=not any(entry.split for entry in ENTRIES))
    except catalogue.CatalogueError as error:
        stop(error)
    return "catalogue.csv"


def stores_of(name, *more):
    """The catalogue, and the stores of all batches, of the stages that an experiment takes arrays of, and of more.

    Too few grasps for the experiment, or no object in a split, is an error before anything runs.
    """
    experiment = EXPERIMENTS.experiments[name]
    if experiment.grasps > config["grasps"]["per_object"] and not experiment.fewer_grasps:
        stop(
            f"experiment {name} takes {experiment.grasps} grasps, but the config's "
            f"grasps.per_object is {config['grasps']['per_object']}: raise it"
        )
    return {
        "catalogue": catalogue_with(("train", "validation"), f"experiment {name}"),
        **{
            stage: expand(f"{stage}/{{batch}}.zarr", batch=BATCHES)
            for stage in dict.fromkeys([*inputs.stages(experiment), *more])
        },
    }


def experiment_stores(wildcards):
    return stores_of(wildcards.experiment)


def training_inputs(wildcards):
    """The stores of an experiment, and the model that its training continues from."""
    experiment, seed = wildcards.experiment, wildcards.seed
    base = RECIPE.base(EXPERIMENTS.experiments[experiment])
    return stores_of(experiment) | ({"base": f"models/{base}/seed-{seed}/best.ckpt"} if base else {})


def ring_stores(wildcards):
    """The stores of an experiment, and the rings around the touches."""
    return stores_of(wildcards.experiment, "touch", "rings")


def stored_mb(paths):
    """Megabytes of files and of all files in folders, which Snakemake's `size_mb` counts as empty."""
    files = [file for path in map(Path, paths) for file in (path.rglob("*") if path.is_dir() else [path])]
    return int(sum(file.stat().st_size for file in files) / 1e6)


def experiment_settings(wildcards):
    """How an experiment is trained by the run's recipe."""
    return RECIPE.settings(EXPERIMENTS.experiments[wildcards.experiment]).row()


wildcard_constraints:
    **{"class": CLASS_FILE},
    batch=r"batch-\d+",
    experiment="|".join(map(re.escape, EXPERIMENTS.experiments)),
    seed="|".join(map(str, config["training"]["seeds"])),


# What everything else is made from.
DATASET_STORES = [
    stages.STAGES[name] for name in stages.DATASET_STORES if not (RELEASED and stages.STAGES[name].simulated)
]
STORES = [
    "catalogue.csv",
    "rejected.csv",
    *(path for each in DATASET_STORES for path in expand(each.path(), batch=BATCHES)),
]
