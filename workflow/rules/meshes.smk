from palpate.mesh import VERSION as MESH_VERSION


# Load, repair, normalise and decimate the meshes of a batch. A source file that changes changes its row of the batch's
# catalogue. With all files as inputs of this rule, too, a plan of many objects would take twice the memory for them.
rule meshes:
    input:
        catalogue="catalogue/{batch}.csv",
        sources=lambda wildcards: batch_sources(wildcards.batch) if SOURCE.kind == "procedural" else [],
    output:
        meshes=directory("meshes/{batch}"),
        rejected="rejected/meshes/{batch}.csv",
        facts="meshes/{batch}.facts.json",
    log:
        "logs/meshes/{batch}.log",
    benchmark:
        "benchmarks/meshes/{batch}.tsv"
    conda:
        "../../envs/palpate.yaml"
    resources:
        mem_mb=mesh_memory,
    params:
        version=MESH_VERSION,
        folder=source_root,
        mesh=config["mesh"],
    script:
        "../scripts/meshes.py"
