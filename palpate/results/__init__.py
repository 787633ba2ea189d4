"""Results of a run: tables and figures of its dataset and its models, and the verdict on each of the paper's claims.
pandas, matplotlib, torch and Blender are imported in functions: the workflow's start imports all modules."""
