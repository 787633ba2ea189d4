"""The command `palpate`: check a config, look at a run, use its models, hand it on. Snakemake makes runs.

palpate check mine.yaml                 in seconds: meshes, sizes, splits, the hand, one object through every stage
palpate view results/mine mug-01        an HTML page to turn with the mouse; without an object, the page of the run
palpate info results/mine               what a run holds
palpate validate results/mine           every file and array against what it should be
palpate reconstruct results/mine charts_occluded_touch mug-01 --output mug.ply
palpate export results/mine shared      the run as WebDataset, or as Parquet and images, with a data card
palpate calibrate images --ball 0.004 --sensor mine.yaml    a real sensor's light, from images of a pressed ball
"""

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

import palpate
from palpate.configuration import read_yaml

# Extras of the package that bring what a command may lack, by the first module that is missed.
EXTRAS = dict.fromkeys(("bpy", "embreex", "igl", "mujoco", "OpenEXR", "pymeshlab"), "factory")
EXTRAS |= dict.fromkeys(("lightning_fabric", "matplotlib", "torch"), "models") | {"pyarrow": "parquet"}
TYPES = {"path": Path, "int": int, "float": float}  # of arguments, as command.yaml calls them


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status: 0, or 1 if it failed, with a line of why on standard error."""
    parser = argparse.ArgumentParser(
        prog="palpate", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--version", action="version", version=f"palpate {palpate.__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="command")
    for name, command in read_yaml(Path(__file__).with_suffix(".yaml")).items():
        own = commands.add_parser(name, help=command["does"], description=f"{command['does'].capitalize()}.")
        for argument, options in command["arguments"].items():
            own.add_argument(argument, **options | ({"type": TYPES[options["type"]]} if "type" in options else {}))
    args = parser.parse_args(arguments)
    try:
        COMMANDS[args.command](args)
        sys.stdout.flush()
        return 0
    except BrokenPipeError:  # what reads the output has ended, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # for what Python flushes at its end
        return 1
    except (ValueError, LookupError, OSError, ImportError) as error:
        print(error_message(error), file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\ninterrupted; the same command starts again", file=sys.stderr)
        return 130


def error_message(error: Exception) -> str:
    """An error in one line, with the extra of the package that brings a module that is missing."""
    from palpate.batch import one_line_error

    if isinstance(error, ModuleNotFoundError) and (extra := EXTRAS.get((error.name or "").partition(".")[0])):
        return f"{error}: pip install 'palpate[{extra}]' brings it"
    if isinstance(error, OSError):
        return one_line_error(error)
    return str(error.args[0]) if isinstance(error, KeyError) else str(error)


def check(args: argparse.Namespace) -> None:
    """Look at a config before its run."""
    from palpate.check import check_config

    check_config(args.config, args.object, args.output)


def view(args: argparse.Namespace) -> None:
    """Write pages and print their paths."""
    from palpate.batch import progress
    from palpate.dataset import Dataset
    from palpate.viewer import object_page, run_page
    from palpate.viewer.index import OBJECT_PAGES

    dataset = Dataset(args.run)
    folder, page = args.output or args.run / "viewer", (args.output or args.run) / "index.html"
    names = dataset.objects if args.all else [args.object] if args.object else []
    records = [dataset[name] for name in names]
    model = None
    if args.model:
        from palpate.learning.reconstruct import Reconstructor, named_model

        if not names:
            raise ValueError("--model: name an object, or give --all")
        model = Reconstructor(named_model(args.run / "models", args.model, args.seed), args.device)
    for record in progress(records, unit="page") if len(records) > 1 else records:
        predictions = model.predictions(record, args.grasps) if model else None
        path = folder / f"{record.name}.html"
        scene = object_page(path, record, args.grasps, predictions, args.model or "")
        if not args.all:
            print(f"{path}\n{scene}")
    if args.all or not args.object:
        print(run_page(args.run, page, folder, object_pages=0 if args.all else OBJECT_PAGES))
    elif page.exists():  # which links the object's page now
        run_page(args.run, page, folder, object_pages=0)


def reconstruct(args: argparse.Namespace) -> None:
    """Write the mesh that a model predicts."""
    from palpate.atomic import atomic_write
    from palpate.dataset import Dataset
    from palpate.learning.reconstruct import FORMATS, ReconstructionError, Reconstructor, named_model

    if args.output.suffix not in FORMATS:
        raise ReconstructionError(f"{args.output}: the name must end in one of {', '.join(FORMATS)}")
    path, record = named_model(args.run / "models", args.experiment, args.seed), Dataset(args.run)[args.object]
    model = Reconstructor(path, args.device)  # loads torch: after what can be wrong without it
    mesh = model.predict(record, args.grasp, args.view, args.closed).mesh()
    with atomic_write(args.output) as partial:
        mesh.export(partial)
    print(f"{args.output}: {len(mesh.vertices)} vertices, {len(mesh.faces)} faces, metres, world frame")


def validate(args: argparse.Namespace) -> None:
    """Check a run, and print what was found; ValueError if a check failed. Values that a report is about are not read
    again."""
    from palpate.dataset import validation
    from palpate.dataset.run import Run

    run = Run(args.run)
    tables = [run.folder / f"reports/validation/{batch}.csv" for batch in run.batches]
    settings = run.config.get("grasps", {})
    limit = {"max_penetration": settings["max_penetration"]} if "max_penetration" in settings else {}
    passed, report = validation.validate(run.folder, tables, sources=args.sources or run.sources, **limit)
    if not passed:
        raise ValueError(report)
    print(report)


def info(args: argparse.Namespace) -> None:
    """Print what a run holds."""
    from palpate.dataset import Dataset
    from palpate.dataset.summary import run_lines

    print("\n".join(run_lines(Dataset(args.run))))


def export(args: argparse.Namespace) -> None:
    """Write a run in another layout, whole or not at all."""
    from palpate import interchange
    from palpate.dataset import Dataset

    given = (args.output, args.format, args.arrays, args.license, args.source, args.samples)
    print(f"{args.output}: {interchange.export(Dataset(args.run), *given)} {args.samples}")


def calibrate(args: argparse.Namespace) -> None:
    """Fit a sensor's light to real images; write its file and a page, and print the errors."""
    from dataclasses import replace

    from palpate import sensor
    from palpate.touch.calibration import AROUND, calibrate, write_sensor
    from palpate.viewer.html import data_uri, render, resource

    base = args.extends or (str(args.sensor.absolute()) if args.sensor.exists() else "gelsight_mini")
    kind = replace(sensor.load(base), name=args.sensor.stem)
    found = calibrate(args.folder, kind, args.ball and args.ball / 2, args.circles, args.table)
    write_sensor(found.sensor, args.sensor)
    page, difference = args.sensor.with_suffix(".html"), 128 + found.simulated.astype(int) - found.real
    shown = {"real": found.real, "simulated": found.simulated, "difference": difference.clip(0, 255).astype("uint8")}
    images = {caption: [data_uri(image, 320) for image in stack] for caption, stack in shown.items()}
    values = {"found": found, "images": images, "around": AROUND, "style": resource("viewer.css")}
    render(page, "calibration.html.jinja", **values)
    kept = ~found.fitted
    errors = {"simulated": found.error, "untouched image": found.untouched_error, "noise": found.noise}
    words = ", ".join(f"{name} {error[kept].mean():.2f}" for name, error in errors.items())
    print(f"mean absolute error on {kept.sum()} images left out, grey levels: {words}")
    print(f"{args.sensor}\n{page}")


COMMANDS = {run.__name__: run for run in (check, view, reconstruct, validate, calibrate, info, export)}

if __name__ == "__main__":
    sys.exit(main())
