# `make run` and `make test` need python3 (3.10 or later) and make, nothing else.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed

# Where Python is told to write no bytecode, every program that the tests start would compile all of it first.
export PYTHONDONTWRITEBYTECODE :=

# One more than there are cores: many tests wait for other programs.
WORKERS ?= $(shell $(PYTHON) -c 'import os; print((os.cpu_count() or 1) + 1)')

.DEFAULT_GOAL := help
.PHONY: help run test test-browser test-guest test-oak test-alerts images evaluate evaluate-full accuracy classic bench clean methods fleet

help:  ## what can be made
	@awk -F':.*## ' '/^[a-z-]+:.*## /{printf "make %-13s %s\n", $$1, $$2}' Makefile

$(INSTALLED): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' || { echo "syncwatch needs Python 3.10 or later: make PYTHON=python3.11 run" >&2; exit 2; }
	@echo "Setting up .venv (a few packages, about a minute) ..." >&2
	@$(PYTHON) -m venv $(VENV)
	@PIP_CONSTRAINT=constraints.txt PIP_BUILD_CONSTRAINT=constraints.txt $(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@

run: $(INSTALLED)  ## watch a rendered rig go out of sync and back
	@$(BIN)/syncwatch run

test: $(INSTALLED)  ## everything CI runs: style, types, tests
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/pytest -n $(WORKERS) --dist loadfile

test-browser: $(INSTALLED)  ## the dashboard and the reports in a headless browser (installs chromium; as root)
	@tests/browser/setup.sh
	$(BIN)/pytest tests/browser

images: $(INSTALLED)  ## renew the screenshots of the documentation
	SYNCWATCH_IMAGES=docs/images $(BIN)/pytest tests/browser/test_dashboard.py -k "field or hundreds"

test-alerts: $(INSTALLED)  ## the alert rules, by promtool (out of Debian's package prometheus)
	tests/promtool.sh

test-oak: $(INSTALLED)  ## the tests that need depthai, which is installed first (366 MB); no OAK is needed
	@PIP_CONSTRAINT=constraints.txt $(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[oak]'
	$(BIN)/pytest tests/sources/oak tests/syncwatch/test_oak_tap.py

test-guest: $(INSTALLED)  ## tests with the cameras of a real kernel in an emulated machine (Debian; root the first time)
	tests/guest/run.sh

accuracy: $(INSTALLED)  ## measure the content offset against its goals, into docs/accuracy.md (a quarter of an hour)
	$(BIN)/python -m benchmarks.accuracy

evaluate: $(INSTALLED)  ## every failure seen in the field, injected and judged, into build/evaluation (a few minutes)
	$(BIN)/syncwatch evaluate examples/suite.yaml --report build/evaluation

evaluate-full: $(INSTALLED)  ## the same with ten seeds, and two rendered hours with nothing wrong (an hour)
	$(BIN)/syncwatch evaluate examples/suite.yaml --set seeds=[0,1,2,3,4,5,6,7,8,9] --report build/evaluation-full
	$(BIN)/syncwatch evaluate examples/suite-hours.yaml --report build/evaluation-hours

classic: $(INSTALLED)  ## score the report's detectors on the real recordings, into docs/classic-algorithm.md
	$(BIN)/python -m benchmarks.classic

methods: $(INSTALLED)  ## every method of the report beside the default, into docs/methods.md (a quarter of an hour)
	$(BIN)/python -m benchmarks.methods

fleet: $(INSTALLED)  ## 300 rigs through two routers to one monitor, measured into docs/fleet.md (a few minutes)
	$(BIN)/python -m benchmarks.fleet

bench: $(INSTALLED)  ## what the content offset, rendering and a stalled subscriber cost, as ratios
	$(BIN)/python -m benchmarks.cost
	$(BIN)/python benchmarks/render.py
	$(BIN)/python -m benchmarks.stalled

clean:  ## remove what make made
	rm -rf $(VENV) build dist *.egg-info
