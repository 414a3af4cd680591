# Shortcuts for developers; every target runs in the active virtual environment.
.PHONY: check test bench docs gallery

check:            ## lint and types
	ruff format --check .
	ruff check .
	mypy

test:             ## the whole suite
	python -m pytest

bench:            ## speed and memory, see benchmarks/README.md
	python -m benchmarks

gallery:          ## make the pictures of docs/gallery.md anew
	python -m pcsg gallery --render -o docs/pictures

docs:             ## rewrite the pages and golden files that are made from the code
	python -m pytest --update -q
