# Everything happens in .venv; nothing is installed elsewhere except OpenGL libraries, for pictures.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: demo test test-slow lint bench clean

demo: $(VENV)/.viz
	$(BIN)/casashell demo --out demo-out --force

test: $(VENV)/.dev
	$(BIN)/python -m pytest -n 2 -q

test-slow: $(VENV)/.dev
	$(BIN)/python -m pytest -n 2 -q -m slow

lint: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(VENV)/.dev
	$(BIN)/python -m benchmarks

$(VENV)/bin/python:
	$(PYTHON) -c 'import sys; sys.exit("casashell needs Python 3.11 or newer: make PYTHON=python3.11" if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv $(VENV)

$(VENV)/.viz: $(VENV)/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --editable '.[viz]'
	sh .ci/opengl
	touch $@

$(VENV)/.dev: $(VENV)/bin/python pyproject.toml
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	sh .ci/opengl
	touch $@

clean:
	rm -rf $(VENV) demo-out
