"""Square rings of surface points around every successful touch of a batch.

rings/<batch>.zarr; arrays: palpate/store/contract.csv
"""

from workflow.run.job import log_to

from pathlib import Path

from palpate import mesh, seal, store
from palpate.learning import rings
from palpate.sensor import Sensor

log_to(snakemake.log[0])
touch = store.open(snakemake.input.touch).seal
if snakemake.input.meshes:
    meshes = Path(snakemake.input.meshes)
    inputs = [seal.read(meshes), touch]

    def surface(name: str, sensor: Sensor) -> rings.MeshSurface:
        return rings.MeshSurface(mesh.load_visual(meshes / name), mesh.OBJECT_POSITION, sensor)

else:
    points = store.open(snakemake.input.surface)
    inputs = [points.seal, touch]
    clouds = dict(zip(points["object"], points["points"], strict=True))

    def surface(name: str, sensor: Sensor) -> rings.CloudSurface:
        return rings.CloudSurface(clouds[name], sensor)


store.write(
    snakemake.output.rings,
    "rings",
    rings.project_batch(snakemake.input.touch, surface),
    {"seed": snakemake.params.seed, "made_from": seal.combine({"rings": {"count": rings.RINGS}}, *inputs)},
)
