# Closing hands, if the config asks for them: the frames of every grasp, and images of some of them.
rule frames:
    input:
        meshes="meshes/{batch}",
        surface="surface/{batch}.zarr",
        grasps="grasps/{batch}.h5",
        background=SENSOR_BACKGROUND,
    output:
        frames=directory("frames/{batch}.zarr"),
    log:
        "logs/frames/{batch}.log",
    benchmark:
        "benchmarks/frames/{batch}.tsv"
    conda:
        "../../envs/palpate.yaml"
    params:
        frames=lambda wildcards: {key: asked("frames", "count")[key] for key in ("count", "touch", "contacts")},
        grasps=config["grasps"],
        hold=GRASPS_HOLD,
        sensor=SENSOR.description(),
        seed=config["seed"],
    script:
        "../scripts/frames.py"


rule frame_images:
    input:
        meshes="meshes/{batch}",
        grasps="grasps/{batch}.h5",
        frames="frames/{batch}.zarr",
    output:
        frame_images=directory("frame_images/{batch}.zarr"),
        rejected="rejected/frame_images/{batch}.csv",
    log:
        "logs/frame_images/{batch}.log",
    benchmark:
        "benchmarks/frame_images/{batch}.tsv"
    conda:
        "../../envs/palpate.yaml"
    resources:
        mem_mb=lambda wildcards: 2000 + texture_mb(wildcards.batch),
        runtime=120,
    params:
        frames=lambda wildcards: {"images": asked("frames", "images")["images"]},
        vision=config["vision"],
        seed=config["seed"],
    script:
        "../scripts/frame_images.py"
