# Reads and checks the config, before anything else: the run's folder, its objects and batches, hand, sensor, recipe.
import argparse
import errno
import itertools
import os
import re
import sys

from snakemake.logging import logger

from palpate import catalogue, sensor, stages
from palpate.check import FILES, checked, resolve
from palpate.configuration import ConfigError, check, in_order, nearest, parse_texts, read_yaml, typed, whole_numbers

SCHEMAS = PROJECT / "workflow/schemas"
CLASS_FILE = rf"\w[{catalogue.LETTERS}.-]*"  # a class in a file's name: `catalogue.file_name`


def stop(message):
    """End the workflow with a message, and without the place in a rule file that Snakemake would add."""
    logger.error(str(message))
    sys.exit(1)


try:
    # Snakemake reads the last of a key that stands twice in a file; this is an error. From files that a profile names
    # with `configfile`, it takes the last.
    options = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    options.add_argument("--configfile", "--configfiles", nargs="+", default=[])
    options.add_argument("--default-storage-provider")
    options = options.parse_known_args()[0]
    DEFAULTS = read_yaml(PROJECT / "config/config.yaml")
    for path in options.configfile:
        read_yaml(path)
    parse_texts(config, SCHEMAS / "config.schema.yaml")
    check(config, SCHEMAS / "config.schema.yaml", FILES)
    # In one order, whichever file states a key: Snakemake compares params as text.
    config.update(in_order(whole_numbers(config), DEFAULTS))
    config["training"]["override"] = typed(config["training"]["override"])
    settings = resolve(config, PROJECT)
    RUN_FOLDER, SOURCE, CLASS_COUNTS, ENTRIES, BATCH_SIZE, KNOWN_PLACES, HAND, SENSOR, EXPERIMENTS, RECIPE = settings
    background = sensor.read(sensor.sensor_file(config["touch"]["sensor"], PROJECT)).get("background")
    SENSOR_BACKGROUND = local(background) if background else []
    HAND_FILES = []  # what the model file of an own hand names: meshes, textures, included models
    if HAND:
        from palpate import grasp, hand  # loads MuJoCo

        for line in hand.check_files(*HAND, SENSOR):
            logger.warning(line)
        own_hand = hand.from_mjcf(*HAND, SENSOR.gel_face)
        grasp.check_hand(own_hand, config["grasps"]["timestep"], config["grasps"]["max_penetration"])
        HAND_FILES = [checked(str(path)) for path in hand.model_files(HAND[0])]
    if [config["vision"][key] for key in ("cameras", "lights", "background")] != [None, None, [1, 1, 1]]:
        from palpate import scene

        scene.draw(config["vision"], config["seed"], "")
except (ConfigError, catalogue.CatalogueError) as error:
    stop(error)

try:
    os.makedirs(RUN_FOLDER, exist_ok=True)
    if not os.access(RUN_FOLDER, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
except OSError as error:
    stop(f"{RUN_FOLDER}: {error.strerror}: set `results` in the config to a folder that can be written to")

# The batch of each object, and the objects of each batch.
PLACES = catalogue.assign_batches([entry.object for entry in ENTRIES], BATCH_SIZE, KNOWN_PLACES)
ENTRIES = catalogue.in_order(ENTRIES, PLACES)
BATCH_ENTRIES = {batch: [*each] for batch, each in itertools.groupby(ENTRIES, lambda entry: PLACES[entry.object])}
BATCHES = list(BATCH_ENTRIES)

# The authors' dataset is read and not simulated: it comes without meshes and grasps.
RELEASED = SOURCE.kind == "released"
# What the config asks for of the dataset, and which stages of it reject objects.
DATASET = [each for each in stages.STAGES.values() if each.in_dataset and each.is_asked(config)]
STAGES = [stages.RELEASED] if RELEASED else [each.name for each in DATASET if each.rejects]
TRAINING_MACHINE = {key: config["training"][key] for key in ("device", "devices", "precision")}
TRAINING_GPUS = 0 if config["training"]["device"] == "cpu" else config["training"]["devices"]
# What everything else is made from.
DATASET_STORES = [each for each in DATASET if each.suffix and not (RELEASED and each.simulated)]
STORES = ["catalogue.csv", "rejected.csv", *expand([each.path() for each in DATASET_STORES], batch=BATCHES)]


wildcard_constraints:
    **{"class": CLASS_FILE},
    batch=r"batch-\d+",
    experiment="|".join(re.escape(each.name) for each in EXPERIMENTS.experiments.values() if not each.weights),
    seed="|".join(map(str, config["training"]["seeds"])),
