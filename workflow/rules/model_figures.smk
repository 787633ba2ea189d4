FIGURE_OF_TABLE = {"grasps": "multi_grasp", "extrapolation": "error_over_rings"}
# Every training that a table needs.
TRAINED = sorted(
    {
        name
        for table, declared in EXPERIMENTS["tables"].items()
        if f"tables/{table}.csv" in MODEL_TABLES
        for name in declared["experiments"]
    }
)

FIGURES += expand(
    "figures/{figure}.png",
    figure=[
        *(
            FIGURE_OF_TABLE[table]
            for table in EXPERIMENTS["tables"]
            if table in FIGURE_OF_TABLE
        ),
        "training_curves",
    ],
)


rule multi_grasp:
    input:
        evaluations=lambda wildcards: evaluations_of(
            table_setup("grasps")["experiments"]
        ),
    output:
        figure=report(
            "figures/multi_grasp.png",
            caption="../report/multi_grasp.rst",
            category="Models",
        ),
    log:
        "logs/multi_grasp.log",
    benchmark:
        "benchmarks/multi_grasp.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        setup=lambda wildcards: table_setup("grasps"),
    script:
        "../scripts/multi_grasp.py"


rule error_over_rings:
    input:
        evaluations=lambda wildcards: evaluations_of(
            table_setup("extrapolation")["experiments"], "evaluations/rings"
        ),
    output:
        figure=report(
            "figures/error_over_rings.png",
            caption="../report/error_over_rings.rst",
            category="Models",
        ),
    log:
        "logs/error_over_rings.log",
    benchmark:
        "benchmarks/error_over_rings.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        setup=lambda wildcards: table_setup("extrapolation"),
    script:
        "../scripts/error_over_rings.py"


rule training_curves:
    input:
        histories=expand(
            "models/{experiment}/seed-{seed}/history.csv",
            experiment=TRAINED,
            seed=config["training"]["seeds"],
        ),
    output:
        figure=report(
            "figures/training_curves.png",
            caption="../report/training_curves.rst",
            category="Models",
        ),
    log:
        "logs/training_curves.log",
    benchmark:
        "benchmarks/training_curves.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        trainings=[
            (name, seed) for name in TRAINED for seed in config["training"]["seeds"]
        ],
        experiments={name: EXPERIMENTS["experiments"][name] for name in TRAINED},
    script:
        "../scripts/training_curves.py"
