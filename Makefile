# Each target first sets up what it needs, if that is not there yet.
# `make impact PYTHON=python3.12` chooses the interpreter of the environment.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

# Python compiles a module when it is first imported; to compile all of them here takes 16 s longer.
PIP_OPTIONS := --quiet --disable-pip-version-check --no-compile

# Runs apt-get as root, or through sudo where that asks no password; fails quietly otherwise.
APT := [ "$$(id -u)" = 0 ] && as_root= || as_root="sudo -n"; \
	apt() { $$as_root env DEBIAN_FRONTEND=noninteractive apt-get "$$@" >/dev/null 2>&1; }; \
	apt_install() { apt update; apt install -y --no-install-recommends "$$@"; }

# `make` without a target runs the first one.
.PHONY: impact help test slow wheel lock bench bench-check gallery-quick docs vulkan browser clean

impact: $(VENV)/.run vulkan ## crack a plate, into outputs/impact_quick/
	$(BIN)/ldem impact configs/impact_quick.toml --force
	@echo "Pictures:"; ls outputs/impact_quick/*.png

help: ## list these targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "%-14s%s\n", $$1, $$2 }' Makefile

test: $(VENV)/.dev vulkan browser ## linters, types, layers and tests
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

# What takes minutes: fuzzing, kills, faults, installs.
slow: $(VENV)/.dev vulkan ## tests that take minutes: fuzzing, kills, faults
	$(BIN)/python -m pytest -m slow

# The wheel in a clean environment: newest dependencies, then the lowest that are admitted.
wheel: $(VENV)/.dev ## the wheel, installed into a clean environment
	$(BIN)/python tests/support/clean_install.py
	$(BIN)/python tests/support/clean_install.py --lowest

# The versions that the checks ran with; elsewhere the bounds of pyproject.toml decide.
lock: $(VENV)/.dev ## write requirements-dev.lock from .venv
	version=$$($(BIN)/python -c 'import sys; print("%d.%d" % sys.version_info[:2])'); \
	{ echo "# make lock, Python $$version"; $(BIN)/python -m pip freeze --exclude-editable \
		| sed "s/$$/; python_version == \"$$version\"/"; } > requirements-dev.lock

bench: $(VENV)/.run ## speed of the step
	$(BIN)/python benchmarks/bench.py

# Fails when the step has lost 15 % against the C baseline in the same run.
bench-check: $(VENV)/.run ## fail where the step has become slower
	$(BIN)/python benchmarks/bench.py --check

# Too long for `make test`; it fails where a problem has no result. A number that misses is a result.
gallery-quick: $(VENV)/.run ## benchmark problems, coarse, in ten minutes
	$(BIN)/ldem gallery --quick

# The pictures of a run are drawn on a Vulkan device; Mesa's software device will do.
vulkan: ## a software device for pictures, by apt, where there is none
	@ldconfig=$$(command -v ldconfig || echo /sbin/ldconfig); \
	if ! $$ldconfig -p | grep -q libvulkan.so.1 || \
		! find /usr/share/vulkan/icd.d /etc/vulkan/icd.d -name 'lvp_icd*.json' 2>/dev/null | grep -q .; then \
		$(APT); apt_install libvulkan1 mesa-vulkan-drivers \
			|| echo "No Vulkan device: install libvulkan1 and mesa-vulkan-drivers for snapshots."; \
	fi

# Reports are tested in a real browser.
browser: ## chromium for the tests of reports, by apt, where there is none
	@if ! command -v chromium chromium-browser chrome >/dev/null; then \
		$(APT); apt_install chromium || echo "No browser: install chromium to test reports in it."; \
	fi

# Fails on any warning: a missing page, a broken link.
docs: $(VENV)/.dev ## these pages, into build/docs/
	$(BIN)/mkdocs build --strict

$(VENV)/.run: pyproject.toml $(VENV)/.made
	$(BIN)/python -m pip install $(PIP_OPTIONS) -e '.[report,movie]'
	@touch $@

$(VENV)/.dev: pyproject.toml requirements-dev.lock $(VENV)/.made
	$(BIN)/python -m pip install $(PIP_OPTIONS) \
		-c requirements-dev.lock -e '.[dev]'
	@touch $@ $(VENV)/.run

$(VENV)/.made:
	@if ! command -v $(PYTHON) >/dev/null; then $(APT); apt_install python3 python3-venv || true; fi; \
	for python in $(PYTHON) python3.13 python3.12 python3.11 python3.10 none; do \
		"$$python" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info < (3, 14))' \
			2>/dev/null && break; \
	done; \
	if [ "$$python" = none ]; then \
		echo "No Python 3.10 to 3.13 found (Taichi 1.7.4 has no wheel for 3.14): install one of them," \
			"or name it: make PYTHON=/path/to/python3.13" >&2; exit 1; fi; \
	if ! "$$python" -c 'import ensurepip, venv' 2>/dev/null; then \
		$(APT); apt_install python3-venv "$$(basename "$$python")-venv" || apt_install python3-venv \
			|| { echo "No venv module for $$python: install python3-venv." >&2; exit 1; }; \
	fi; \
	"$$python" -m venv $(VENV)
	@touch $@

clean: ## remove .venv and what was built
	rm -rf $(VENV) build dist ./*.egg-info
