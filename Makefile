# `make demo` and `make test` do all set-up themselves: a virtual environment in .venv with everything from PyPI.
# On a sourced ROS 2 machine the distribution's rclpy is used: the environment then sees the system's packages.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
ifeq ($(shell $(PYTHON) -c 'import rclpy' 2>/dev/null && echo $${ROS_DISTRO:-}),)
EXTRAS := ros,test
VENV_OPTIONS :=
else
EXTRAS := test
VENV_OPTIONS := --system-site-packages
endif

.PHONY: demo test lint slow benchmark clean

demo: $(VENV)/ready
	$(BIN)/python -m uw_acoustic_loc demo

test: lint
	$(BIN)/python -m pytest -n 2 -m "not slow"

slow: $(VENV)/ready
	$(BIN)/python -m pytest -n 2 -m slow

lint: $(VENV)/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

$(VENV)/ready: setup.py setup.cfg Makefile
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV_OPTIONS) $(VENV)
	$(BIN)/pip install --quiet --editable '.[$(EXTRAS)]'
	touch $@

benchmark:
	test -x $(VENV)/bench/bin/python || $(PYTHON) -m venv $(VENV_OPTIONS) $(VENV)/bench
	$(VENV)/bench/bin/pip install --quiet --requirement benchmarks/requirements.txt --editable '.[$(EXTRAS)]'
	missed=0; for script in benchmarks/bench_*.py; do $(VENV)/bench/bin/python $$script || missed=1; done; exit $$missed

clean:
	rm -rf $(VENV) build install log *.egg-info
