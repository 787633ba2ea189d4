"""The commands behind figures in the docs: `python -m studies.benchmarks.<name>`, in the project's folder."""
