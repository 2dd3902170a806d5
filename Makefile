# Set-up and the main jobs. `make help` lists them.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# When the environment was made, when what measures was installed, and when what tests, too, was.
EMPTY := $(VENV)/.made
BASE := $(VENV)/.measures
STAMP := $(VENV)/.up-to-date
# Python compiles what is imported, on all cores; pip would compile everything, on one.
INSTALL := $(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check \
  -c constraints.txt

UPGRADE := build/upgrade
SITE := build/site
MODELS := $(basename $(notdir $(wildcard models/*.xml)))
LAB := build/lab/mujoco-lab.html
LAB_PACKAGE := build/lab/node_modules

# Tests start a thousand processes, each of which would compile what it imports again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help bench test tests lint style types types-darwin pages upgrade site lab c-floor docs-commands slowdown soak fuzz verdicts verdict-simulation foreign gpu clean

help:
	@echo "make bench     compare the C paths on the ten shipped models (4 minutes)"
	@echo "make test      run lint (see below) and the tests (7 minutes on two cores)"
	@echo "make site      write all reports and the documents as a static site to $(SITE)"
	@echo "make lab       write a page in which MuJoCo runs in a browser to $(LAB) (needs npm)"
	@echo "make upgrade   compare the newest MuJoCo with the one before it; report in $(UPGRADE) (5 minutes or more)"
	@echo "make lint      check style, spelling, the layers of imports, types and pages"
	@echo "make c-floor   compare the paths with a C program (needs a C compiler)"
	@echo "make docs-commands  run every command of README and guides in a fresh clone (two hours)"
	@echo "make slowdown  check that asv finds a release that is slowed on purpose (20 minutes or more)"
	@echo "make soak      check that 1,000 comparisons in one process use up nothing (half an hour to two hours)"
	@echo "make fuzz      check that 2,000 command lines of bad input end well (20 minutes)"
	@echo "make verdicts  count wrong verdicts where the truth is known, on this machine (20 minutes or more)"
	@echo "make verdict-simulation  count wrong verdicts on simulated launches (3 minutes)"
	@echo "make foreign   compare the C paths on the models of 13 packages, downloaded (half an hour)"
	@echo "make gpu       measure MJX and Warp on this machine's NVIDIA GPU (an hour or more)"
	@echo "make clean     remove the virtual environment and caches"
	@echo "All but clean set up .venv first, if it is missing or out of date."

bench: $(BASE)
	$(BIN)/mjbench compare $(MODELS) --budget 230s

# Style and types beside each other; then the tests, in three processes, since some wait. CI checks the types of macOS, too.
test: $(STAMP)
	$(MAKE) --jobs style types
	$(MAKE) tests

tests: $(STAMP)
	$(BIN)/python -m pytest -n 3 --dist worksteal

lint: style types types-darwin pages

style: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/codespell
	$(BIN)/lint-imports

# Links, blocks of code, commands and figures of the pages; `tests` has these, too.
pages: $(STAMP)
	$(BIN)/python -m pytest tests/test_docs.py tests/test_page_figures.py

types: $(STAMP)
	$(BIN)/mypy

types-darwin: $(STAMP)
	$(BIN)/mypy --platform darwin --cache-dir .mypy_cache/darwin

# By time and by instructions; it fails where a model is slower, after it has written its report.
upgrade: $(STAMP)
	rm -rf $(UPGRADE) && mkdir -p $(UPGRADE)
	status=0; \
	$(BIN)/mjbench versions previous newest $(MODELS) --results $(UPGRADE) --fail-on slower --allow-inconclusive \
	  || status=$$?; \
	$(BIN)/mjbench versions previous newest $(MODELS) --results $(UPGRADE) --metric instructions --min-effect 0.5% \
	  || status=$$?; \
	$(BIN)/mjbench show $(UPGRADE)/*.jsonl --html $(UPGRADE)/report.html \
	  --markdown $(UPGRADE)/report.md || status=$$?; \
	exit $$status

site: $(STAMP)
	$(BIN)/python docs/site.py -o $(SITE)

lab: $(STAMP) $(LAB_PACKAGE)
	$(BIN)/python -m benchmarks.studies.lab -o $(LAB)

# MuJoCo's WebAssembly build.
$(LAB_PACKAGE): docs/lab/package.json
	mkdir -p build/lab && cp $< build/lab
	npm install --no-package-lock --no-audit --no-fund --silent --prefix build/lab
	@touch $@

c-floor: $(STAMP)
	$(BIN)/python -m benchmarks.studies.c_floor

docs-commands: $(STAMP)
	$(BIN)/python -m benchmarks.studies.page_commands

slowdown: $(STAMP)
	$(BIN)/python -m benchmarks.studies.slowdown

soak: $(STAMP)
	$(BIN)/python -m benchmarks.studies.soak

fuzz: $(STAMP)
	$(BIN)/python -m benchmarks.studies.fuzz

verdicts: $(STAMP)
	$(BIN)/python -m benchmarks.verdicts

verdict-simulation: $(STAMP)
	$(BIN)/python -m benchmarks.studies.verdict_simulation

gpu: $(STAMP)
	$(BIN)/python -m benchmarks.studies.gpu

foreign: $(STAMP)
	$(BIN)/python -m benchmarks.studies.foreign

# Rebuilt when its inputs change, or when an earlier set-up did not finish.
$(EMPTY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "mjbench needs Python 3.11 or newer; name one: make PYTHON=python3.12"; exit 2; }
	$(PYTHON) -m venv --clear $(VENV)
	@touch $@

$(BASE): $(EMPTY)
	$(INSTALL) -e .
	@touch $@

# After $(BASE), so that `make -j` never runs two pips in one environment.
$(STAMP): $(BASE)
	$(INSTALL) -e ".[dev]"
	@touch $@

clean:
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache
