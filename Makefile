# make demo | make test: all a bare machine needs is python3 (3.11 to 3.13) with venv, make and gcc.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

.PHONY: demo test lint unit config docs docs-check site validation validation-check mutants venv clean

demo: venv ## fly a whole mission and write the page
	$(BIN)/lowcostnav demo

test: lint unit ## everything that must hold before a commit

lint: venv
	$(BIN)/ruff check .
	$(BIN)/lint-imports
	$(BIN)/mypy

unit: venv
	$(BIN)/python -m pytest -q -n 2

config: venv ## write the parameter files from the settings that the code declares
	$(BIN)/python docs/make_config.py

docs: venv ## write docs/interfaces.md, the fields in docs/convert.md, the verdicts in README.md
	$(BIN)/python docs/make_interfaces.py
	$(BIN)/python docs/make_convert.py
	$(BIN)/python docs/make_verdicts.py

validation: venv ## the measured pages of docs anew: results of the theses, faults, recordings, Monte Carlo (hours)
	$(BIN)/python docs/make_validation.py

validation-check: venv ## the same elsewhere; fails where a line differs from docs
	$(BIN)/python docs/make_validation.py --check

site: venv ## the documentation as a site in out/site, to be read without a network; a link that leads nowhere fails it
	$(BIN)/python -m pip install --quiet --disable-pip-version-check "mkdocs-material>=9.5,<10"
	mkdir -p out/site_source && cp -r README.md CONTRIBUTING.md QUALITY_DECLARATION.md SECURITY.md CITATION.cff CHANGELOG.rst LICENSE docs config package.xml out/site_source/
	$(BIN)/mkdocs build --strict --quiet

docs-check: venv ## run every command of README and docs in its printed order (ten minutes)
	PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/python docs/commands.py

venv: $(STAMP)

# The stamp makes a second run free; it is redone when the pinned versions or the package metadata change.
$(STAMP): requirements.txt requirements-test.txt setup.py setup.cfg pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(0 if (3, 11) <= sys.version_info[:2] <= (3, 13) else "Python 3.11, 3.12 or 3.13 is needed: make PYTHON=python3.12")'
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV) || { echo "python3 -m venv failed: install python3-venv"; exit 1; }
	@echo "Installing the pinned packages into $(VENV), about a minute ..."
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements-test.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps -e . --config-settings editable_mode=compat
	@touch $@

mutants: venv ## break 200 formulas, one at a time: which of them do the unit tests not notice (half an hour)
	$(BIN)/python benchmarks/mutants.py

clean: ## remove what was built, keep the virtual environment
	rm -rf build install log dist out *.egg-info .pytest_cache .ruff_cache .mypy_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -not -path './$(VENV)/*' -prune -exec rm -rf {} +
