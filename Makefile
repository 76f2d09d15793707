# `make help` says what there is. `make demo` runs the main job, `make test` every check. Both need only
# python3 (>= 3.10), make and a network.
# `make test EXTRAS=all` also installs every tool that the exports are tested in (about 4 GB, from PyPI and,
# where apt-get is there and may be used, from Debian); without it, tests of tools that are missing are skipped,
# unless P3DOF_REQUIRE=all is set: then a skipped test has failed.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
OUT ?= out
EXTRAS ?=
PIP := pip install --quiet --disable-pip-version-check
# To compile all of what is installed takes pip longer than to install it. The demo compiles what it imports; before tests,
# to which warnings are errors, all cores compile the rest, of which some is for other Pythons.
COMPILED := $(BIN)/python -m compileall -qq -j 0 $(VENV)/lib || true
# The seed of `make fuzz` and `make mutants`: a fresh one each time, unless one is given.
ifndef SEED
SEED := $(shell od -An -N4 -tu4 /dev/urandom | tr -d ' ')
endif
DEV := $(VENV)/.dev$(EXTRAS)
# What the extension is built from: a change builds it again.
SOURCES := setup.py MANIFEST.in $(wildcard p3dof/_native/*.[ch] p3dof/_native/generated/*.h p3dof/_base/*.h p3dof/_base/tracing/*.h p3dof/_base/integrators/*.h)
DEBIAN := cmake liburdfdom-tools libsdformat-dev pkg-config g++ clang libclang-rt-dev lld chromium chromium-headless-shell nodejs $(if $(shell command -v npm),,npm) \
	$(if $(filter x86_64,$(shell uname -m)),gcc-multilib) cppcheck \
	binutils-riscv64-linux-gnu libc6-dev-armhf-cross libc6-dev-riscv64-cross qemu-user
# What Clang links programs of other processors with; the newest. Debian's own gcc for them excludes gcc-multilib.
LIBGCC := for arch in armhf riscv64; do apt-cache pkgnames libgcc- | grep -E "^libgcc-[0-9]+-dev-$$arch-cross$$" | sort -V | tail -1; done
MODULES := page/node_modules/.package-lock.json

# Python keeps what it compiled, whatever the environment says: tests start hundreds of processes.
export PYTHONDONTWRITEBYTECODE :=

LOWEST := .venv-lowest
TOOLS := $(OUT)/tools
# The files of tests by their names, behind whichever door they are.
FILES = $(foreach name,$(1),$(or $(wildcard tests/*/test_$(name).py),$(error no test_$(name).py)))
COUNT ?= 300
GROUPS ?= 0
ONLY ?=

.PHONY: help demo quick pytest-quick test lint types layers generated pytest slow levels docs pdf fuzz sanitize mutants lowest export
.PHONY: release-check wheels-check sdist wheels conda sbom lock
.PHONY: pictures clean page page-check durations benchmark ratios benchmark-table benchmarks public-benchmark

demo: $(VENV)/.demo ## run the main job on the paper's motion, into out/
	$(BIN)/p3dof compare --out $(OUT)
	$(BIN)/p3dof show --out $(OUT)/machine.html

help: ## say what there is
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1\t\2/p' $(MAKEFILE_LIST) | expand -t 24
	@echo "Settings: PYTHON=python3.x  EXTRAS=all (every tool that reads the exports)  OUT=folder  SEED=number"

quick: $(DEV) ## lint, types, layers and the fast tests: about a minute
	@$(MAKE) --no-print-directory --jobs 2 --output-sync=target types lint layers pytest-quick

pytest-quick: $(DEV) ## the fast tests
	$(BIN)/pytest -n auto --quick

# What takes a process for itself beside each other, then what takes all of them.
test: $(DEV) ## run every check
	@$(MAKE) --no-print-directory --jobs 2 --output-sync=target lint layers types generated page-check
	@$(MAKE) --no-print-directory pytest

lint: $(DEV) ## ruff: style and form; codespell: British spelling
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/python tests/spelling.py

types: $(DEV) ## mypy
	$(BIN)/mypy

layers: $(DEV) ## import-linter: who may import whom
	$(BIN)/lint-imports

generated: $(DEV) ## are the committed generated files up to date?
	$(BIN)/p3dof export --check
	$(BIN)/p3dof codegen --kernels --check
	$(BIN)/p3dof codegen --page --check

page: $(MODULES) ## build the pages for the browser, p3dof/viewer/document/*.html, and THIRD-PARTY.md
	cd page && node build.mjs

# Types, the built page and the tests of its scripts; who only shows a page needs no Node.
page-check: $(DEV) ## is the page what page/ builds, and do its scripts pass their tests?
	@if command -v node >/dev/null && command -v npm >/dev/null; then \
		$(MAKE) --no-print-directory $(MODULES) && cd page && npm run --silent check; \
	else echo "page-check: SKIPPED, node or npm is not installed"; test "$(P3DOF_REQUIRE)" != all; fi

pytest: $(DEV) ## all tests
	$(BIN)/pytest -n auto --dist worksteal

# Of tests over about four seconds, the cases whose fact a quicker one also holds; what was measured to take over .6 s.
slow: $(DEV) ## the tests that `make test` leaves out, for they take long, and the notebooks
	$(BIN)/pytest -n auto --dist worksteal -m 'slow or long' tests
	$(BIN)/pytest -n auto notebooks

durations: $(DEV) ## all tests, and measure anew which ones are quick
	$(BIN)/pytest -n auto --dist worksteal --measure -m 'not fuzz and not slow'

# What takes the level of the processor and is quick, at each lower level: `make test` has the best one. BLAS is then that
# of processors which end there. Tests with the level as a parameter have them all already.
LEVELLED := actuators control equal_steps_in_c evidence following kernels lanes load_friction many_runs many_runs_friction \
	manipulator methods outputs run_notes run_sweeps runs_in_c sampling simulation sweeps wrenches
levels: $(DEV) ## compiled kernels as on processors without AVX-512, and without AVX2
	@for level in $$($(BIN)/python -c "from p3dof.closed_form.compiled import levels; print(*levels()[1:-1])"); do \
		case $$level in baseline) core=Prescott;; *) core=Haswell;; esac; \
		echo "P3DOF_LEVEL=$$level OPENBLAS_CORETYPE=$$core"; \
		P3DOF_LEVEL=$$level OPENBLAS_CORETYPE=$$core $(BIN)/pytest -q -n auto --quick --budget 800 \
			$(call FILES,$(LEVELLED)) || exit 1; done

docs: $(VENV)/.docs ## build the documentation site into out/docs, and check its links
	$(BIN)/python -m sphinx -W --keep-going -q -b html -d $(OUT)/doctrees docs $(OUT)/docs
	$(BIN)/pytest -q tests/built_docs.py --site $(OUT)/docs

pdf: $(VENV)/.docs ## print the whole documentation by Chromium, into out/docs/p3dof.pdf
	$(BIN)/python -m sphinx -W --keep-going -q -b singlehtml -d $(OUT)/doctrees docs $(OUT)/single
	$(BIN)/python docs/_ext/as_pdf.py $(OUT)/single $(OUT)/docs/p3dof.pdf

fuzz: $(DEV) ## random searches with a fresh seed, which SEED=... repeats
	@echo "repeat with: make fuzz SEED=$(SEED)"
	$(BIN)/pytest -n auto -m "fuzz or hypothesis" --hypothesis-profile=fuzz --hypothesis-seed=$(SEED) tests

sanitize: $(DEV) ## the compiled extension under the sanitizers of gcc
	$(BIN)/pytest -q -m "fuzz or not fuzz" -k sanitizers tests

# Breaks the sources on purpose, COUNT times (0: in every way), and lists what no test notices.
mutants: $(DEV) ## break the sources in COUNT places, and list what no test notices
	$(BIN)/python tests/mutants.py --count $(COUNT) --groups $(GROUPS) --seed $(SEED) --only "$(ONLY)"

# A quick part of the tests with the lowest versions that pyproject.toml declares. Their own deprecated calls of
# newer libraries beneath them are none of ours.
lowest: $(LOWEST)/.ready ## a quick part of the tests with the lowest versions declared
	$(LOWEST)/bin/pytest -n auto -m "not fuzz and not slow" -W ignore::DeprecationWarning \
		$(call FILES,checks parameters files motion kinematics manipulator closed_loop \
		description tracing plots cli cli_machine viewer_scene blocks blocks_cluster reductions \
		sampling_of_blocks)

# Whole calls as users make them, in calls of bare pin.rnea, beside the last release's: tests/benchmarks/table.json.
TABLE := OPENBLAS_NUM_THREADS=1 P3DOF_THREADS=1 $(BIN)/python tests/benchmarks/table.py
benchmark: $(DEV) ## one table of whole calls, beside that of the last release
	$(TABLE)

ratios: $(DEV) ## fail when a ratio of the table is 1.5 times that of the last release
	$(TABLE) --judge

benchmark-table: $(DEV) ## measure the table, and make it what others are compared with
	$(TABLE) --write

benchmarks: $(DEV) ## time all contenders, subject by subject, which takes long
	$(BIN)/python tests/benchmarks/kernels.py --out $(OUT)/benchmark
	$(BIN)/python tests/benchmarks/simulation.py
	OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/benchmarks/runs.py
	$(BIN)/python tests/benchmarks/sweeps.py
	$(BIN)/python tests/benchmarks/optimisation.py
	$(BIN)/python tests/benchmarks/page.py
	$(BIN)/python tests/benchmarks/live_page.py
	$(BIN)/python tests/benchmarks/designs.py
	$(BIN)/python tests/benchmarks/report.py
	OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/benchmarks/fastest.py
	OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/benchmarks/workspace.py
	OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/benchmarks/loops.py
	OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/benchmarks/robots.py
	$(BIN)/python tests/benchmarks/robots.py
	OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/benchmarks/robot_runs.py
	$(BIN)/python tests/benchmarks/real_time.py

# Forty robots in plain files, docs/benchmark: what each engine that is installed reaches, in files and on the page.
public-benchmark: $(DEV) ## hold every engine that is installed against the public benchmark
	$(BIN)/python docs/benchmark/run.py --write
	$(BIN)/python docs/benchmark/tables.py

# Of the Pythons that are there: the wheels that cibuildwheel makes for all systems, as pyproject.toml has it.
PYTHONS ?= $(foreach minor,10 11 12 13 14,$(shell python3.$(minor) -c 'import venv' 2>/dev/null && echo python3.$(minor)))
wheels-check: $(DEV) ## build what is published twice, and try each wheel in an empty environment: an hour
	$(BIN)/python tests/wheels.py --out $(OUT)/dist $(PYTHONS)
# A release: .github/workflows/release.yml makes these targets for a tag, and publishes what is in out/dist.
release-check: $(DEV) ## do version, changelog, citation and tag agree?
	$(BIN)/pytest -q tests/house/test_release.py

sdist: $(TOOLS)/.ready ## build the source distribution, and the wheel without the extension, into out/dist
	P3DOF_NO_EXTENSION=1 $(TOOLS)/bin/python -m build --outdir $(OUT)/dist .
	$(TOOLS)/bin/twine check --strict $(OUT)/dist/*

conda: $(TOOLS)/.ready ## have rattler-build read the recipe for conda-forge, and say what it asks for
	@$(TOOLS)/bin/python .github/conda/render.py

# For every Python and system of the processor at hand where cibuildwheel can (docker, or macOS), else for this Python.
wheels: $(TOOLS)/.ready ## build wheels into out/dist
	@if docker info >/dev/null 2>&1 || [ "$$(uname)" = Darwin ]; then \
		$(TOOLS)/bin/cibuildwheel --output-dir $(OUT)/dist; \
	else P3DOF_BUILD_LEVELS=all $(TOOLS)/bin/python -m pip wheel --quiet --no-deps --wheel-dir $(OUT)/dist .; fi
	$(TOOLS)/bin/twine check --strict $(OUT)/dist/*.whl

sbom: $(TOOLS)/.ready ## list what an installation consists of (CycloneDX), into out/sbom.json
	@$(PYTHON) -m venv --clear $(OUT)/installed
	@P3DOF_NO_EXTENSION=1 $(OUT)/installed/bin/python -m $(PIP) -c constraints.txt \
		'.[plot,report,viz]'
	$(TOOLS)/bin/cyclonedx-py environment --pyproject pyproject.toml --mc-type library --output-reproducible \
		--output-file $(OUT)/sbom.json $(OUT)/installed/bin/python

lock: $(TOOLS)/.ready ## lock the package and what it needs with hashes, into out/pylock.toml
	$(TOOLS)/bin/python -m pip lock --quiet --constraint constraints.txt --output pylock.toml '.[plot,report,viz]'
	mv pylock.toml $(OUT)/

export: $(DEV) ## write the files of urdf/ anew
	$(BIN)/p3dof export

pictures: $(DEV) ## draw the pictures of the README and of clearances anew
	$(BIN)/p3dof show --at 0.48 --screenshot pictures/machine.png
	$(BIN)/p3dof forces --figure pictures/forces.png
	$(BIN)/p3dof show --surroundings pictures/around.yaml --clearance "5 mm" --at 0.8666 --screenshot docs/_static/clearance.png

clean: ## remove what was installed, built and computed
	rm -rf $(VENV) $(LOWEST) $(OUT) page/node_modules build p3dof.egg-info p3dof/_native/_compiled*.so p3dof/_base/files/_numbers*.so
	rm -rf docs/reference/api docs/reference/generated docs/_static/animation.html docs/_static/stewart.html docs/contributing.md docs/tests.md
	rm -rf docs/_static/tutorial
	rm -f docs/tutorials/*.ipynb

$(MODULES): page/package.json page/package-lock.json
	cd page && npm ci --no-progress
	@touch $@

$(VENV)/pyvenv.cfg:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || \
		{ echo "p3dof needs Python 3.10 or newer; name one with: make PYTHON=python3.x"; exit 1; }
	@$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); \
		echo "$(PYTHON) cannot make a virtual environment; on Debian: apt-get install python3-venv"; exit 1; }

$(LOWEST)/.ready: $(DEV) tests/lowest.py
	@rm -rf $(LOWEST) && $(PYTHON) -m venv $(LOWEST)
	$(BIN)/python tests/lowest.py cluster plot report viz test > $(LOWEST)/lowest.txt
	P3DOF_BUILD_LEVELS=all $(LOWEST)/bin/python -m $(PIP) -r $(LOWEST)/lowest.txt -e .
	@touch $@

$(TOOLS)/.ready:
	@$(PYTHON) -m venv $(TOOLS)
	@$(TOOLS)/bin/python -m $(PIP) --upgrade 'pip>=25.1' build cibuildwheel cyclonedx-bom py-rattler-build twine
	@touch $@

$(VENV)/.demo: $(VENV)/pyvenv.cfg pyproject.toml constraints.txt $(SOURCES)
	$(BIN)/python -m $(PIP) --no-compile -c constraints.txt -e '.[plot,report,viz]'
	@touch $@

$(VENV)/.dev: $(VENV)/pyvenv.cfg pyproject.toml constraints.txt $(SOURCES)
	P3DOF_BUILD_LEVELS=all $(BIN)/python -m $(PIP) --no-compile -c constraints.txt -e '.[dev]'
	@$(COMPILED)
	@touch $@ $(VENV)/.demo

$(VENV)/.devall: $(VENV)/pyvenv.cfg pyproject.toml constraints.txt $(SOURCES)
	@if command -v apt-get >/dev/null && [ "$$(id -u)" = 0 ]; then \
		apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq $(DEBIAN) $$($(LIBGCC)) >/dev/null || \
		echo "Debian's packages could not be installed; their tests will be skipped: $(DEBIAN)"; fi
	P3DOF_BUILD_LEVELS=all $(BIN)/python -m $(PIP) --no-compile -c constraints.txt \
		-e '.[adapters,cluster,dev,interop]'
	@$(COMPILED)
	@touch $@ $(VENV)/.dev $(VENV)/.demo

$(VENV)/.docs: $(DEV)
	@$(BIN)/python -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "the documentation needs Python 3.11 or newer; make clean, then: make docs PYTHON=python3.x"; exit 1; }
	P3DOF_BUILD_LEVELS=all $(BIN)/python -m $(PIP) --no-compile -c constraints.txt -e '.[docs]'
	@$(COMPILED)
	@touch $@
