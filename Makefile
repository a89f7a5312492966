# Everything a user or a contributor runs. On a fresh Debian machine `make demo` and `make test` need only Python.
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
# Tests wait for boards in real time for a third of it: three at once keep two cores busy.
JOBS   ?= 3
INSTALL = $(BIN)/python -m pip install -q --disable-pip-version-check
# uv installs in a third of pip's time; pip where uv reaches no index, as behind a mirror that only pip is told of.
QUICKLY = sh -c '$(BIN)/uv pip install -q --python $(BIN)/python "$$@" || $(INSTALL) --no-compile "$$@"' --
DAILY   = QT_QPA_PLATFORM=offscreen $(BIN)/python -m pytest -m "not nightly"
CORE    = tests/protocol tests/boat_daq/engine/control tests/analysis/calibration
OUT    ?= out/demo
ADVERSARY = tests/verification/test_adversary.py::test_no_scene_exceeds_its_stated_error

# What Qt and the tests need from Debian; the GUI's own libraries first, then the virtual screen and the PDF viewer.
QT_PACKAGES   := libegl1 libgl1 libxkbcommon-x11-0 libdbus-1-3 libfontconfig1 libglib2.0-0 libxcb-cursor0 \
                 libxcb-icccm4 libxcb-image0 libxcb-keysyms1 libxcb-randr0 libxcb-render-util0 libxcb-shape0 \
                 libxcb-xkb1 fonts-dejavu-core
TEST_PACKAGES := xvfb xdotool poppler-utils gcc libc6-dev python3-dev
NIGHTLY_PACKAGES := calculix-ccx chromium
# 110 MB to fetch, 0.9 GB installed: too much for `make test`, whose tests of the emulated chip skip without them.
CHIP_PACKAGES := gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm cppcheck

BUNDLE_PACKAGES := binutils python3-dev

BUNDLE    := out/bundle
DELIVERED := out/delivered
TOOLS     := out/tools

SECONDS ?= 600

# Bytecode is kept: programs that tests start, and each of the tests' workers, would compile the same sources again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: delivered bundle wheel sbom lock demo quick test daily checked check nightly adversary chip bench docs pictures fuzz mutation faults audit setup setup-test system system-test compiled collected pages clean help

help:            ## this list
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*##/\t/' | expand -t 14

demo: setup      ## set up, then a whole calibration session on the virtual board
	$(BIN)/boat-daq demo --out $(OUT)

quick: setup-test  ## half a minute: linters of what is not committed, types, the tests of the core
	@changed=$$(git diff --name-only --diff-filter=d HEAD -- '*.py'; git ls-files --others --exclude-standard -- '*.py'); \
	test -z "$$changed" || { $(BIN)/ruff check -q $$changed && $(BIN)/ruff format -q --check $$changed && $(BIN)/mypy; }
	@$(DAILY) -q -n 2 $(CORE)

test: setup-test  ## five minutes: set up, then the daily tests, linters, types, import directions and documentation
	@$(MAKE) --no-print-directory -j 3 daily checked

daily: compiled collected  # what failed is run again, alone
	@$(DAILY) -n $(JOBS) --dist worksteal; $(BIN)/python -m tests.repeat_failed $$?

checked: setup-test  # beside the tests, on what their waiting leaves of the processors
	@nice $(MAKE) --no-print-directory check pages

check: setup-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

compiled: setup-test  # what numba compiles, once and not in each of the tests' workers
	$(BIN)/boat-daq setup

collected: setup-test  # rewritten asserts, once and not in each of the workers; what fails here fails there, with its message
	-@QT_QPA_PLATFORM=offscreen $(BIN)/python -m pytest --collect-only -qq >/dev/null

nightly: setup-test  ## the tests that take minutes, many examples of each property, then `adversary`: a night
	@$(call debian_install,$(NIGHTLY_PACKAGES) $(CHIP_PACKAGES))
	QT_QPA_PLATFORM=offscreen $(BIN)/python -m pytest -m "nightly or hypothesis" --hypothesis-profile nightly \
	  --timeout 3600 --deselect $(ADVERSARY)
	@$(MAKE) --no-print-directory adversary

adversary: setup-test  ## search scenes whose true error exceeds the stated one: an hour a method, two at a time
	BOAT_ADVERSARY_S=$(or $(BOAT_ADVERSARY_S),3600) $(BIN)/python -m pytest $(ADVERSARY) -m nightly -n 2 --dist worksteal

chip: setup-test  ## the firmware on an emulated Cortex-M3: build it, run it, print its port; Ctrl-C ends it
	@$(call debian_install,$(CHIP_PACKAGES))
	$(BIN)/python -m tests.firmware.emulated_chip

bench: setup-test  ## print every benchmark's figure and ratio
	BOAT_BENCH=1 QT_QPA_PLATFORM=offscreen $(BIN)/python -m pytest tests/benchmarks -s -q --timeout 1200

fuzz: setup-test  ## coverage-guided fuzzing of every decoder (Linux); SECONDS=3600 for an hour
	$(INSTALL) --group fuzz
	$(BIN)/python -m tests.faults.fuzz $(SECONDS)

mutation: setup-test  ## small faults in the modules that others rest on: which does no test notice? (Linux, an hour)
	$(INSTALL) --group mutation
	QT_QPA_PLATFORM=offscreen $(BIN)/python -m tests.mutation.mutate

pages: setup-test  # the documentation read and its links resolved; warnings are errors
	$(BIN)/python -m sphinx -q -W --keep-going -b dummy -c docs -d out/doctrees . out/pages

docs: setup-test  ## the documentation, into out/docs/index.html; warnings are errors
	$(BIN)/python -m sphinx -q -W --keep-going -j 2 -c docs -d out/doctrees . out/docs

pictures: setup-test  ## take the pictures of the documentation again, in the window under Xvfb
	rm -rf out/pictures
	BOAT_DAQ_HOME=$(CURDIR)/out/pictures/home xvfb-run -a -s "-screen 0 1280x800x24" $(BIN)/python -m tests.docs.pictures out/pictures

faults: setup-test  ## write the table of faults to out/FAULTS.md from the tests' marks
	$(BIN)/python -m tests.faults.table

audit: setup     ## known weaknesses of the installed packages (asks an advisory service on the network)
	$(INSTALL) --group audit
	$(BIN)/python -m tests.faults.audit

# What a user gets, in an environment of its own, and beside it the tools that look at it.
delivered: system $(BIN)/python
	$(PYTHON) -m venv $(DELIVERED)
	$(DELIVERED)/bin/python -m pip install -q --disable-pip-version-check --upgrade "pip>=25.1"
	$(DELIVERED)/bin/python -m pip install -q --disable-pip-version-check .
	$(DELIVERED)/bin/python -m pip install -q --disable-pip-version-check --force-reinstall --no-deps .
	$(PYTHON) -m venv $(TOOLS)
	$(TOOLS)/bin/python -m pip install -q --disable-pip-version-check --upgrade "pip>=25.1"
	$(TOOLS)/bin/python -m pip install -q --disable-pip-version-check --group delivery

bundle: delivered  ## the program without Python, in out/bundle: a folder, and its archive (Linux)
	@$(call debian_install,$(BUNDLE_PACKAGES))
	PYTHONPATH=$$($(DELIVERED)/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))') \
	  $(TOOLS)/bin/python -m PyInstaller --noconfirm --log-level WARN --distpath $(BUNDLE) --workpath out/work packaging/boat-daq.spec
	mkdir -p $(BUNDLE)/boat-daq/desktop
	cp packaging/associate.sh packaging/boat-daq.desktop packaging/boat-daq.xml boat_daq/gui/boat-daq.svg $(BUNDLE)/boat-daq/desktop/
	tar -C $(BUNDLE) -czf $(BUNDLE)/boat-daq-$(shell uname -m).tar.gz boat-daq
	du -sh $(BUNDLE)/*

wheel: delivered  ## wheel and source archive, in out/dist
	rm -rf out/dist
	$(TOOLS)/bin/python -m build --outdir out/dist .

sbom: delivered  ## what is delivered with the program, as CycloneDX, in out/sbom.cdx.json
	sed "s/^dynamic = .*/version = \"$$($(DELIVERED)/bin/boat-daq --version | cut -d' ' -f2)\"/" pyproject.toml > out/pyproject.toml
	$(TOOLS)/bin/cyclonedx-py environment --pyproject out/pyproject.toml --output-reproducible --of JSON -o out/sbom.cdx.json $(DELIVERED)/bin/python

lock: setup      ## write uv.lock again: the exact versions that the tests are known to pass with
	$(BIN)/uv lock

setup: $(VENV)/.installed
setup-test: $(VENV)/.installed-test

# $(1): packages. Missing ones are installed where apt-get is there and allowed; elsewhere a line names them.
define debian_install
if command -v dpkg-query >/dev/null 2>&1 && command -v apt-get >/dev/null 2>&1; then \
	missing=""; for p in $(1); do \
	  dpkg-query -W -f '$${Status}\n' "$$p" "$${p}t64" 2>/dev/null | grep -q "^install ok installed" || missing="$$missing $$p"; done; \
	if [ -n "$$missing" ]; then \
	  if [ "$$(id -u)" = 0 ]; then as=""; elif command -v sudo >/dev/null 2>&1; then as=sudo; else \
	    echo "please install as root: apt-get install$$missing"; exit 1; fi; \
	  echo "installing$$missing"; \
	  $$as apt-get update -qq && DEBIAN_FRONTEND=noninteractive $$as apt-get install -y -qq --no-install-recommends $$missing >/dev/null; \
	fi; \
else echo "not a Debian system: if the window does not open, install Qt 6's libraries ($(1)) with your package manager"; fi
endef

system:
	@$(call debian_install,$(QT_PACKAGES))

system-test: system
	@$(call debian_install,$(TEST_PACKAGES))

$(BIN)/python:
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(0 if (3, 11) <= v < (3, 15) else "Python 3.11 to 3.14 is needed; this is %d.%d. Try: make PYTHON=python3.12" % v)'
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || { $(call debian_install,python3-venv); }
	$(PYTHON) -m venv $(VENV)
	$(INSTALL) --upgrade "pip>=25.1" uv

# Not compiled: of a thousand modules Python compiles the few that are imported, at their first import.
$(VENV)/.installed: pyproject.toml | system $(BIN)/python
	$(QUICKLY) --editable .
	$(BIN)/boat-daq setup
	@touch $@

$(VENV)/.installed-test: pyproject.toml | system-test $(BIN)/python
	$(QUICKLY) --editable ".[all]" --group dev
	@touch $@ $(VENV)/.installed

clean:           ## remove what the two commands made
	rm -rf $(VENV) out build *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
