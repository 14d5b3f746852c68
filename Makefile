# Everything runs either on DOLFINx's wheel, in .venv (needs a Python >= 3.12, which is searched
# for), or on Debian's DOLFINx with the system's Python, where nothing is installed.
# DOLFINX=wheel or DOLFINX=apt forces one, ARGS="..." is handed on:  make test ARGS="-k mapping"
# JOBS=N: so many processes for the tests.
.DEFAULT_GOAL := help
MAKEFLAGS += --no-print-directory

SYSTEM_PYTHON ?= /usr/bin/python3
export SYSTEM_PYTHON
STAMP := .venv/.stamp
ARGS ?=
JOBS ?= 2

# One thread per process: the parallelism is MPI's, and runs are then repeatable.
export OMP_NUM_THREADS := 1
# Open MPI (Debian's) refuses more processes than cores, and to run as root, unless told.
export OMPI_MCA_rmaps_base_oversubscribe := 1
# Ranks wait in a loop and keep their cores busy.  Where there are more of them than free cores, they
# sleep for a moment (MPICH), or let others go first and take any core (Open MPI, which binds runs
# that are beside one another to the same cores): about half the time.
export MPIR_CVAR_ENABLE_HEAVY_YIELD := 1
export OMPI_MCA_mpi_yield_when_idle := 1
export OMPI_MCA_hwloc_base_binding_policy := none
ifeq ($(shell id -u),0)
export OMPI_ALLOW_RUN_AS_ROOT := 1
export OMPI_ALLOW_RUN_AS_ROOT_CONFIRM := 1
endif

# The search for a Python takes a moment, so it is made only for goals that use the answer.
ifneq ($(filter setup demo foundation test test-ranks validate speed bench lint docs linkcheck,$(MAKECMDGOALS)),)
ifndef DOLFINX
DOLFINX := $(shell PYTHON="$(PYTHON)" sh scripts/setup.sh mode)
endif
ifeq ($(filter wheel apt,$(DOLFINX)),)
$(error DOLFINX must be wheel or apt, not '$(DOLFINX)')
endif
endif

# The folder of the interpreter goes first on PATH, so that mpiexec is the one of its mpi4py.
# In .venv no other PYTHONPATH is let in: it could bring another DOLFINx.
ifeq ($(DOLFINX),wheel)
READY := $(STAMP)
PY = env PATH="$(CURDIR)/.venv/bin:$$PATH" PYTHONPATH="$(CURDIR)" "$(CURDIR)/.venv/bin/python"
RUFF = .venv/bin/ruff
else
READY := check-apt
PY = env PATH="$(dir $(SYSTEM_PYTHON)):$$PATH" PYTHONNOUSERSITE=1 \
	PYTHONPATH="$(CURDIR)$${PYTHONPATH:+:$$PYTHONPATH}" "$(SYSTEM_PYTHON)"
RUFF = ruff
endif

.PHONY: help setup demo foundation test test-apt test-ranks validate speed bench lint docs \
	linkcheck check-apt only-in-venv clean distclean

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-10s %s\n", $$1, $$2 }' Makefile
	@echo
	@echo '  DOLFINX=wheel|apt forces .venv or the packages of Debian; PYTHON=... names the Python of'
	@echo '  .venv; ARGS="..." goes to the command that is run, as in: make test ARGS="-x -k mapping";'
	@echo '  JOBS=4: four processes for the tests instead of two'

setup: $(READY) ## build .venv, or check Debian's packages where there is no Python >= 3.12
	@echo "Ready, on DOLFINx from: $(DOLFINX)"

demo: $(READY) ## run demos/column.py, into build/demos
	@$(PY) demos/column.py --results build/demos $(ARGS)

foundation: $(READY) ## run demos/foundation.py, into build/demos (minutes; ARGS=--quick: less)
	@$(PY) demos/foundation.py --results build/demos $(ARGS)

test: $(READY) ## run the tests
	@$(PY) -m pytest -n $(JOBS) --dist loadfile $(ARGS)

test-apt: ## run the tests on Debian's DOLFINx, with /usr/bin/python3
	@$(MAKE) test DOLFINX=apt

test-ranks: $(READY) ## run scenes on two, three and four processes (11 minutes)
	@$(PY) -m pytest -m ranks $(ARGS)

validate: $(READY) ## run the long cases with exact or published answers (an hour)
	@$(PY) -m pytest -m validation tests/validation tests -n $(JOBS) --dist loadfile \
		$(or $(ARGS),--afresh)

speed: $(READY) ## draw error against seconds, into results (20 minutes; ARGS=--quick: two)
	@$(PY) studies/speed_against_error.py $(ARGS)

bench: $(READY) ## run the timings in benchmarks/
ifneq ($(DOLFINX),wheel)
	@sh scripts/setup.sh check-apt pytest_benchmark
endif
	@$(PY) -m pytest -m benchmark benchmarks $(ARGS)

lint: $(filter $(STAMP),$(READY)) ## check the style with ruff
	@command -v $(RUFF) >/dev/null || \
		{ echo "ruff is not on PATH: pip install 'ruff>=0.17,<0.18'" >&2; exit 1; }
	@$(RUFF) check $(ARGS) .
	@$(RUFF) format --check --quiet . || { echo "ruff format would change files: run it" >&2; exit 1; }

STAMP_DOCS := $(if $(filter wheel,$(DOLFINX)),.venv/.stamp-docs,only-in-venv)
# -W: a link that leads nowhere inside the pages, or a docstring that cannot be read, is an error.
docs: $(STAMP_DOCS) ## build the documentation into docs/_build/html, demos run (some minutes)
	@$(PY) -m sphinx -W --keep-going -q docs docs/_build/html $(ARGS)
	@echo "The documentation is in docs/_build/html/index.html"

linkcheck: $(STAMP_DOCS) ## ask the network whether links out of the documentation lead somewhere
	@$(PY) -m sphinx -q -b linkcheck -D plot_gallery=0 docs docs/_build/linkcheck $(ARGS)

# Sphinx is in .venv only where pages have been built, so that the tests do not wait for it.
.venv/.stamp-docs: $(STAMP) pyproject.toml
	@echo "Adding Sphinx to .venv, about half a minute ..." >&2
	@.venv/bin/python -m pip install --quiet --disable-pip-version-check --progress-bar off \
		-e ".[docs]" </dev/null
	@touch $@

only-in-venv:
	@echo "The documentation is built on DOLFINx's wheel only, in .venv: see 'make setup'" >&2; exit 1

$(STAMP): pyproject.toml
	@sh scripts/setup.sh wheel

check-apt:
	@sh scripts/setup.sh check-apt

clean: ## remove caches, build leftovers and snapshots in results/
	rm -rf build dist *.egg-info .pytest_cache .ruff_cache .hypothesis .benchmarks \
		docs/_build docs/gallery docs/sg_execution_times.rst
	find . -name .venv -prune -o -name __pycache__ -type d -prune -exec rm -rf {} +
	rm -rf results/*.vtu results/*.pvtu results/*.pvd results/*.xdmf results/*.h5 results/checkpoints

distclean: clean ## the same, and remove .venv
	rm -rf .venv .venv-lint
