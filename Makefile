# crowdsim: `make demo` runs the brawl of thirty boxers, `make test` the fast tests.
# PYTHON chooses the interpreter, VENV the environment that is created.

PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
SYSTEM_PACKAGES := libgl1 libegl1 libgomp1 libusb-1.0-0 libx11-6

.PHONY: demo test test-slow test-browser wheel bench docs-tables docs-pictures docs-reference lint system clean

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	touch $@

$(VENV)/.installed-test: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[test]'
	touch $@ $(VENV)/.installed

# The system libraries that Open3D loads; without them only PCD clouds are missing.
system:
	@missing=""; for p in $(SYSTEM_PACKAGES); do \
	  dpkg -s $$p >/dev/null 2>&1 || missing="$$missing $$p"; done; \
	if [ -z "$$missing" ]; then exit 0; fi; \
	if ! command -v apt-get >/dev/null; then echo "Open3D needs these libraries (Debian's names):$$missing"; exit 0; fi; \
	if [ "$$(id -u)" = 0 ]; then apt-get -qq update && apt-get -qq install -y --no-install-recommends $$missing >/dev/null \
	  || echo "Open3D needs system packages that could not be installed:$$missing"; \
	else echo "Open3D needs system packages: sudo apt-get install$$missing"; fi

# The first run trains the embedded boxer, which takes two to three minutes.
demo: system $(VENV)/.installed
	$(BIN)/crowdsim run scenarios/brawl_30.yaml
	@echo
	@echo "Watch it:    $(BIN)/crowdsim render output/brawl_30 --contact-sheet 12 --mp4"
	@echo "Measure it:  $(BIN)/crowdsim inspect output/brawl_30 --plots output/brawl_30_plots"
	@echo "Run again:   $(BIN)/crowdsim run scenarios/brawl_30.yaml --force"

test: system $(VENV)/.installed-test
	$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder -m "not slow and not browser"

# Slow tests run every benchmark, so they need the packages that benchmarks compare with; and Blender, where it installs.
test-slow: system $(VENV)/.installed-bench $(VENV)/.installed-blender
	$(BIN)/python -m pytest -n 2 --dist loadfile -m slow

# Pages of the player in Chromium, without a window. With CI=true a browser that is missing fails the tests.
test-browser: $(VENV)/.installed-test
	@command -v chromium || command -v chromium-browser || command -v google-chrome-stable || command -v google-chrome \
	  || echo "no Chromium was found; on Debian: apt-get install --no-install-recommends chromium"
	$(BIN)/python -m pytest -m browser tests/browser

$(VENV)/.installed-bench: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[test,bench]'
	touch $@ $(VENV)/.installed-test $(VENV)/.installed

# Blender as a package wants one version of Python and an older numpy, and so has an environment of its own.
$(VENV)/.installed-blender: | $(BIN)/python
	$(PYTHON) -m venv $(VENV)/blender
	$(VENV)/blender/bin/python -m pip install --quiet --disable-pip-version-check --only-binary :all: bpy && touch $@ \
	  || echo "the package bpy does not install for this Python: its test is skipped"

# Trains what ships trained, and builds dist/crowdsim-*.whl with it, which never trains it again where it is installed.
wheel: $(VENV)/.installed
	$(BIN)/python release/make_wheel.py

# Measures everything, writes benchmarks/results.json, and makes the tables of the documentation from it. A benchmark
# that fails keeps its previous figures; the tables are made all the same. BENCHMARKS="scenes control" measures these.
bench: system $(VENV)/.installed-bench
	$(BIN)/python benchmarks/run_all.py $(BENCHMARKS); code=$$?; $(BIN)/python docs/make_tables.py && exit $$code

docs-tables: $(VENV)/.installed
	$(BIN)/python docs/make_tables.py

docs-pictures: $(VENV)/.installed
	$(BIN)/python docs/make_pictures.py

docs-reference: $(VENV)/.installed
	$(BIN)/python docs/make_reference.py

lint: $(VENV)/.installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

clean:
	rm -rf $(VENV) build dist *.egg-info
