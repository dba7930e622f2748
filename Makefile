# Two commands do everything on a bare machine: `make demo` and `make test`.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export MKL_NUM_THREADS := 1
export QT_QPA_PLATFORM ?= offscreen

.PHONY: install system demo faults faults-ci test test-fast lint gui screenshots benchmark pictures clean

$(BIN)/acquire: pyproject.toml solver/pyproject.toml
	$(PYTHON) -c 'import sys; assert sys.version_info >= (3, 11), "skinrig needs Python 3.11 or newer"'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install -q --upgrade pip
	$(BIN)/python -m pip install -q -e '.[gui,test]' -e './solver[test]'
	@touch $@

install: $(BIN)/acquire

# Qt needs these even offscreen. Installed where we may (root with apt), named otherwise.
SYSTEM_LIBRARIES := libegl1 libgl1 libxkbcommon0 libdbus-1-3 fontconfig
system:
	@sh tools/system_libraries.sh $(SYSTEM_LIBRARIES)

demo: install
	$(BIN)/python examples/demo/run_demo.py -o out/demo

# The checks and both runs always happen, and any of them fails the whole. What is skipped or run again is named (-rsR), what is slow is
# listed. Tests judged by the clock share one worker, in which nothing else runs at the same time.
JOBS ?= 2
PYTEST := -m pytest -n $(JOBS) --durations=25 -rsR
test: install system
	status=0; \
	$(MAKE) --no-print-directory lint || status=1; \
	$(BIN)/python $(PYTEST) --dist loadgroup tests || status=1; \
	$(BIN)/python $(PYTEST) --dist loadfile solver/tests || status=1; \
	exit $$status

# A look while working: nothing that waits for the clock, nothing that computes for long.
test-fast: install system
	status=0; \
	$(BIN)/python $(PYTEST) --dist loadgroup -m "not slow and not real_time" tests || status=1; \
	$(BIN)/python $(PYTEST) --dist loadfile -m "not slow" solver/tests || status=1; \
	exit $$status

# Faults of every kind against simulated instruments (benchmarks/faults): all of it, or a tenth. What the result file holds already
# is not measured again: remove the file, or say AGAIN=--again.
FAULTS := -m benchmarks.faults --seed 1
faults: install
	$(BIN)/python $(FAULTS) --share 1 --jobs 4 $(AGAIN) -o benchmarks/results/faults.json --docs docs/faults.md

faults-ci: install
	$(BIN)/python $(FAULTS) --share 0.1 --jobs 4

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	cd solver && $(abspath $(BIN))/mypy src
	$(BIN)/lint-imports

# Every benchmark prints seconds and ratios; together they take long. One alone: .venv/bin/python benchmarks/kinematics.py
benchmark: install
	$(BIN)/python -m pip install -q -e './solver[bench]'
	set -e; for script in benchmarks/*.py; do echo "== $$script"; $(BIN)/python $$script; done
	set -e; cd solver; for script in benchmarks/bench_*.py; do echo "== $$script"; $(abspath $(BIN))/python $$script; done

# The README's pictures, from what the demo recorded.
pictures: demo
	$(BIN)/python tools/pictures.py out/demo docs/pictures

# A window on an X screen needs more of them than an offscreen one.
SCREEN_LIBRARIES := libxcb-cursor0 libxcb-icccm4 libxcb-image0 libxcb-keysyms1 libxcb-render-util0 libxcb-shape0 \
	libxcb-xinerama0 libxkbcommon-x11-0
gui: install system
	@sh tools/system_libraries.sh $(SCREEN_LIBRARIES)
	QT_QPA_PLATFORM= $(BIN)/acquire gui

screenshots: install system
	$(BIN)/python tools/screenshots.py -o docs/screenshots

clean:
	rm -rf $(VENV) out build dist
