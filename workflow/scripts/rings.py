"""Square rings of surface points around every successful touch of a batch.

rings/<batch>.zarr    object        (o,)                  string
                      ring_depth    (o, g, s, 100, 100)   float32    m along the sensor's x, +inf: no surface
"""

from pathlib import Path

from palpate import mesh, store
from palpate.batch import log_to
from palpate.evaluation import rings
from palpate.sensor import Sensor

log_to(snakemake.log[0])
if snakemake.input.meshes:
    meshes = Path(snakemake.input.meshes)

    def surface(name: str, sensor: Sensor) -> rings.MeshSurface:
        return rings.MeshSurface(mesh.load_visual(meshes / name), mesh.OBJECT_POSITION, sensor)

else:
    points = store.read(snakemake.input.surface, "object", "points")
    clouds = dict(zip(points["object"], points["points"], strict=True))

    def surface(name: str, sensor: Sensor) -> rings.CloudSurface:
        return rings.CloudSurface(clouds[name], sensor)


store.write(
    snakemake.output.rings,
    "rings",
    rings.project_batch(snakemake.input.touch, surface),
    {"seed": snakemake.params.seed, "config_digest": store.config_digest({"rings": rings.RINGS})},
)
