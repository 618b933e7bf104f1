# Only make and Python 3.11 are needed: every target sets up what it uses in .venv first.
# ARGS adds options, for example: make recover ARGS="--replicates 3"; make test ARGS="tests/gait"

PYTHON ?= python3.11
VENV := .venv
PY := $(VENV)/bin/python
# Modules are compiled to bytecode when they are first imported: many of them never are. Where
# the environment forbids that, every process would compile all that it imports, for seconds.
unexport PYTHONDONTWRITEBYTECODE
PIP := $(PY) -m pip install -qq --disable-pip-version-check --no-compile
OUT ?= out/recovery
# A worker for each core, of one thread: the threads of BLAS and PyTorch would wait for each other and
# take twice the processor's time. An idle worker takes tests from the others.
PARALLEL ?= --numprocesses auto --dist worksteal
test test-slow: export OPENBLAS_NUM_THREADS ?= 1
test test-slow: export OMP_NUM_THREADS ?= 1

# Formats and lints JavaScript; biome.json has its settings.
BIOME := npx --yes @biomejs/biome@2.6.8

TARGETS := recover results test test-slow lint verify verify-inference bench pages docs clean
.PHONY: $(TARGETS)
.DEFAULT_GOAL := recover

# make would take "make results physics" for two targets, and make all results first.
OTHERS := $(filter-out $(TARGETS) $(VENV)/%,$(MAKECMDGOALS))
ifneq ($(OTHERS),)
FIRST := $(firstword $(filter $(TARGETS),$(MAKECMDGOALS)))
$(error $(firstword $(OTHERS)) is no target, which are $(TARGETS)$(if $(FIRST),; say make $(FIRST) ARGS="$(OTHERS)"))
endif

recover: $(VENV)/.installed
	$(PY) examples/damage_recovery.py --out $(OUT) $(ARGS)

test: $(VENV)/.installed-test
	$(PY) -m pytest -m "not slow" $(PARALLEL) $(ARGS)

test-slow: $(VENV)/.installed-test
	$(PY) -m pytest -m slow --timeout 3600 $(PARALLEL) $(ARGS)

lint: $(VENV)/.installed-test
	$(PY) -m ruff format --check .
	$(PY) -m ruff check .
	$(PY) -m mypy
	$(VENV)/bin/lint-imports
	@if command -v npx >/dev/null; then $(BIOME) check .; \
		else echo "npx is not installed: the JavaScript is not checked"; fi

# Is the physics right, and how fast is it? ARGS="--help" lists the parts of each.
verify: $(VENV)/.installed-test
	$(PY) -m instruments.verification $(ARGS)

# Is joint inference right and honest? It takes about an hour on two cores; ARGS="--bodies 0.1" is less.
verify-inference: $(VENV)/.installed-test
	$(PY) -m instruments.inference $(ARGS)

bench: $(VENV)/.installed-test
	$(PY) -m instruments.benchmarks $(ARGS)

# Makes the committed results that are not up to date; ARGS="--plan" only says how long it takes.
results: $(VENV)/.installed-test
	$(PY) -m experiments.results $(ARGS)

# Fills the tables of README and docs from the committed results.
pages: $(VENV)/.installed-test
	$(PY) -m experiments.pages

docs: $(VENV)/.installed-docs
	$(VENV)/bin/sphinx-build -W -j auto $(ARGS) docs docs/_build

clean:
	rm -rf $(VENV) build dist *.egg-info .mypy_cache .pytest_cache .ruff_cache \
		.import_linter_cache .hypothesis docs/_build

# A stamp is touched last, so that an interrupted installation is taken up again.
$(VENV)/.created:
	@echo "installing into $(VENV), once: this takes a minute"
	$(PYTHON) -m venv $(VENV)
	touch $@

$(VENV)/.installed: pyproject.toml | $(VENV)/.created
	$(PIP) --editable ".[all]"
	touch $@

# PyTorch first and by itself, from its CPU index: the build that the default index gives on
# Linux brings gigabytes of CUDA. Where that index cannot be reached, pip says so once and
# falls back to the default index.
$(VENV)/.installed-torch: | $(VENV)/.created
	$(PIP) --no-deps --retries 0 torch==2.13.0 \
		--extra-index-url https://download.pytorch.org/whl/cpu
	touch $@

$(VENV)/.installed-test: $(VENV)/.installed $(VENV)/.installed-torch
	$(PIP) --editable ".[test,rl]"
	touch $@

$(VENV)/.installed-docs: $(VENV)/.installed
	$(PIP) --editable ".[docs]"
	touch $@

# All of the above by one call of pip, and a group of dependencies, which pip knows since 25.1.
$(VENV)/.installed-all: pyproject.toml | $(VENV)/.created $(VENV)/.installed-torch
	$(PIP) --upgrade pip
	$(PIP) --editable ".[test,rl,docs]" --group trainers
	touch $(VENV)/.installed $(VENV)/.installed-test $(VENV)/.installed-docs $@
