# From a fresh clone: `make demo` shows what the program does, `make test` shows that it works here.
#
#   make install   .venv with the program in it: .venv/bin/fit-material
#   make demo      photographs of a gold ball by Mitsuba, the fit, a report: demo/report.html
#   make test      the tests
#   make test-llvm the tests that depend on LLVM, where this machine has one that fails, none, a wrong path
#   make test-arithmetic  the tests that fit, by torch's arithmetic of another processor
#   make slow      the tests that take minutes
#   make stress    properties of whole domains by many examples, and a hundred thousand damaged files; some fifteen minutes
#   make hard-cases  docs/hard-cases.md, from the table of hard cases, with Mitsuba beside it; two minutes
#   make check     style, types and the direction of imports, without running anything
#   make bench     accuracy and time, as docs/validation.md states them
#   make bench-recovery   n, k, F0 and alpha of many metals against the truth and the bound; hours at first
#   make accuracy  docs/accuracy.md and its plot, measured on this machine; half an hour
#   make docs      the documents in docs/ as HTML: docs/_build/index.html; warnings are errors
#   make fresh     `make demo` and `make test` on a Debian that has nothing installed; needs root; half an hour
#   make clean     remove everything that these have made
#
# Needed beforehand: Python 3.11 or newer. The system's libraries (tools/install_libraries.sh) are installed where that
# is allowed. Settings, each as in `make install PYTHON=/opt/python/bin/python3`:
#
#   PYTHON   the Python to make .venv from
#   AREA     a folder of tests, of test: make test AREA=light_tables
#   JOBS     fits at a time, of bench-recovery
#   REPEATS  runs of each rung, of accuracy
#   EXTENT   of test-llvm: all for all tests in these states and in the one that serves
#   EXAMPLES of each property, of stress
#   TORCH    what pip installs torch from; another build of it: TORCH="torch==2.13.0 --index-url ADDRESS"

TORCH = torch==2.13.0
JOBS = 1
EXAMPLES = 1000
EXTENT =
REPEATS = 1

bin = .venv/bin
installed = .venv/installed

.PHONY: help install demo test test-llvm test-arithmetic fresh slow stress hard-cases check bench bench-recovery accuracy docs clean

help:
	@sed -n '/^$$/q; s/^# \{0,1\}//p' Makefile

install: $(installed)

demo: $(installed)
	$(bin)/fit-material demo -o demo
	@echo 'Open $(CURDIR)/demo/report.html in a browser.'

folders = $(if $(AREA),$(or $(shell find tests -type d -name '$(AREA)'),$(error no folder of tests is named $(AREA))))

# Two files at a time, each with one thread: our tensors are small, and threads of two processes would only wait for
# each other. On two cores that others used as well, 990 tests took 210 s so, and 210 s one after another.
test: $(installed)
	OMP_NUM_THREADS=1 $(bin)/python -m pytest -n 2 --dist loadfile $(folders)

test-llvm: $(installed)
	bash tools/test_llvm.sh $(bin)/python $(EXTENT)

test-arithmetic: $(installed)
	ATEN_CPU_CAPABILITY=default OMP_NUM_THREADS=1 $(bin)/python -m pytest -q -n 2 -m 'fits and not slow'

fresh:
	bash tools/fresh.sh

slow: $(installed)
	$(bin)/python -m pip install -e '.[slow]'
	$(bin)/python -m pytest -m slow

stress: $(installed)
	HYPOTHESIS_PROFILE=long EXAMPLES=$(EXAMPLES) OMP_NUM_THREADS=1 $(bin)/python -m pytest -q -n 2 \
		tests/project/test_properties.py tests/fitter/pipeline/test_random_scenes.py
	OMP_NUM_THREADS=1 $(bin)/python -m tests.fuzz

hard-cases: $(installed)
	$(bin)/python -m tests.bench hard-cases

check: $(installed)
	$(bin)/ruff check .
	$(bin)/ruff format --check .
	$(bin)/pyright --threads 2 --pythonpath $(bin)/python
	$(bin)/python -m pytest -q tests/project/test_imports.py

bench: $(installed)
	$(bin)/python -m tests.bench

# Photographs and fits are kept in ~/.cache/fit-material: what was interrupted goes on where it was.
bench-recovery: $(installed)
	OMP_NUM_THREADS=1 $(bin)/python -m tests.bench --jobs $(JOBS) \
		recovery-grid recovery-noise recovery-spot recovery-coverage

# Runs are kept there, too; REPEATS=3 for more than one of each.
accuracy: $(installed)
	$(bin)/python -m tests.bench --repeats $(REPEATS) accuracy

docs: $(installed)
	$(bin)/python -m pip install -q -e '.[docs]'
	$(bin)/python -m sphinx -W --keep-going -b html docs docs/_build

clean:
	rm -rf .venv build demo bench docs/_build *.egg-info src/*.egg-info .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# torch first and alone: what follows then finds it there, and does not replace it by another build
$(installed): pyproject.toml tools/install_libraries.sh | $(bin)/python
	bash tools/install_libraries.sh needed $(bin)/python
	$(bin)/python -m pip install $(TORCH)
	$(bin)/python -m pip install -e '.[dev]'
	bash tools/install_libraries.sh useful $(bin)/python
	@touch $@

$(bin)/python:
	PYTHON='$(PYTHON)' bash tools/make_venv.sh .venv
