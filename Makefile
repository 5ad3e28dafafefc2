# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
#
# Every target sets up what it needs first; that costs nothing where it is there already.
# PYTHON=/path/to/python3.12 names the interpreter to build on (3.10 to 3.13).
# RPO_ROS_PREFIX=/path names the ROS 2 Jazzy to use; empty, the wheels.

SHELL := bash
.DEFAULT_GOAL := help

ANY_PYTHON := $(or $(firstword $(shell command -v python3 python3.12 python3.13 python3.11 python3.10)),$(PYTHON))
SETUP = @$(if $(ANY_PYTHON),,echo 'Python 3.10 to 3.13 is needed, and there is no python3 on the PATH: install it first.' >&2; exit 1;) \
	$(ANY_PYTHON) ros_ws/underlay/bootstrap.py $(if $(PYTHON),--python '$(PYTHON)')
# One shell line of its own: the environment that `source ros_ws/env.bash` gives an interactive shell.
# A node starts three times faster from compiled bytecode: whoever forbids that means other folders.
ENV = @unset PYTHONDONTWRITEBYTECODE; source ros_ws/env.bash &&
SOURCES = ros_ws offline_training tests docs

.PHONY: help setup demo docs test tests test-slow bench compile wheels notebooks lint format lock address clean

help:  ## this list
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## */\t/' | sort | expand -t 12

setup:  ## virtual environment, ROS 2 (an installed Jazzy, or its wheels), colcon build; LAYERS='train report' adds more
	$(SETUP) $(LAYERS)

demo:  ## fly the paper's test on ROS 2; log, report and replay go to runs/demo/
	$(SETUP) report
	$(ENV) ros2 run rpo_bringup final_approach --scenario paper_test --output runs/demo --overwrite && \
		rpo report runs/demo >/dev/null
	@echo 'runs/demo/report/replay.html: the flight in three dimensions; open it in a browser'
	@echo 'Of nodes that you start by hand, plant and recorder end with the flight; the others wait for the next flight.'
	@echo 'next: source ros_ws/env.bash && rpo explain runs/demo --at 40; then docs/tutorial.md'

# More workers than cores: tests of nodes wait, for time-outs and for real time.
test:  ## style, types and all quick tests (ARGS='-k plant' is passed to pytest)
	$(SETUP) lint test
	@$(MAKE) --no-print-directory -j 2 lint tests

# Beside `lint`, and without what `make` tells the commands that it starts side by side. In a new
# checkout one process compiles the bytecode that else each worker would compile.
tests:
	$(ENV) unset MAKEFLAGS MAKELEVEL && { [ -e .pytest_cache ] || pytest -q --collect-only >/dev/null || true; } && \
		pytest -n $(or $(WORKERS),3) --dist worksteal $(ARGS)

test-slow:  ## the tests that `make test` leaves to `.ci/run`
	$(SETUP) test
	$(ENV) pytest -m 'slow or every_landing' $(ARGS)

bench:  ## targets P1 to P6: speed beside a peer of the same run, in one table (some minutes; ARGS='--write docs/benchmarks.md')
	$(SETUP) test train gym
	$(ENV) rpo bench $(ARGS)

docs:  ## the documentation site, into site/ (SERVE=1 shows it in a browser, and follows edits)
	$(SETUP) docs
	$(ENV) NO_MKDOCS_2_WARNING=1 mkdocs $(if $(SERVE),serve,build --quiet) --strict
	@echo '$(CURDIR)/site/index.html: open it in a browser; its search needs a server: make docs SERVE=1'

compile:  ## compile the numerical kernels now, not at their first use
	$(SETUP) train
	$(ENV) python -m rpo.cli.precompile

wheels:  ## the wheels rpo_core, rpo_log and rpo, which fly, judge and train without ROS, into dist/
	$(SETUP)
	@rm -rf dist
	$(ENV) for folder in ros_ws/src/rpo_core ros_ws/src/rpo_log offline_training; do \
		uv build -q --no-build-isolation --python .venv/bin/python -o dist $$folder || exit; done; rm -rf ros_ws/src/*/*.egg-info; ls dist/*.whl

notebooks:  ## run docs/notebooks, and store what the cells print and draw
	$(SETUP) train report
	$(ENV) VIRTUAL_ENV=$(CURDIR)/.venv uv run -q --no-project --active --with nbconvert --with ipykernel jupyter nbconvert \
		--to notebook --execute --inplace --ExecutePreprocessor.record_timing=False docs/notebooks/*.ipynb

lint:  ## ruff and mypy, which reads the libraries that the code uses
	$(SETUP) lint test
	$(ENV) ruff check --quiet && ruff format --check --quiet && mypy

format:  ## let ruff put the sources in order
	$(SETUP) lint
	$(ENV) ruff check --fix && ruff format

lock:  ## choose dependency versions anew where they must change (UPGRADE=1: everywhere)
	$(SETUP)
	$(ENV) python ros_ws/underlay/lock.py $(if $(UPGRADE),--upgrade)

address:  ## write the project's own URL=https://… and EMAIL=… into every file that has them
	@[ -n '$(URL)' ] && [ -n '$(EMAIL)' ] || { echo 'make address URL=https://… EMAIL=…' >&2; exit 2; }
	@url=$$(sed -n 's/^repository-code: //p' CITATION.cff); email=$$(sed -n 's/^ *email: //p' CITATION.cff); \
		git grep -lF -e "$$url" -e "$$email" | xargs sed -i "s|$$url|$(URL)|g; s|$$email|$(EMAIL)|g"

clean:  ## remove all that set-up and tests made; runs/ stays
	rm -rf .venv site dist ros_ws/build ros_ws/install ros_ws/log ros_ws/.setup.lock offline_training/*.egg-info \
		.pytest_cache .mypy_cache .ruff_cache .hypothesis
	find $(SOURCES) -name __pycache__ -type d -prune -exec rm -rf {} +
