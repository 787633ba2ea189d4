from palpate.mesh import VERSION as MESH_VERSION


# Load, repair, normalise and decimate the meshes of a batch. Its objects are params and not the catalogue's rows, so
# that another split, or another object's file, does not make it again.
rule meshes:
    input:
        sources=lambda wildcards: batch_sources(wildcards.batch),
    output:
        meshes=directory("meshes/{batch}"),
        rejected="rejected/meshes/{batch}.csv",
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
        objects=lambda wildcards: {
            each.object: (each.source, each.up, each.scale, each.turn) for each in batch_entries(wildcards.batch)
        },
        folder=source_root,
        mesh=config["mesh"],
    script:
        "../scripts/meshes.py"
