# Two commands: `make demo` runs the main job on the embedded scene, `make test` passes the tests.
# Both make .venv and install everything first. `make check` is the quick one while working.

PYTHON ?= python3
BIN := .venv/bin
SPLATCORE := $(BIN)/splatcore
PYTEST := OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile
SIZE ?= 640x360

.DEFAULT_GOAL := help
.PHONY: help install demo pictures test test-compress verify check clean

help:
	@echo "make demo   install, then simulate a frame of the embedded scene: pictures in out/"
	@echo "make test   install, then run every test"
	@echo "make test-compress   install PyTorch as well, then run the tests of compression"
	@echo "make verify what takes minutes of compiling or synthesis each, at full size"
	@echo "make check  lint, the rules of the house and the quick tests: 90 seconds"
	@echo "make pictures   the pictures in docs/, from those of the demo"
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

pictures: demo
	cp out/rtl.png docs/pictures/garden.png
	cp out/tiles.png docs/pictures/garden-tiles.png

test: install demo
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(PYTEST) -m "not verify"

test-compress: .venv/compress
	$(PYTEST) -m compress

verify: install
	$(PYTEST) -m verify

.venv/compress: pyproject.toml .venv/installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[test,compress]'
	@touch $@

check: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(PYTEST) -m "not slow and not scenes and not verify"

clean:
	rm -rf .venv out build *.egg-info docs/registers.md docs/splatcore.h
