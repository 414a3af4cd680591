# Shortcuts for developers. All but `gallery` run in the active virtual environment.
.PHONY: check test fuzz kills compat bench docs gallery

check:            ## lint and types
	ruff format --check .
	ruff check .
	mypy

test:             ## the whole suite
	python -m pytest

fuzz:             ## made-up inputs of every kind, for hours; what fails is kept in fuzz-failures
	python -m tests.fuzz -n 100000 --seed $$(date +%s)

kills:            ## long commands killed at random moments, for an hour: what comes of them is the same
	python -m tests.fuzz.kills

compat:           ## the oldest and newest numba with every Python, in fresh environments
	python -m tests.compat

bench:            ## speed and memory, see benchmarks/README.md
	python -m benchmarks

docs:             ## rewrite the pages and golden files that are made from the code
	python -m pytest --update -q

# The pictures need nothing but a Python that is new enough: `make gallery PYTHON=python3.13`. What
# pcsg needs is installed into .venv. After a break, the same command goes on.
PYTHON ?= python3

gallery: .venv/ready  ## make the pictures of docs/gallery.md anew
	.venv/bin/python -m pcsg gallery --render -o docs/pictures

.venv/ready: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "pcsg needs Python 3.11 or later: make gallery PYTHON=python3.11"; exit 1; }
	@test -x .venv/bin/python || $(PYTHON) -m venv .venv || { \
	  echo "the module venv is missing (on Debian: apt install python3-venv)"; exit 1; }
	.venv/bin/python -m pip install -q -e . || { \
	  echo "pip could not install what pcsg needs; see above"; exit 1; }
	@touch .venv/ready
