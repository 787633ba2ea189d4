from palpate.catalogue.source import LAYOUTS


# The embedded source: procedural CAD objects, written as files that are then read like anyone's.
rule shapes:
    output:
        folder=directory("sources/{class}"),
    log:
        "logs/shapes/{class}.log",
    benchmark:
        "benchmarks/shapes/{class}.tsv"
    conda:
        "../../envs/palpate.yaml"
    params:
        name=lambda wildcards: wildcards["class"],
        objects=lambda wildcards: CLASS_COUNTS[wildcards["class"]],
        seed=config["seed"],
        version=3,  # of what is written: files of an older one are made again
    script:
        "../scripts/shapes.py"


# The objects of a batch: class, file, checksum. By batch, so that one more object is no reason to read all files.
# Without splits, so that another split makes no meshes again.
rule catalogue_batch:
    input:
        sources=lambda wildcards: batch_sources(wildcards.batch),
    output:
        table="catalogue/{batch}.csv",
    log:
        "logs/catalogue/{batch}.log",
    benchmark:
        "benchmarks/catalogue/{batch}.tsv"
    conda:
        "../../envs/palpate.yaml"
    params:
        root=source_root,
        objects=lambda wildcards: [
            each._replace(split="") if each.split else each for each in batch_entries(wildcards.batch)
        ],
        seed=config["seed"] if SOURCE.kind == "procedural" else None,
        checksums=lambda wildcards: source_checksums(wildcards.batch),
    script:
        "../scripts/catalogue_batch.py"


# Which objects the run has, and their splits. Copies are in one, also those in another format: meshes tell their shapes.
rule catalogue:
    input:
        batches=expand("catalogue/{batch}.csv", batch=BATCHES),
        facts=expand("meshes/{batch}.facts.json", batch=BATCHES) if SOURCE.kind in LAYOUTS else [],
    output:
        table="catalogue.csv",
    log:
        "logs/catalogue.log",
    benchmark:
        "benchmarks/catalogue.tsv"
    conda:
        "../../envs/palpate.yaml"
    params:
        split=config["split"],
        given={entry.object: entry.split for entry in ENTRIES if entry.split},
        seed=config["seed"],
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
    conda:
        "../../envs/palpate.yaml"
    script:
        "../scripts/rejected.py"
