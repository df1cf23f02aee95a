# `make demo` renders the built-in scene, `make test` runs the tests. Both create .venv and install
# everything first. `make check` runs the quick tests, for use while working.

PYTHON ?= python3
BIN := .venv/bin
SPLATCORE := $(BIN)/splatcore
PYTEST := OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

.DEFAULT_GOAL := help
.PHONY: help install demo pictures commands test test-compress verify testbenches coverage check report keep results clean

help:
	@echo "make demo           install, then simulate one frame of the built-in scene; pictures in out/"
	@echo "make test           install, then run all tests except those of the next three commands"
	@echo "make test-compress  install PyTorch too, then run the tests of compression"
	@echo "make testbenches    run each stage under cocotb, in Verilator and, if installed, in Icarus"
	@echo "make verify         run the tests at full size: minutes of compiling or synthesis each"
	@echo "make coverage       run the tests of the whole machine; list conditions in hdl/ not covered"
	@echo "make check          run lint, the rules of the repository and the quick tests"
	@echo "make pictures       make the pictures in docs/, by the golden model and from docs/results"
	@echo "make commands       write docs/commands.md, docs/json.md and the rules of results"
	@echo "make report         make the page of results, of docs/results and newer results in out/"
	@echo "make results        measure the results missing in out/report/results (hours for all scenes)"
	@echo "make keep           write the results of out/report/results as tables into docs/results"
	@echo "make clean          remove all generated files"

install: .venv/installed

# --no-compile: only the modules that are imported are compiled, by the first import.
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile

.venv/installed: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
		|| { echo "Splatcore needs Python 3.11 or newer: make PYTHON=python3.12 …"; exit 1; }
	$(PYTHON) -m venv .venv
	$(PIP) --editable .
	@touch $@

.venv/test: pyproject.toml .venv/installed
	$(PIP) --editable '.[test]'
	@touch $@

demo: install
	@mkdir -p out
	$(SPLATCORE) scene garden -o out/garden.ply --cameras out/garden.json
	$(SPLATCORE) info out/garden.ply
	$(SPLATCORE) pack out/garden.ply -o out/garden.splatcore --camera out/garden.json
	$(SPLATCORE) render out/garden.splatcore --camera out/garden.json --size $(or $(SIZE),640x360) \
		-o out/reference.png --heat-map out/tiles.png
	$(SPLATCORE) simulate out/garden.splatcore --camera out/garden.json --size $(or $(SIZE),640x360) \
		-o out/rtl.png --error-map out/error.png --json out/rtl.json
	$(SPLATCORE) registers -o docs

pictures: install
	@mkdir -p out
	$(SPLATCORE) scene garden -o out/garden.ply --cameras out/garden.json
	$(SPLATCORE) pack out/garden.ply -o out/garden.splatcore --camera out/garden.json
	$(SPLATCORE) render out/garden.splatcore --camera out/garden.json --size 640x360 \
		-o out/reference.png --heat-map docs/pictures/garden-tiles.png
	$(SPLATCORE) render out/garden.splatcore --camera out/garden.json --size 640x360 \
		--engine golden -o docs/pictures/garden.png
	$(SPLATCORE) compare out/reference.png docs/pictures/garden.png -o docs/pictures/garden-error.png
	$(SPLATCORE) report -o out/pictures --section quality --pictures docs/pictures

commands: install
	$(BIN)/python -m splatcore.app.cli.reference > docs/commands.md
	$(BIN)/python -m splatcore.study.results.known > study/results/rules.mk
	$(BIN)/python -m splatcore.study.results.page docs/json.md

test: .venv/test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(PYTEST) -m "not verify and not long and not testbenches" $(if $(RECORD),--record-seconds)

test-compress: .venv/compress
	$(PYTEST) -m compress

# Prints one line per run of a stage, or one line for all of Icarus if it is not installed.
testbenches: .venv/test
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 -rPsfE --show-capture=stdout tb/stages

# Programs with counters are compiled separately and are several times slower, so long lists (20,000
# entries) and frames of DEFAULT are left out.
coverage: .venv/test
	rm -rf out/coverage && mkdir -p out/coverage
	SPLATCORE_COVERAGE=$(CURDIR)/out/coverage $(PYTEST) -m "not verify and not long" \
		$(or $(TESTS),tb/machine -k "not long_list and not test_machine_default")
	$(SPLATCORE) coverage out/coverage --json out/coverage.json

verify: .venv/test
	$(PYTEST) -m "verify or long"

.venv/compress: pyproject.toml .venv/test
	$(PIP) --editable '.[test,compress]'
	@touch $@

check: .venv/test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(PYTEST) --quick -m "not slow and not scenes and not verify and not long and not testbenches and not compress"

# `make report` uses results measured here and, for missing ones, those in docs/results.
# `make results` measures each result that is missing or older than its scene files; a file's name as
# target measures that result alone.
#   RESULTS=DIR        use only the results in that folder
#   SCENES="A B …"     files, names of files in the folder SPLATCORE_SCENES, generated scenes;
#                      default: all files in that folder, or the garden at 640x360 without it
#   SIZE=WxH           size of images
#   PRESET=NAME        machine, or the file of one
#   SCENE, CAMERA      the view of `power`
#   POINTS="A B …"     machines of the sweep
# Two results take hours and are not part of `make results`: fpga-whole.json and
# compression/compression.json. The latter needs `make .venv/compress` first and uses few steps;
# docs/compression.md has longer runs.
REPORT ?= out/report
only := $(addprefix --results ,$(RESULTS))
RESULTS ?= $(REPORT)/results
SPLATCORE_SCENES ?= ../shared/scenes
found := $(sort $(wildcard $(addprefix $(SPLATCORE_SCENES)/*,.ply .spz .splat .sog)))
ifeq ($(SCENES)$(found),)
SCENES := garden
SIZE ?= 640x360
endif
override SCENES := $(foreach scene,$(SCENES),$(firstword \
	$(wildcard $(scene) $(SPLATCORE_SCENES)/$(scene)) $(scene)))
SCENE ?= $(firstword $(SCENES) $(found))
CAMERA ?= $(firstword $(wildcard $(addsuffix .cameras.json,$(basename $(SCENE) $(basename $(SCENE))))))

size = $(addprefix --size ,$(SIZE))
preset = $(addprefix --preset ,$(PRESET))
few := --part steps,curve,power --ratios 15,20,30,40,60,80 --view-size 960x540 --steps 40
measure = mkdir -p $(@D) && $(SPLATCORE)

include study/results/rules.mk

report: install
	$(SPLATCORE) report -o $(REPORT) $(only)

keep: install
	$(SPLATCORE) report -o $(REPORT) --results $(RESULTS) --keep docs/results

results: $(addprefix $(RESULTS)/,$(campaigns) $(others))

$(addprefix $(RESULTS)/,$(campaigns) $(others)): | .venv/installed
$(addprefix $(RESULTS)/,$(campaigns)): $(wildcard $(SCENES))

clean:
	rm -rf .venv out build *.egg-info docs/registers.md docs/splatcore*
