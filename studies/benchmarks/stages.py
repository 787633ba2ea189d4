"""Processor time an object of each stage of a dataset, child processes included.

    python -m studies.benchmarks.stages results/demo
    python -m studies.benchmarks.stages results/demo --stages vision --every 4

One process does the stages' work as their scripts do, on the objects, meshes and grasps of a finished run with the
default hand and sensor. What a job takes once for all its objects, such as starting Python, does not count. To compare
two commits, run it in both, in turn.
"""

import argparse
import resource
import tempfile
from pathlib import Path

import yaml

from palpate.vision import Renderer  # isort: skip  (Blender: before anything that loads embree)

from palpate import hand, mesh, scene, store, surface, touch
from palpate.batch import generator
from palpate.catalogue import read_catalogue
from palpate.grasp import grasp_object
from palpate.hand import Hand
from palpate.sensor import DIGIT
from palpate.vision.image import vision_record

STAGES = ("meshes", "surface", "grasps", "touch", "vision")


def processor() -> float:
    """Seconds so far of this process and of its ended children."""
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("run", type=Path, help="a run's folder, results/<run>")
    parser.add_argument("--stages", nargs="+", default=STAGES, choices=STAGES)
    parser.add_argument("--every", type=int, default=1, help="only each n-th object of the catalogue")
    args = parser.parse_args()
    run, config = args.run, yaml.safe_load((args.run / "config.yaml").read_text())
    entries = {each.object: each for each in read_catalogue(run / "catalogue.csv")[:: args.every]}
    folders = {name: run / "meshes" / each.batch / name for name, each in entries.items()}
    stores = {
        (stage, batch): store.read(run / stage / f"{batch}{suffix}")
        for stage, suffix in (("surface", ".zarr"), ("grasps", ".h5"))
        for batch in {each.batch for each in entries.values()}
    }
    scratch = tempfile.TemporaryDirectory()
    seed, robot, renderer = config["seed"], hand.allegro(DIGIT.gel_face), None

    def row(stage: str, name: str) -> dict:
        arrays = stores[stage, entries[name].batch]
        number = arrays["object"].tolist().index(name)
        return {key: values[number] for key, values in arrays.items() if not key.startswith("hand/")}

    def scene_of(name: str) -> scene.Scene:
        kept = {key: values for key, values in row("grasps", name).items() if key in scene.GRASP_ARRAYS}
        return scene.Scene.from_grasps(folders[name], kept, stored_hand)

    def meshes(name: str) -> None:
        each, root = entries[name], run / "sources"
        faces = config["mesh"]["collision_faces"]
        mesh.prepare(root / each.source, Path(scratch.name) / name, each.up, faces, each.scale, root=root)

    def surface_points(name: str) -> dict:
        points = surface.sample(mesh.load_geometry(folders[name]), 10_000, generator(seed, name, "surface"))
        return {"points": points + mesh.OBJECT_POSITION, "scale": mesh.read_record(folders[name])["scale"]}

    def grasps(name: str) -> dict:
        visual, collision = mesh.load_visual(folders[name]), mesh.load_collision(folders[name])
        points = row("surface", name)["points"]
        return vars(grasp_object(visual, collision, points, robot, generator(seed, name, "grasps")))

    def touches(name: str) -> dict:
        of_object = scene_of(name)
        sensed = touch.sense_scene(of_object, touch.scene_tracer(of_object, DIGIT))
        return {"position": of_object.sensor_position, "rotation": of_object.sensor_rotation, **sensed._asdict()}

    def images(name: str) -> dict:
        cameras = scene.cameras(config["vision"])
        return vision_record(renderer.render_cameras(scene_of(name), cameras), cameras)

    work = dict(zip(STAGES, (meshes, surface_points, grasps, touches, images), strict=True))
    stored_hand = Hand.from_arrays(next(arrays for (stage, _), arrays in stores.items() if stage == "grasps"), "hand/")
    touch.empty_reading(DIGIT)
    if "vision" in args.stages:
        renderer = Renderer(config["vision"]["samples"], "cpu")
    print("| stage | s an object | of it the store |\n|---|---:|---:|")
    for stage in args.stages:
        work[stage](next(iter(entries)))  # imports, and what is kept for all objects
        begun = processor()
        records = {name: work[stage](name) for name in entries}
        made = processor()
        if stage != "meshes":
            more = {"empty_reading": touch.empty_reading(DIGIT)} if stage == "touch" else {}
            more |= {f"hand/{key}": array for key, array in robot.to_arrays().items()} if stage == "grasps" else {}
            attributes = {"sensor": DIGIT.description()} if stage == "touch" else {}
            paths = {stage: Path(scratch.name) / f"{stage}{'.h5' if stage == 'grasps' else '.zarr'}"}
            paths["rejected"] = Path(scratch.name) / "rejected.csv"
            store.write_batch(paths, stage, (records, []), seed, {}, more, attributes)
        ended = processor()
        print(f"| {stage} | {(ended - begun) / len(entries):.3f} | {(ended - made) / len(entries):.3f} |", flush=True)
    scratch.cleanup()


if __name__ == "__main__":
    main()
