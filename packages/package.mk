# Each package's Makefile: `make test` checks its types, and runs its tests and the examples of its pages.
ROOT := $(abspath $(dir $(lastword $(MAKEFILE_LIST)))..)
NAME := $(notdir $(CURDIR))
STAMP := $(ROOT)/.venv/package-$(NAME)
export PATH := $(ROOT)/.venv/bin:$(PATH)

CORE := developing
.PHONY: test core installed
test: $(STAMP)
	@cp -p $(ROOT)/.venv/lib/python3*/site-packages/truepose/_core.pyi $(ROOT)/python/truepose # as make lint
	cd $(ROOT) && mypy -p truepose_$(subst -,_,$(NAME))
	OPENBLAS_NUM_THREADS=1 python -m pytest -q -n auto --dist worksteal $(TESTS) --pyargs truepose_$(subst -,_,$(NAME)) tests docs README.md

installed: $(STAMP)

core:
	@$(MAKE) --no-print-directory -C $(ROOT) .venv/$(CORE)

# The core is there: pip compares its version with the one that the package is pinned to.
$(STAMP): pyproject.toml $(shell find src $(wildcard include CMakeLists.txt) -type f -not -name '*.pyc') | core
	@pip install --quiet --disable-pip-version-check --force-reinstall --no-deps .
	@pip install --quiet --disable-pip-version-check ".$(EXTRA)"
	@touch $@
