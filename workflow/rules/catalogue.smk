# The embedded source: procedural CAD objects, written as files that are then read like anyone's.
rule shapes:
    output:
        folder=directory("sources/{class}"),
    log:
        "logs/shapes/{class}.log",
    benchmark:
        "benchmarks/shapes/{class}.tsv"
    params:
        name=lambda wildcards: wildcards["class"],
        objects=lambda wildcards: CLASS_COUNTS[wildcards["class"]],
        seed=config["seed"],
    script:
        "../scripts/shapes.py"


# Which objects the run has: class, split, batch, file, checksum; one file of all, and one a batch.
rule catalogue:
    input:
        sources=lambda wildcards: source_inputs(ENTRIES),
        objects=[SOURCE["objects"]] if SOURCE["objects"] else [],
    output:
        catalogue="catalogue.csv",
        batches=expand("catalogue/{batch}.csv", batch=BATCHES),
    log:
        "logs/catalogue.log",
    benchmark:
        "benchmarks/catalogue.tsv"
    params:
        source=SOURCE,
        classes=CLASS_COUNTS,
        split=config["split"],
        batches={entry.object: PLACES[entry.object] for entry in ENTRIES},
        schema=SCHEMAS / "catalogue.schema.yaml",
    script:
        "../scripts/catalogue.py"


# What could not be used, from all stages: object, stage, reason.
rule rejected:
    input:
        parts=expand("rejected/{stage}/{batch}.csv", stage=STAGES, batch=BATCHES),
    output:
        table="rejected.csv",
    log:
        "logs/rejected.log",
    benchmark:
        "benchmarks/rejected.tsv"
    script:
        "../scripts/rejected.py"
