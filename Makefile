# Two commands do everything on a fresh machine: `make cohort` and `make test`.

CORES ?= 2
export PATH := $(CURDIR)/.venv/bin:$(PATH)

.PHONY: help setup dev published cohort test test-all check docs gallery figures notebook benchmark wheel doctor format lock clean

help: ## show this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-10s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: ## install what is missing: system packages, .venv, compiled kernels
	@tools/setup.sh

dev: ## and what checks the code and makes the documentation
	@tools/setup.sh dev

published: ## and pygalmesh, the paper's tool, which is compiled once
	@tools/setup.sh published

cohort: setup ## run the workflow on a demo cohort, in about three minutes (CORES=2)
	@echo "six synthetic hemispheres, one of them folded to 30 weeks: four CPU minutes, about three minutes on two quiet cores"
	snakemake --cores $(CORES) --config fold='{end: 30}'

test: ## run the tests, in ten minutes (ARGS="-k quality" for some)
	@tools/setup.sh test
	pytest --numprocesses $(CORES) --dist loadfile --no-loadscope-reorder -m "not thorough" $(ARGS)
	@echo "left out, as they take minutes: $$(grep -rl 'mark.thorough' --include='test_*.py' tests | xargs -n 1 basename | xargs); make test-all runs them"

test-all: setup ## run every test, as CI does
	@tools/setup.sh test
	pytest --numprocesses $(CORES) --dist loadfile --no-loadscope-reorder $(ARGS)

check: dev ## what every commit must pass, in a minute
	tools/check.sh

docs: dev ## make the pages of the documentation in .cache/docs
	sphinx-build -q -W --keep-going -d .cache/doctrees docs .cache/docs

gallery: dev ## run the examples, and put their pictures into the documentation
	tools/gallery.sh

figures: setup ## make the other pictures of README and documentation anew, from the demo cohort
	@tools/setup.sh test
	python tools/figures.py

notebook: dev ## run the notebook of examples/, and store its outputs
	tools/notebook.sh

benchmark: dev ## what became slower than in COMMIT (the last one), in CPU seconds of one run
	python benchmarks/speed.py slower $(COMMIT)

wheel: ## build the package that `pip install` takes, in .cache/wheel; needs Python alone, and seconds
	python3 -m venv .cache/build
	.cache/build/bin/pip wheel --quiet --no-deps --wheel-dir .cache/wheel .
	@rm -rf build

doctor: setup ## prove that every dependency works
	cortet doctor

format: dev ## format and lint, mending what can be mended
	ruff format .
	ruff check --fix .
	snakefmt Snakefile rules studies/Snakefile

lock: setup ## pin the dependencies of pyproject.toml anew (UPGRADE=1: to the newest)
	UPGRADE=$(UPGRADE) tools/lock.sh

clean: ## delete caches; keeps .venv and everything the workflow made
	rm -rf .cache .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find cortet scripts tests -name __pycache__ -prune -exec rm -rf {} +
