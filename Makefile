# Two commands: `make demo` runs the main job on the embedded scene, `make test` passes the tests.
# Both make .venv and install everything first. `make check` is the quick one while working.

PYTHON ?= python3
BIN := .venv/bin
SPLATCORE := $(BIN)/splatcore
SIZE ?= 640x360

.DEFAULT_GOAL := help
.PHONY: help install demo test verify test-compress check clean

help:
	@echo "make demo   install, then simulate a frame of the embedded scene: pictures in out/"
	@echo "make test   install, then run all tests but those of make verify"
	@echo "make verify  the tests that take minutes each: synthesis and lint at full size"
	@echo "make test-compress   install PyTorch as well, then run the tests of compression"
	@echo "make check  lint, the import rule and the quick tests: two minutes"
	@echo "make clean  remove what the others made"

install: .venv/installed

.venv/installed: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
		|| { echo "Splatcore needs Python 3.11 or newer: make PYTHON=python3.12 …"; exit 1; }
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[test]'
	@touch $@

demo: install
	@mkdir -p out
	$(SPLATCORE) scene garden -o out/garden.ply --cameras out/garden.json
	$(SPLATCORE) info out/garden.ply
	$(SPLATCORE) pack out/garden.ply -o out/garden.splatcore --camera out/garden.json
	$(SPLATCORE) render out/garden.splatcore --camera out/garden.json --size $(SIZE) \
		-o out/reference.png --heat-map out/tiles.png
	$(SPLATCORE) render out/garden.splatcore --camera out/garden.json --size $(SIZE) \
		--engine rtl -o out/rtl.png --error-map out/error.png --json out/rtl.json
	$(SPLATCORE) registers -o docs

test: install demo
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile -m "not verify"  # a thread for each process

verify: install
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 -m verify

test-compress: .venv/compress
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile -m compress

.venv/compress: pyproject.toml .venv/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[test,compress]'
	@touch $@

check: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/python -m pytest -m "not slow and not scenes and not verify"

clean:
	rm -rf .venv out build *.egg-info docs/registers.md docs/splatcore.h
