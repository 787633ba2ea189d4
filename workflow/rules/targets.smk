# What is asked for by name: snakemake dataset, validate, smoke.


# Files of the run that the command line names from the project's root, as a shell completes them.
FROM_ROOT = [path for path in sys.argv[1:] if os.path.abspath(PROJECT / path).startswith(f"{RUN_FOLDER}/")]
TARGETS = {path: os.path.relpath(PROJECT / path, RUN_FOLDER) for path in FROM_ROOT}
# A stage's output that is asked for by itself brings the catalogue, without which the run can't be opened. It is no
# input of the stage: another catalogue makes no store again. A file that is forced is left to Snakemake.
OF_STAGES = {path for each in stages.STAGES.values() for path in expand(each.path(), batch=BATCHES)}
FORCED = re.compile("-[fRUOP].*|--(force|forcerun|until|omit-from|prioritize)(=.*)?")
if not any(map(FORCED.fullmatch, sys.argv[1:])):
    TARGETS |= {path: path for path in sys.argv[1:] if path in OF_STAGES}
for name, path in TARGETS.items():

    rule:
        name:
            name
        input:
            path,
            ["catalogue.csv"] if path in OF_STAGES else [],


localrules:
    validate,
    smoke,


# Every array of every store against the dataset contract.
rule validate_batch:
    input:
        **{stage.name: stage.path() for stage in DATASET},
        catalogue="catalogue/{batch}.csv",
        rejected=expand("rejected/{stage}/{{batch}}.csv", stage=STAGES),
    output:
        table="reports/validation/{batch}.csv",
    log:
        "logs/validate_batch/{batch}.log",
    benchmark:
        "benchmarks/validate_batch/{batch}.tsv"
    conda:
        "../../envs/palpate.yaml"
    params:
        max_penetration=config["grasps"]["max_penetration"],
    script:
        "../scripts/validate_batch.py"


rule validation:
    input:
        catalogue="catalogue.csv",
        rejected="rejected.csv",
        batches=expand("reports/validation/{batch}.csv", batch=BATCHES),
    output:
        table=report("reports/validation.csv", caption="../report/validation.rst", category="Dataset"),
    log:
        "logs/validation.log",
    benchmark:
        "benchmarks/validation.tsv"
    conda:
        "../../envs/palpate.yaml"
    script:
        "../scripts/validation.py"


NAMED = ("dataset", "all", "reports")


# A target that checks at each call, and fails if a check failed or nothing could be used. All that is asked for beside
# it is made before: what is not made yet would be of another time.
rule validate:
    input:
        table="reports/validation.csv",
        asked=lambda wildcards: [path for name in NAMED if name in sys.argv for path in getattr(rules, name).input],
        batches=expand("reports/validation/{batch}.csv", batch=BATCHES),
        catalogue="catalogue.csv",
        rejected="rejected.csv",
    log:
        "logs/validate.log",
    conda:
        "../../envs/palpate.yaml"
    params:
        max_penetration=config["grasps"]["max_penetration"],
        sources="sources" if SOURCE.kind == "procedural" else SOURCE.path,
    script:
        "../scripts/validate.py"


# The dataset with its tables and figures: nothing is trained.
rule dataset:
    input:
        STORES,
        [] if RELEASED else "reports/validation.csv",
        [product_files(each) for each in MADE if each.category == "Dataset"],


# A run of its own (config/smoke.yaml, results/smoke/), whatever the config of this one.
rule smoke:
    log:
        "logs/smoke.log",
    conda:
        "../../envs/palpate.yaml"
    threads: 2
    params:
        project=PROJECT,
        python=sys.executable,
        config=PROJECT / "config/smoke.yaml",
    shell:
        "log=$(realpath {log:q}); cd {params.project:q};"
        " {params.python:q} -m snakemake --cores {threads} all validate --configfile {params.config:q}"
        ' 2>&1 | tee "$log"'
