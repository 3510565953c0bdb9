# Everything runs in .venv, made on first use and re-made when pyproject.toml or
# constraints.txt change. Another interpreter: make test PYTHON=python3.12
PYTHON ?= python3
VENV := .venv
PY := $(VENV)/bin/python
PIP_INSTALL := $(PY) -m pip install --quiet --constraint constraints.txt

# pyright would otherwise ask on every run whether there is a newer one.
export PYRIGHT_PYTHON_IGNORE_WARNINGS := 1

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.NOTPARALLEL:
.PHONY: help demo test slow thorough lint benchmarks notebooks tables docs docs-check wheel \
	newest oldest fmu clean

help:
	@echo 'make demo        install hystjax and run its main job on a recording'
	@echo 'make test        lint, type checks and tests'
	@echo 'make slow        the slow tests'
	@echo 'make thorough    the longest tests, over many seeds and models'
	@echo 'make lint        ruff and pyright alone'
	@echo 'make benchmarks  time hystjax against PySINDy and SciPy'
	@echo 'make tables      put what benchmarks and studies wrote into the guides'
	@echo 'make docs        build the documentation site into site/'
	@echo 'make docs-check  open every page of the site in Chromium'
	@echo 'make wheel       build the wheel and try it in a bare environment'
	@echo 'make newest      the tests with the newest versions of everything'
	@echo 'make oldest      the tests with the oldest versions that pyproject.toml admits'
	@echo 'make fmu         run exported FMUs in an environment with FMPy alone'
	@echo 'make notebooks   re-make the notebooks from their .py sources'
	@echo 'make clean       remove the environment, caches and build products'

demo: $(VENV)/.run
	$(VENV)/bin/hystjax demo

# Most of the time of the tests goes into compiling what runs once or twice. These have
# XLA optimise nothing, take its older emitters for CPUs and one thread a program, which
# cost less. A file is one worker's, which compiles what its tests share once. The slow
# tests run as users do.
ONCE := --xla_backend_optimization_level=0 --xla_cpu_use_fusion_emitters=false \
	--xla_cpu_parallel_codegen_split_count=1

test: lint
	XLA_FLAGS="$(ONCE)" $(PY) -m pytest -n 2 --dist loadfile

# pytest exits with 5 when no test is marked slow.
slow: $(VENV)/.test
	$(PY) -m pytest -n 2 --dist loadfile -m "slow and not thorough" || [ $$? -eq 5 ]

thorough: $(VENV)/.test
	$(PY) -m pytest -n 2 --dist loadfile -m thorough

lint: $(VENV)/.test
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/pyright

benchmarks: $(VENV)/.test
	$(PY) -m benchmarks

notebooks: $(VENV)/.test
	$(PY) notebooks/build.py

tables: $(VENV)/.docs
	$(PY) docs/_tables.py

docs: $(VENV)/.docs
	$(PY) -m mkdocs build --strict

docs-check: docs
	$(PY) docs/_check.py

# From a folder without the sources, so that the wheel's are imported.
WHEEL := build/wheel
wheel:
	rm -rf $(WHEEL)
	$(PYTHON) -m venv $(WHEEL)/env
	$(WHEEL)/env/bin/python -m pip wheel --quiet --no-deps --wheel-dir $(WHEEL) .
	$(WHEEL)/env/bin/python -m pip install --quiet --constraint constraints.txt $(WHEEL)/*.whl
	cd $(WHEEL) && env/bin/python -m pip check && env/bin/hystjax demo

# As an installation without constraints finds them, the newest JAX most of all, which an
# older Python may not have: PYTHON names a new one.
NEWEST := build/newest
newest:
	$(PYTHON) -m venv --clear $(NEWEST)
	$(NEWEST)/bin/python -m pip install --quiet --editable '.[test]'
	$(NEWEST)/bin/python -m pytest -n 2 --dist loadfile

# The lower bounds of pyproject.toml hold, by the oldest Python, which PYTHON may have to
# name: of what hystjax needs, and then with the test tools, which may need newer ones.
# What old libraries say to their developers is hidden as from users.
OLDEST := build/oldest
UV_INSTALL := $(OLDEST)/bin/uv pip install --quiet --python $(OLDEST) --resolution lowest-direct
oldest:
	$(PYTHON) -m venv --clear $(OLDEST)
	$(OLDEST)/bin/python -m pip install --quiet uv
	$(UV_INSTALL) --editable .
	cd $(OLDEST) && bin/hystjax demo
	$(UV_INSTALL) --editable '.[test]'
	$(OLDEST)/bin/python -m pytest -n 2 --dist loadfile -W ignore::DeprecationWarning

# The tests write the units, and have an environment run them that lacks hystjax and JAX.
FMU := build/fmu
fmu: $(VENV)/.test
	$(PYTHON) -m venv --clear $(FMU)
	$(FMU)/bin/python -m pip install --quiet --constraint constraints.txt fmpy
	FMU_PYTHON=$(CURDIR)/$(FMU)/bin/python $(PY) -m pytest tests/test_export_fmu.py -m ''

$(VENV)/pyvenv.cfg: pyproject.toml constraints.txt
	@command -v $(PYTHON) >/dev/null || { echo "hystjax needs Python 3.11 or newer, and '$(PYTHON)' is not installed; name another with PYTHON=..." >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "hystjax needs Python 3.11 or newer, and '$(PYTHON)' is $$($(PYTHON) --version 2>&1); name another with PYTHON=..." >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { echo "'$(PYTHON)' lacks the venv module; install it (on Debian and Ubuntu: apt install python3-venv) or name another with PYTHON=..." >&2; exit 1; }
	$(PYTHON) -m venv --clear $(VENV)

$(VENV)/.run: $(VENV)/pyvenv.cfg
	$(PIP_INSTALL) --editable .
	@touch $@

$(VENV)/.test: $(VENV)/pyvenv.cfg
	$(PIP_INSTALL) --editable '.[test,dev,docs]'
	@touch $(VENV)/.run $@

$(VENV)/.docs: $(VENV)/pyvenv.cfg
	$(PIP_INSTALL) --editable '.[docs]'
	@touch $(VENV)/.run $@

clean:
	rm -rf $(VENV) build dist site .pytest_cache .ruff_cache .hypothesis
	find hystjax tests benchmarks notebooks -name __pycache__ -prune -exec rm -rf {} +
