# Needs GNU make and a Python of 3.11 to 3.14; everything else goes into .venv. `make help` lists the targets.
# All paths are relative, so a checkout in a folder whose name holds spaces works.

SHELL := /bin/sh
MAKEFLAGS += --no-print-directory --no-builtin-rules
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.SUFFIXES:
# Bytecode is kept, whatever the environment says: the tests start hundreds of commands, which would compile all anew.
unexport PYTHONDONTWRITEBYTECODE

# `make install PYTHON=/path/to/python3.13` chooses another interpreter. The locked packages are those of 3.11, on which
# everything is tested; each has its wheel, by the same hashes, for 3.12 to 3.14.
PYTHON ?= python3.11
PYTHONS := python3.11 python3.12 python3.13 python3.14 python3 python /usr/bin/python3

VENV := .venv
BIN := $(VENV)/bin
VPY := $(BIN)/python
LOCK := requirements.lock
# What is installed is written down in two files, so that an edit of pyproject.toml does not bring the
# whole environment down again.
LOCKED := $(VENV)/.locked
INSTALLED := $(VENV)/.installed

CODE := pouring_robot $(if $(wildcard scripts/*.py),scripts)
# Each worker gets neighbouring tests, so that what they share is made once; who is done takes over from the other.
PYTEST_ARGS ?= -n auto --dist worksteal
DEMO := demo
SITE_BIN := .venv-docs/bin
BENCHMARK_ARGS ?=

say = @printf '==> %s\n' "$(1)"
# A pip that asks nothing and says little. The lock decides what is installed, so no warning about versions.
pip = $(VPY) -m pip --disable-pip-version-check --no-input --quiet
locked = $(pip) install --no-compile --no-deps --require-hashes -r

.PHONY: help install demo test lint format typecheck lock wheel docs benchmark clean FORCE

help:  ## list the targets
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/  make \1\t\2/p' Makefile | expand -t 18

install: $(INSTALLED)  ## make .venv from the locked packages and install pouring_robot in it

# An environment remembers the folder it was made in; in a moved or copied checkout it is made anew.
ifneq ($(shell cat $(LOCKED) 2>/dev/null),$(CURDIR))
$(LOCKED): FORCE
endif

$(LOCKED): $(LOCK)
	$(call say,looking for a Python of 3.11 to 3.14 with venv)
	@found=; \
	for candidate in "$(PYTHON)" $(PYTHONS); do \
	  if "$$candidate" -c 'import ensurepip, venv, sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 14))' 2>/dev/null; \
	  then found=$$candidate; break; fi; \
	done; \
	if [ -z "$$found" ]; then \
	  echo "make: no Python of 3.11 to 3.14 with its venv module found; install one (Debian: python3.11 python3.11-venv) or say make install PYTHON=/path/to/python3.11" >&2; \
	  exit 1; \
	fi; \
	printf '==> making %s with %s (%s)\n' "$(VENV)" "$$found" "$$("$$found" -c 'import platform; print(platform.python_version())')"; \
	"$$found" -m venv --clear $(VENV)
	$(call say,installing the locked packages (a few minutes the first time))
	@# Two at a time, each every other package of the lock; pip itself comes when nothing else runs. The lock is complete.
	@awk '/^[A-Za-z]/ { n++; part = /^(pip|setuptools)==/ ? "last" : n % 2 ? "odd" : "even" } n { print > (dir part ".txt") }' \
	  dir=$(VENV)/ $(LOCK)
	@$(locked) $(VENV)/odd.txt & other=$$!; $(locked) $(VENV)/even.txt; even=$$?; wait $$other && exit $$even
	@$(locked) $(VENV)/last.txt
	@$(pip) check
	@# pip compiles on one core; here all do, without the packages' own tests. What is not for this Python stays as it is.
	@-$(VPY) -m compileall -qq -j 0 -x '/tests?/' $(VENV)/lib
	@printf '%s' "$(CURDIR)" > $@

$(INSTALLED): $(LOCKED) pyproject.toml
	$(call say,installing pouring_robot)
	@$(pip) install --no-deps --no-build-isolation --editable .
	@touch $@
	$(call say,done; the command is $(BIN)/pouring-robot)

demo: $(INSTALLED)  ## where the ladle is at five poses: a table, and the page and picture in demo/
	$(call say,pouring-robot path examples/poses.csv --model examples/actual.yaml --html … --png …)
	@mkdir -p $(DEMO)
	@$(BIN)/pouring-robot path examples/poses.csv --model examples/actual.yaml --overwrite \
	  --html $(DEMO)/ladle.html --png $(DEMO)/ladle.png

test: $(INSTALLED)  ## lint, types and all tests
	@$(MAKE) --jobs=2 --output-sync=target lint typecheck
	$(call say,pytest)
	@$(VPY) -m pytest $(PYTEST_ARGS)

lint: $(INSTALLED)  ## ruff and the order of the rooms; nothing is changed
	$(call say,ruff)
	@$(VPY) -m ruff check .
	@$(VPY) -m ruff format --check .
	$(call say,import-linter)
	@$(BIN)/lint-imports --no-logo

typecheck: $(INSTALLED)  ## mypy --strict
	$(call say,mypy)
	@$(VPY) -m mypy --strict --num-workers auto $(CODE)

format: $(INSTALLED)  ## let ruff mend what it can and format
	$(call say,ruff: mending and formatting)
	@$(VPY) -m ruff check --fix-only .
	@$(VPY) -m ruff format .

# Hashes only: where the packages came from (index addresses, local folders) is each machine's own business.
# The file is written beside the old one, checked, and only then put in its place.
lock: $(INSTALLED)  ## renew requirements.lock from pyproject.toml
	$(call say,resolving (some minutes))
	@rm -f $(LOCK).new
	@$(VPY) -m piptools compile --quiet --upgrade --extra dev --generate-hashes --allow-unsafe --strip-extras \
	  --no-header --no-annotate --no-emit-index-url --no-emit-trusted-host --no-emit-find-links \
	  --no-emit-options --output-file $(LOCK).new pyproject.toml
	@if grep -nE '://|^-|^ *(/|\.)| @ ' $(LOCK).new; then \
	  echo "make: $(LOCK).new names a place or an option, see the lines above; $(LOCK) is unchanged" >&2; exit 1; fi
	@{ echo '# Every package of the environment, run time and development, pinned with its hashes, for Python 3.11.'; \
	   echo '# Made by `make lock` from pyproject.toml; not edited by hand.'; \
	   cat $(LOCK).new; } > $(LOCK).tmp
	@mv $(LOCK).tmp $(LOCK)
	@rm -f $(LOCK).new
	$(call say,$(LOCK) renewed; make install brings .venv up to it)

wheel: $(INSTALLED)  ## build the wheel and the source archive into dist/
	$(call say,building into dist/)
	@rm -rf dist
	@$(VPY) -m hatchling build

# What builds the site is not in the lock: nobody needs it to run or test the package.
.venv-docs/.installed: $(INSTALLED) pyproject.toml
	$(call say,making .venv-docs)
	@$(VPY) -m venv --clear .venv-docs
	@$(VPY) -c "import tomllib; print(*tomllib.load(open('pyproject.toml', 'rb'))['project']['optional-dependencies']['docs'], sep='\n')" \
	  > .venv-docs/wanted.txt
	@$(SITE_BIN)/python -m pip --disable-pip-version-check --no-input --quiet install -r .venv-docs/wanted.txt
	@touch $@

docs: .venv-docs/.installed  ## build the pages of docs/ as a site into site/; a warning is an error
	$(call say,mkdocs build)
	@NO_MKDOCS_2_WARNING=1 $(SITE_BIN)/mkdocs build --strict --quiet

benchmark: $(INSTALLED)  ## measure speed
	$(call say,benchmark)
	@$(VPY) scripts/benchmarks/speed.py $(BENCHMARK_ARGS)
	@$(VPY) scripts/benchmarks/batch.py $(BENCHMARK_ARGS)

clean:  ## remove everything that make and the tools wrote
	$(call say,removing .venv and demo/ and build outputs and caches)
	@rm -rf $(VENV) .venv-docs site build dist demo .mypy_cache .pytest_cache .ruff_cache .hypothesis
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +
