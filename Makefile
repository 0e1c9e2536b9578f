# Two commands do everything: `make report` (the main job) and `make test`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
INSTALLED_DEV := $(VENV)/.installed-dev
INSTALLED_DOCS := $(VENV)/.installed-docs

.PHONY: bench-quick bench-compare report reports test pytest lint pins bench wheel docs notebooks clean

report: report-paper

test: $(INSTALLED_DEV)
	@$(MAKE) --no-print-directory --jobs=2 lint pytest

# Hundreds of tests start programs: each would compile the package's sources again where Python keeps no bytecode.
pytest: export PYTHONDONTWRITEBYTECODE =
pytest: $(INSTALLED_DEV)
	$(BIN)/python -m pytest -n 2 --dist worksteal

lint: $(INSTALLED_DEV)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache
	$(BIN)/python tests/house.py

# Everything under reports/ that git keeps, written again (an hour on two cores); `make reports R="paper tolerance-scope"` for some.
R ?= paper story-arthroscope story-borescope story-otoscope tolerance-paper tolerance-scope tolerance-singlet optimize-rigid-scope \
  optimize-ear-speculum optimize-real-lens optimize-custom-lens accuracy hard-cases paper-images paper-real-lens calibration-circle calibration-coverage depth \
  depth-proof depth-published depth-views instruments compare bench
REPORTS := $(addprefix report-,$(R))
reports: $(REPORTS)

# Static patterns: of what is phony, make looks for no implicit rule.
.PHONY: reports $(REPORTS)
report-paper: $(INSTALLED)
	$(BIN)/roslf report designs/paper.toml -o reports/paper --pdf --no-stamp --figure rays
$(filter report-story-%,$(REPORTS)): report-story-%: $(INSTALLED)
	$(BIN)/roslf report studies/story-$*/story.toml -o reports/story-$* --pdf --no-stamp
$(filter report-tolerance-%,$(REPORTS)): report-tolerance-%: $(INSTALLED)
	rm -rf reports/tolerance-$*
	$(BIN)/roslf tolerance studies/tolerance-$*/study.toml -o reports/tolerance-$*
$(filter report-optimize-%,$(REPORTS)): report-optimize-%: $(INSTALLED)
	$(BIN)/roslf optimize studies/optimize-$*/study.toml -o reports/optimize-$*
report-accuracy: $(INSTALLED)
	$(BIN)/roslf accuracy paper --jobs 108 -o reports/accuracy
report-hard-cases: $(INSTALLED)
	$(BIN)/roslf accuracy hard-cases paper -o reports/hard-cases
report-paper-images: $(INSTALLED)
	$(BIN)/python studies/paper-images/make.py
report-paper-real-lens: $(INSTALLED)
	$(BIN)/python studies/paper-real-lens/real_lens.py
report-calibration-circle: $(INSTALLED)
	$(BIN)/python studies/calibration-circle/full_circle.py
report-calibration-coverage: $(INSTALLED)
	$(BIN)/python studies/calibration-coverage/coverage_study.py
report-depth: $(INSTALLED)
	$(BIN)/python studies/depth/depth_study.py
report-depth-proof: $(INSTALLED)
	$(BIN)/python studies/depth/depth_proof.py
report-depth-published: $(INSTALLED)
	$(BIN)/python studies/depth/published.py
report-depth-views: $(INSTALLED)
	$(BIN)/python studies/depth/views_study.py
report-instruments: $(INSTALLED)
	$(BIN)/python studies/instruments/gallery.py
report-bench: $(INSTALLED)
	$(BIN)/python -m studies.bench.acceptance --builds 10 -o reports/bench
report-compare: $(INSTALLED)
	$(BIN)/python studies/compare/compare_study.py --install

# What the commands answer against what 0.1 answered; PINS is the folder of pins.py and pins.json.
PINS ?= ../shared/pins
pins: $(INSTALLED_DEV)
	$(BIN)/python $(PINS)/pins.py check $(BIN)/roslf $(PINS)/pins.json

bench: $(INSTALLED_DEV)
	$(BIN)/python -m benchmarks --readme

bench-quick: $(INSTALLED_DEV)
	$(BIN)/python -m benchmarks --quick

bench-compare: $(INSTALLED_DEV)
	@test -n "$(REV)" || { echo "Say with what to compare: make bench-compare REV=HEAD~10"; exit 2; }
	$(BIN)/python -m benchmarks --compare $(REV)

# What is published: sdist and wheel in dist/, the wheel installed elsewhere and tried.
wheel: $(INSTALLED_DEV)
	$(BIN)/python tests/wheel.py

# Where somebody watches, with what is being done; else only what is wrong.
docs: $(INSTALLED_DOCS)
	@test -t 1 || quiet=-q; $(BIN)/python -m sphinx $$quiet -W --keep-going -b html docs docs/_build
	@echo docs/_build/index.html

# The notebooks run again, with what they show stored in them.
notebooks: $(INSTALLED_DEV)
	$(BIN)/python docs/_ext/cells.py docs/notebooks/*.ipynb

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or newer is needed; say which with: make PYTHON=python3.12"; exit 1; }
	@$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); echo "Could not make $(VENV); on Debian: apt-get install python3-venv"; exit 1; }

$(INSTALLED): pyproject.toml constraints.txt | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[accuracy]'
	@touch $@

$(INSTALLED_DEV): pyproject.toml constraints.txt | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $@ $(INSTALLED)

$(INSTALLED_DOCS): pyproject.toml constraints.txt | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[docs]'
	@touch $@ $(INSTALLED)

clean:
	rm -rf $(VENV) out dist docs/_build docs/_generated docs/api .pytest_cache .mypy_cache .ruff_cache .hypothesis
