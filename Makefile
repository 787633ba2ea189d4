# The README's commands. `make env` builds .venv from the locked requirements; everything else needs it.
PYTHON ?= python3.11
CORES ?= $(shell nproc)
BIN := .venv/bin
UV_VERSION := 0.13.8

.PHONY: demo run smoke examples test lint site env slurm lock

# A few objects: their data and pictures, without training.
demo: env
	$(BIN)/snakemake --cores $(CORES) dataset validate --configfile config/demo.yaml
	@$(BIN)/palpate view results/demo

run: env
	$(BIN)/snakemake --cores $(CORES) all validate
	@$(BIN)/palpate view results/default

smoke: env
	$(BIN)/snakemake --cores $(CORES) all validate --configfile config/smoke.yaml

# On the smoke run.
examples: env
	for each in bring_meshes train_on_a_run reconstruct_a_grasp compare_sensors; do \
	  $(BIN)/python examples/$$each.py || exit 1; done

test: env
	OMP_NUM_THREADS=1 $(BIN)/pytest --numprocesses $(CORES) --dist loadgroup --durations 15

lint: env
	$(BIN)/ruff check .
	$(BIN)/ruff format --check palpate tests workflow studies examples
	$(BIN)/mypy
	$(BIN)/snakefmt --check Snakefile workflow
	$(BIN)/snakemake --lint

# The documentation as a site, in site/.
# Not --quiet: it hides warnings from --strict.
site: env
	$(BIN)/pip install --quiet --no-deps --requirement envs/docs.txt
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# Byte code of the checkout, too: where Python writes none, as in many containers, every job would compile it.
env: .venv/installed
	@$(BIN)/python -m compileall -q palpate studies workflow snakemake_logger_plugin_palpate
	@$(BIN)/python -m palpate.vision.system --install

.venv/installed: envs/requirements.txt pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' 2>/dev/null || \
	  { echo "Palpate needs Python 3.11 (Blender's wheel is built for it): name it with make PYTHON=/path/to/python3.11" >&2; exit 1; }
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --no-compile --requirement envs/requirements.txt
# As pip does, which takes one core, but for the packages' own tests; not all is valid.
	$(BIN)/python -m compileall -qq -j $(CORES) -x '/tests?/' .venv/lib || true
	$(BIN)/pip install --quiet --no-deps --no-build-isolation --editable .
	touch $@

# What profiles/slurm needs besides. It declares another NumPy than the locked one: no dependencies.
slurm: env
	$(BIN)/pip install --quiet --no-deps --requirement envs/slurm.txt

# Resolve envs/requirements.in and development.in again: requirements.txt for pip, and from it palpate.yaml for conda.
# The CUDA packages are left to torch, which names their exact versions itself: a CPU build of torch must not bring them.
lock: env
	$(BIN)/pip install --quiet uv==$(UV_VERSION)
	@printf '# Locked: made from requirements.in by `make lock`. Python 3.11, Linux.\n' > envs/requirements.txt
	$(BIN)/uv pip compile --quiet --python-version 3.11 --no-header --no-annotate --no-emit-index-url \
	  envs/requirements.in envs/development.in | grep -vE '^(nvidia-|cuda-|triton)' >> envs/requirements.txt
	@{ printf '# Made from requirements.txt by `make lock`: the same list, for Snakemake with conda.\n'; \
	  printf 'channels: [conda-forge, nodefaults]\ndependencies:\n  - python=3.11\n  - pip\n  - pip:\n'; \
	  sed -n 's/^[a-z].*/      - &/p' envs/requirements.txt; } > envs/palpate.yaml
	@for extra in slurm docs; do \
	  printf "# Locked: made from $$extra.in by \`make lock\`. In addition to requirements.txt, by pip install --no-deps.\n" > envs/$$extra.txt; \
	  $(BIN)/uv pip compile --quiet --python-version 3.11 --no-header --no-annotate --no-emit-index-url \
	    --override envs/requirements.txt envs/$$extra.in | grep -vxFf envs/requirements.txt >> envs/$$extra.txt; \
	done
