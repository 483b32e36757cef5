# Two commands: `make run` opens the window (in the terminal where there is no screen), `make test` runs the tests.
# Both set themselves up.
PYTHON ?= python3
VENV := .venv
# Without compiled files every process of a test would compile its modules again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: run test rehearse exhaustive check docs benchmarks coverage mutants audit study fuzz figures sbom fonts pictures clean

run: $(VENV)/installed
	$(VENV)/bin/calstation

test: $(VENV)/installed-dev
	tests=$$($(VENV)/bin/python tests/without_window.py) && $(VENV)/bin/python tests/compiled.py $$tests && \
		$(VENV)/bin/python -m pytest -n 4 --dist worksteal $$tests

rehearse: $(VENV)/installed-dev
	$(VENV)/bin/python -m pytest -m "long and not exhaustive" -n 6 --dist worksteal

exhaustive: $(VENV)/installed-dev
	$(VENV)/bin/python -m pytest -m "exhaustive or hypothesis" --hypothesis-profile=exhaustive -n 4 --dist worksteal

check: $(VENV)/installed-dev
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/mypy
	$(VENV)/bin/lint-imports

docs: $(VENV)/installed-dev
	NO_MKDOCS_2_WARNING=1 $(VENV)/bin/mkdocs build --quiet

benchmarks: $(VENV)/installed-dev
	$(VENV)/bin/python -m pytest tests/benchmarks --benchmark-enable --benchmark-only

# Without the window, and without the scheduler of the interleavings, which replaces the tracer. A test that is too slow
# while it is measured does not matter here.
coverage: $(VENV)/installed-dev
	rm -rf build/coverage && mkdir -p build/coverage
	-$(VENV)/bin/python -m coverage run -m pytest -m "not exhaustive" -n 2 --dist worksteal \
		--ignore=tests/gui --ignore=tests/interleaving tests
	$(VENV)/bin/python -m coverage combine --quiet
	$(VENV)/bin/python -m coverage json --quiet -o build/coverage/report.json
	$(VENV)/bin/python tests/branches.py build/coverage/report.json

# Changes of guard, register transfer and judge that the tests must notice.
mutants: $(VENV)/installed-dev
	$(VENV)/bin/python -m tests.mutation

# Known vulnerabilities of the packages; ADVISORIES=FOLDER compares with a copy of PyPA's advisory database.
audit: $(VENV)/installed-dev
	$(if $(ADVISORIES),,$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check "pip-audit~=2.10.1")
	$(VENV)/bin/python tests/audit.py $(ADVISORIES)

study: $(VENV)/installed
	$(VENV)/bin/calstation study

fuzz: $(VENV)/installed-dev
	mkdir -p .fuzz && cd .fuzz && mkdir -p corpus && ../$(VENV)/bin/python ../tests/fuzz/harness.py -max_total_time=600 corpus

figures:
	$(PYTHON) tests/figures.py $(SINCE)

# The software bill of materials of a release, with the hashes of its files in dist/.
sbom: $(VENV)/installed
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --editable ".[fleet,signing]" packaging
	$(VENV)/bin/python tests/make_sbom.py build/sbom.json $(wildcard dist/*)

# The font of window and documents, from Debian packages that apt-get downloads.
fonts: $(VENV)/installed-dev
	$(VENV)/bin/python tests/make_fonts.py

# The reference logs of `calstation validate` and their answers, after a change of the estimation.
references: $(VENV)/installed-dev
	$(VENV)/bin/python -m tests.make_references

# The pictures of the window in the documentation, from runs on the virtual bench.
pictures: $(VENV)/installed-dev
	$(VENV)/bin/python -m tests.gui.make_pictures

$(VENV)/installed: pyproject.toml
	$(PYTHON) -c "import sys; sys.exit('calstation needs Python 3.11 or newer: make PYTHON=python3.11 ...' if sys.version_info < (3, 11) else 0)"
	@echo "setting up $(VENV) (once, some minutes)"
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --editable .
	touch $@

$(VENV)/installed-dev: $(VENV)/installed
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check --editable ".[dev]"
	touch $@

clean:
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache .hypothesis .fuzz .import_linter_cache
