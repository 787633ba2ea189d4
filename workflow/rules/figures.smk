# They show meshes and hands.
FIGURES = (
    []
    if RELEASED
    else [
        "figures/data_point.png",
        "figures/grasp_steps.png",
        *expand("figures/examples_{name}.png", name=CLASS_COUNTS),
    ]
)


rule data_point:
    input:
        STORES,
        meshes=expand("meshes/{batch}", batch=BATCHES),
    output:
        figure=report(
            "figures/data_point.png",
            caption="../report/data_point.rst",
            category="Dataset",
        ),
    log:
        "logs/data_point.log",
    benchmark:
        "benchmarks/data_point.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=3000,
        runtime=10,
    script:
        "../scripts/data_point.py"


rule grasp_steps:
    input:
        STORES,
        meshes=expand("meshes/{batch}", batch=BATCHES),
    output:
        figure=report(
            "figures/grasp_steps.png",
            caption="../report/grasp_steps.rst",
            category="Dataset",
        ),
    log:
        "logs/grasp_steps.log",
    benchmark:
        "benchmarks/grasp_steps.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=3000,
        runtime=10,
    script:
        "../scripts/grasp_steps.py"


rule examples:
    input:
        STORES,
        meshes=expand("meshes/{batch}", batch=BATCHES),
    output:
        figure=report(
            "figures/examples_{name}.png",
            caption="../report/examples.rst",
            category="Dataset",
            labels={"class": "{name}"},
        ),
    log:
        "logs/examples_{name}.log",
    benchmark:
        "benchmarks/examples_{name}.tsv"
    wildcard_constraints:
        name=CLASS_NAME,
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=3000,
        runtime=10,
    script:
        "../scripts/examples.py"
