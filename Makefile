# `make demo` runs the main job, `make test` every check. Both need only python3 (>= 3.10), make and a network.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
OUT ?= out

.PHONY: demo test lint types layers generated pytest fuzz benchmark urdf clean

demo: $(VENV)/.demo
	$(BIN)/p3dof compare --out $(OUT)

test: lint types layers generated pytest

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.dev
	$(BIN)/mypy

layers: $(VENV)/.dev
	$(BIN)/lint-imports

generated: $(VENV)/.dev
	$(BIN)/p3dof urdf --check

pytest: $(VENV)/.dev
	$(BIN)/pytest -n auto

fuzz: $(VENV)/.dev
	$(BIN)/pytest -m fuzz

benchmark: $(VENV)/.dev
	$(BIN)/python tests/benchmarks/inverse_dynamics.py

urdf: $(VENV)/.dev
	$(BIN)/p3dof urdf

clean:
	rm -rf $(VENV) $(OUT)

$(VENV)/pyvenv.cfg:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || \
		{ echo "p3dof needs Python 3.10 or newer; name one with: make PYTHON=python3.x"; exit 1; }
	@$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); \
		echo "$(PYTHON) cannot make a virtual environment; on Debian: apt-get install python3-venv"; exit 1; }

$(VENV)/.demo: $(VENV)/pyvenv.cfg pyproject.toml constraints.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[plot]'
	@touch $@

$(VENV)/.dev: $(VENV)/pyvenv.cfg pyproject.toml constraints.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $@ $(VENV)/.demo
