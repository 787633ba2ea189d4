# Load, repair, normalise and decimate the meshes of a batch.
rule meshes:
    input:
        catalogue="catalogue/{batch}.csv",
        sources=batch_sources,
    output:
        meshes=directory("meshes/{batch}"),
        rejected="rejected/meshes/{batch}.csv",
    log:
        "logs/meshes/{batch}.log",
    benchmark:
        "benchmarks/meshes/{batch}.tsv"
    conda:
        CONDA
    threads: 1
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        source=SOURCE,
        mesh=config["mesh"],
    script:
        "../scripts/meshes.py"
