"""Meshes of a batch: loaded, repaired, normalised, decimated.

meshes/<batch>/<object>/visual.glb       full resolution, materials and textures; own frame, metres
                        collision.ply    what the hand collides with
                        mesh.json        faces, repairs made, scale: docs/meshes.md
                seal.json                sizes and checksums of all these files, and what they were made from
meshes/<batch>.facts.json                of each object what the summary of a run says, and its shape
rejected/meshes/<batch>.csv              object, stage, reason
"""

from workflow.run.job import log_to

import json
import shutil
from pathlib import Path

from palpate import catalogue, mesh, seal
from palpate.atomic import atomic_write
from palpate.batch import each_object, write_rejections

log_to(snakemake.log[0])
settings, sources = snakemake.params.mesh, Path(snakemake.params.folder)
entries = catalogue.read_catalogue(snakemake.input.catalogue)
objects = {each.object: each._replace(checksum=catalogue.checksum(sources / each.source, sources)) for each in entries}

made_from = seal.combine({"mesh": settings}, more=catalogue.sources_of(objects.values()))
outputs = snakemake.output

with atomic_write(outputs.meshes) as batch:
    batch.mkdir()

    def prepare(name: str) -> dict:
        folder, entry = batch / name, objects[name]
        file = sources / entry.source
        try:
            record = mesh.prepare(
                file,
                folder,
                up=entry.up,
                scale=float(entry.scale) if entry.scale[0].isdigit() else entry.scale,
                turn=float(entry.turn or 0),
                collision_faces=settings["collision_faces"],
                root=sources,
            )
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        finally:  # an object is not rejected, either, for a file that was being written
            catalogue.require_unchanged(file, entry.checksum, sources)
        return mesh.facts(record)

    facts, rejections = each_object(objects, prepare, "meshes")
    write_rejections(outputs.rejected, rejections, made_from)
    with atomic_write(outputs.facts, made_from) as of_objects:
        of_objects.write_text(json.dumps(facts) + "\n")
    seal.write(batch, seal.with_output(made_from, outputs.rejected))
