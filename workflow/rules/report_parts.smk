# What each part of the reports reads, and which parts the config asks for.
from studies.subjects import in_turn

REPORT_OBJECTS = in_turn(ENTRIES, lambda entry: entry.class_name)[
    : config["reports"]["objects"]
]
REPORT_BATCHES = sorted(
    {BATCHES[ENTRIES.index(entry) // config["batch_size"]] for entry in REPORT_OBJECTS}
)
STORE_OF = {
    "meshes": "meshes/{batch}",
    "surface": "surface/{batch}.zarr",
    "grasps": "grasps/{batch}.h5",
    "touch": "touch/{batch}.zarr",
    "charts": "charts/{batch}.zarr",
    "vision": "vision/{batch}.zarr",
    "views": "views/{batch}.zarr",
    "touch_depth": "models/touch_depth/best.ckpt",
    # Of all batches: models are trained.
    "training": [
        "catalogue.csv",
        *expand("surface/{batch}.zarr", batch=BATCHES),
        *expand("vision/{batch}.zarr", batch=BATCHES),
    ],
    "all_objects": "catalogue.csv",
}
# A part of a report: what it reads of the run, the sections of the config that it depends on, and the stages of
# `reports.stages` that it belongs to.
REPORT_PARTS = {
    "error_vs_runtime": {
        "decimation": (["meshes"], ["mesh"], ["decimation"]),
        "surface": (["meshes"], ["surface"], ["surface"]),
        "grasps": (["meshes", "surface", "grasps"], ["grasps"], ["grasps"]),
        "patches": (["meshes", "surface", "grasps"], ["grasps"], ["grasps"]),
        "touch": (["meshes", "grasps"], ["touch", "mesh"], ["touch"]),
        "shading": (["meshes"], [], ["shading"]),
        "renders": (["meshes", "grasps"], ["vision"], ["renders"]),
        "touch_charts": (["meshes", "touch"], ["training"], ["touch_charts"]),
        "chamfer": (["meshes"], ["surface", "recipe", "evaluation"], ["chamfer"]),
        "reconstruction": (
            ["meshes", "training"],
            ["recipe", "training", "evaluation"],
            ["reconstruction"],
        ),
    },
    "stability": {
        "contact": (["meshes"], [], ["grasps"]),
        "geometry": (["meshes"], [], ["decimation", "surface"]),
        "rays": (["meshes"], [], ["touch", "shading"]),
        "losses": (["meshes"], [], ["touch_charts", "chamfer", "reconstruction"]),
    },
    "left_out": {
        "meshes": (["meshes"], ["mesh"], ["decimation"]),
        "grasps": (["meshes", "surface", "grasps"], ["grasps"], ["grasps"]),
        "touch": (["meshes", "grasps"], ["touch"], ["touch"]),
        "renders": (["meshes", "grasps"], ["vision", "views", "seed"], ["renders"]),
        "models": (
            [
                "all_objects",
                "surface",
                "touch",
                "charts",
                "vision",
                "views",
                "touch_depth",
            ],
            ["recipe", "training"],
            ["reconstruction"],
        ),
    },
}
REPORT_STAGES = {
    name: [
        part
        for part, (_, _, stages) in parts.items()
        if config["reports"]["stages"] == "all"
        or set(stages) & set(config["reports"]["stages"])
    ]
    for name, parts in REPORT_PARTS.items()
}


def report_inputs(report_name):
    """The stores that a part reads, of the batches that hold the report's objects."""

    def inputs(wildcards):
        stores, _, _ = REPORT_PARTS[report_name][wildcards.part]
        return {
            "catalogue": expand("catalogue/{batch}.csv", batch=REPORT_BATCHES),
            **{
                store: expand(STORE_OF[store], batch=REPORT_BATCHES) for store in stores
            },
        }

    return inputs


def report_settings(report_name):
    """The sections of the config that a part depends on; `recipe` is the run's, with its overrides."""

    def settings(wildcards):
        _, sections, _ = REPORT_PARTS[report_name][wildcards.part]
        return {
            section: RECIPE if section == "recipe" else config[section]
            for section in sections
        }

    return settings


def report_parts(report_name):
    return expand(
        f"reports/{report_name}/{{part}}.csv", part=REPORT_STAGES[report_name]
    )


def whole_machine():
    """Threads of a job beside which no other job may run, because it takes times; it works on one."""
    return workflow.cores or 1
