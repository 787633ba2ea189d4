"""Meshes of a batch: loaded, repaired, normalised, decimated.

meshes/<batch>/<object>/visual.glb       full resolution, materials and textures; own frame, metres
                        collision.ply    what the hand collides with
                        level-<n>.ply    further decimation levels
                        mesh.json        faces, repairs made, measured distance to the source
                manifest.json           sizes and checksums of all these files
                .facts.json             of each object what the summary of a run says
rejected/meshes/<batch>.csv              object, stage, reason
"""

import json
import logging
import shutil
from pathlib import Path

from palpate import checksums, mesh
from palpate.atomic import atomic_write
from palpate.batch import each_object, log_to, write_rejections
from palpate.catalogue import files_root

log_to(snakemake.log[0])
log = logging.getLogger("meshes")
objects, settings, sources = snakemake.params.objects, snakemake.params.mesh, Path(snakemake.params.folder)
files = files_root({"path": sources, "outside": snakemake.params.outside})

with (
    atomic_write(snakemake.output.meshes) as batch,
    atomic_write(snakemake.output.rejected, checksum=True) as rejected,
):
    batch.mkdir()

    def prepare(name: str) -> dict:
        folder, (file, up, scale) = batch / name, objects[name]
        try:
            record = mesh.prepare(
                sources / file,
                folder,
                up=up,
                scale=scale,
                collision_faces=settings["collision_faces"],
                levels=settings["levels"],
                root=files,
            )
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        for level, faces in mesh.undecimated_levels(record).items():
            log.info("%s: omitted: decimation to %s: the mesh has %s faces", name, level, f"{faces:,}")
        return mesh.facts(record)

    facts, rejections = each_object(objects, prepare, "meshes")
    write_rejections(rejected, rejections)
    (batch / mesh.FACTS).write_text(json.dumps(facts) + "\n")
    checksums.write_manifest(batch)
