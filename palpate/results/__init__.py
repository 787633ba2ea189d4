"""Results of a run: tables and figures of its dataset and its models, and the verdict on each of the paper's claims.

Each module is imported by its own name, because each brings its own engine: tables need pandas only, `atlas` and
`local_predictions` torch, `reconstructions` torch and Blender, which must be imported first.
"""
