# Set-up and the main jobs. `make help` lists them.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.up-to-date

.PHONY: help bench test lint c-floor slowdown clean

help:
	@echo "make bench    set up, then compare every path on our ten models (about 3 minutes)"
	@echo "make test     set up, then lint, check types and run the tests"
	@echo "make c-floor  set up, then compare the paths with a C loop (needs a C compiler)"
	@echo "make slowdown set up, then see that asv finds a release slowed on purpose (8 minutes)"
	@echo "make clean    remove the virtual environment and caches"

bench: $(STAMP)
	$(BIN)/mjbench compare --paths usual

test: lint
	$(BIN)/python -m pytest -n 2 --dist worksteal

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/lint-imports
	$(BIN)/mypy

c-floor: $(STAMP)
	$(BIN)/python -m benchmarks.c_floor

slowdown: $(STAMP)
	$(BIN)/python -m benchmarks.slowdown

# Made anew when what it is made from changes, or when a half-made one was left behind.
$(STAMP): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "mjbench needs Python 3.11 or newer; name one: make PYTHON=python3.12"; exit 2; }
	$(PYTHON) -m venv --clear $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[dev]"
	@touch $@

clean:
	rm -rf $(VENV) .pytest_cache .mypy_cache .ruff_cache
