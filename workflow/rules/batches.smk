# What jobs take of a batch: its objects and their files, and memory by the sizes of those.
from functools import cache
from stat import S_ISDIR

from snakemake.exceptions import WorkflowError

from palpate import atomic, named_files
from workflow.run import lock

WHOLE_OUTPUT = re.compile(r"batch-.*|\.snakemake")  # folders in which nothing is written in part


def take_folder():
    """At the start of a run: have its folder for it alone, as its config says, without what killed runs left."""
    try:
        lock.hold(RUN_FOLDER, logger.warning)
        catalogue.check_same_run(RUN_FOLDER, config, PROJECT)  # again: a run may have begun in the meantime
        if catalogue.read_batches(RUN_FOLDER, BATCH_SIZE, len(ENTRIES))[1] != KNOWN_PLACES:
            stop(f"{RUN_FOLDER}: another run has added objects since this one was started: start it again")
        catalogue.write_batches(RUN_FOLDER, BATCH_SIZE, PLACES)
        catalogue.write_record(RUN_FOLDER, config)
        atomic.sweep(RUN_FOLDER, WHOLE_OUTPUT)
    except (lock.FolderInUse, catalogue.CatalogueError) as error:
        stop(error)


def batch_entries(batch):
    if batch not in BATCH_ENTRIES:
        stop(f"the run has no {batch}; its batches are {BATCHES[0]} to {BATCHES[-1]}")
    return BATCH_ENTRIES[batch]


@cache
def mesh_files(batch):
    """The mesh file of each object of a batch, and those that it names."""
    entries = batch_entries(batch)
    return {each.object: catalogue.mesh_files(Path(SOURCE.path, each.source), SOURCE.path) for each in entries}


@cache
def batch_sources(batch):
    """Files that a batch's meshes come from, also those that meshes name; procedural objects come as one folder a class.

    What can't be a mesh's file is none of Snakemake's inputs: the job says why.
    """
    entries = batch_entries(batch)
    if SOURCE.kind == "procedural":
        return sorted({f"sources/{entry.class_name}" for entry in entries})
    files = dict.fromkeys(str(file) for files in mesh_files(batch).values() for file in files)
    files = [checked(file) for file in files]
    return [*map(local, files)] if options.default_storage_provider else [*map(ancient, files)]


@cache
def source_checksums(batch):
    """Checksums of a batch's objects, which tell whether files have changed; procedural ones are made in the run."""
    if SOURCE.kind == "procedural":
        return {}
    return catalogue.source_checksums(Path(RUN_FOLDER, f"catalogue/.{batch}.json"), mesh_files(batch), SOURCE.path)


@cache
def texture_mb(batch):
    """MB that the largest textures of an object of a batch take: 16 bytes a pixel, in the meshes stage and in Blender."""
    paths = [Path(SOURCE.path, entry.source) for entry in BATCH_ENTRIES[batch] if SOURCE.kind != "procedural"]
    return int(16e-6 * max((named_files.texture_pixels(path, SOURCE.path) for path in paths), default=0))


def source_root(wildcards, input):
    """The folder that sources are named from. That of procedural objects moves with the run, or is storage's copy."""
    return os.path.dirname(input.sources[0]) if SOURCE.kind == "procedural" else SOURCE.path


def mesh_memory(wildcards, input):
    """MB that the meshes of a batch take: 30 for a MB of the OBJ in work, and those of its textures."""
    largest = max((stored_mb([path]) for path in input.sources or batch_sources(wildcards.batch)), default=0)
    return 2000 + 30 * largest + texture_mb(wildcards.batch)


def batch_objects(wildcards):
    return {entry.object: entry.source for entry in batch_entries(wildcards.batch)}


@cache
def splits():
    return catalogue.splits_of(ENTRIES, config["split"], config["seed"])


def catalogue_with(needed, what):
    """The catalogue, for what needs objects in some splits; that there are none is an error before anything runs."""
    try:
        by_name = config["split"]["held_out"] == "objects" and not any(entry.split for entry in ENTRIES)
        catalogue.check_splits(splits(), needed, what, by_name)
    except catalogue.CatalogueError as error:
        stop(error)
    return "catalogue.csv"


@cache
def folder_bytes(folder, changed):
    """Bytes of all files in a folder that was last changed then: a hundred trainings ask for the same stores."""
    return sum(each.stat().st_size for each in folder.rglob("*"))


def stored_mb(paths):
    """Megabytes of files and of all files in folders, which Snakemake's `size_mb` counts as empty."""
    found = [(path, path.stat()) for path in map(Path, paths)]
    sizes = (folder_bytes(path, at.st_mtime_ns) if S_ISDIR(at.st_mode) else at.st_size for path, at in found)
    return int(sum(sizes) / 1e6)


def all_cores():
    """The cores of a job that is to run alone; on a cluster, which has no number of them, one."""
    try:
        return workflow.cores
    except WorkflowError:
        return 1


def asked(section, key):
    """A section of the config, for params; a target that it does not ask for is an error before anything runs."""
    if not config[section][key]:
        stop(f"the config asks for no {section}: set {section}.{key} (config/README.md)")
    return config[section]
