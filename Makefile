# make reproduce   the paper, run end to end; report in truepose-report/
# make test        pytest, the C++ tests under ASan and UBSan, the examples
#
# Both set up what they need in .venv, from Python's registry, without root.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
export PATH := $(abspath $(BIN)):$(PATH)

PACKAGE := $(shell find include src cmake python robots -type f -not -name '*.pyc') \
           CMakeLists.txt pyproject.toml README.md
CPP := $(shell find include src tests/cpp tests/fuzz benchmarks examples/cpp -name '*.[hc]pp')

.DEFAULT_GOAL := help
.PHONY: help reproduce report test test-python test-cpp lint format fuzz realtime consumer instructions bench bench-peers mutants \
        coverage coverage-python coverage-cpp pictures docs twin clean

help:
	@sed -n 's/^# \?//p' Makefile | sed '/^$$/q'
	@echo "Also: report lint format fuzz realtime consumer instructions bench mutants coverage pictures docs twin clean"

reproduce: $(VENV)/installed
	@truepose reproduce $(ARGS)

# The same, and what takes statistics over 100 robots: sets of sensors. Some minutes more.
report: $(VENV)/installed
	@truepose reproduce --full $(ARGS)

test: test-python test-cpp

test-python: $(VENV)/developing
	python -m pytest -q --pyargs truepose tests/python docs README.md

test-cpp: build/asan/build.ninja
	cmake --build --preset asan
	ctest --preset asan

lint: $(VENV)/developing
	ruff check .
	ruff format --check .
	PYTHONPATH=python lint-imports --no-cache
	clang-format --dry-run --Werror $(CPP)

format: $(VENV)/developing
	ruff check --fix .
	ruff format .
	clang-format -i $(CPP)

# Each fuzz target under libFuzzer for SECONDS; what it learns stays in build/fuzz/corpus. An input that
# breaks a promise is left in build/fuzz: hand it to the target again to see it break.
SECONDS ?= 60
FUZZ := kinematics full estimate control
fuzz: $(VENV)/developing
	@if command -v clang++-22 >/dev/null; then \
	  cmake --preset fuzz -DPython_EXECUTABLE=$(abspath $(BIN))/python && cmake --build --preset fuzz && \
	  cd build/fuzz && for target in $(FUZZ); do \
	    mkdir -p corpus/$$target && tests/fuzz/fuzz_$$target -max_total_time=$(SECONDS) -max_len=2000 \
	      -timeout=5 -print_final_stats=1 corpus/$$target || exit 1; \
	  done; \
	else echo "fuzz: SKIPPED, clang++-22 is not installed (Debian: clang-22 libclang-rt-22-dev)"; fi

# The control path under RealtimeSanitizer and clang's function effects.
realtime: $(VENV)/developing
	@if command -v clang++-22 >/dev/null; then \
	  cmake --preset realtime -DPython_EXECUTABLE=$(abspath $(BIN))/python && \
	  cmake --build --preset realtime && ctest --preset realtime; \
	else echo "realtime: SKIPPED, clang++-22 is not installed (Debian: clang-22 libclang-rt-22-dev)"; fi

# A C++ project that uses the installed package, by clang++-22; `make test` has it by the system's c++.
consumer: $(VENV)/developing
	@if command -v clang++-22 >/dev/null; then \
	  CXX=clang++-22 python -m pytest -q tests/python/test_package.py; \
	else echo "consumer: SKIPPED, clang++-22 is not installed (Debian: clang-22)"; fi

# Instruction counts against benchmarks/instructions.json; all C++ tests, optimised.
instructions: build/dev/build.ninja
	@if command -v valgrind >/dev/null; then \
	  cmake --build --preset dev && ctest --preset dev; \
	else echo "instructions: SKIPPED, valgrind is not installed (Debian: valgrind)"; fi

# Wrong changes of one line, each against the one test that must notice it (tests/mutants.toml).
mutants: $(VENV)/developing
	@python tests/mutants.py $(ARGS)

# Which branches no test takes: of the package by coverage.py, of the core by clang. Some minutes.
coverage: coverage-python coverage-cpp

coverage-python: $(VENV)/developing
	coverage run -m pytest -q tests/python
	coverage report --skip-covered --show-missing

coverage-cpp: $(VENV)/developing
	@if command -v clang++-22 llvm-cov-22 >/dev/null; then \
	  cmake --preset coverage -DPython_EXECUTABLE=$(abspath $(BIN))/python && \
	  cmake --build --preset coverage && ctest --preset coverage && \
	  llvm-profdata-22 merge -sparse -o build/coverage/all.profdata build/coverage/*.profraw && \
	  llvm-cov-22 report $$(printf -- '-object %s ' build/coverage/tests/cpp/test_*[a-z]) \
	    -instr-profile build/coverage/all.profdata --show-branch-summary include/truepose; \
	else echo "coverage-cpp: SKIPPED, clang is not installed (Debian: clang-22 llvm-22)"; fi

bench: build/dev/build.ninja
	cmake --build --preset dev
	build/dev/benchmarks/benchmark_core

# Pinocchio and MuJoCo on the same hexapod; those that are not installed are skipped.
bench-peers: bench
	@pip install --quiet --disable-pip-version-check ".[peers]" || echo "bench-peers: without the peers"
	python benchmarks/peers.py --core build/dev/benchmarks/benchmark_core

pictures: $(VENV)/installed
	python -c "import truepose as tp; from truepose.show.drawing import draw; [draw(tp.load(name)).savefig(f'robots/{name}/picture.png', dpi=110) for name in tp.robots()]"
	python docs/site/figures.py

# The documentation as a site, in build/docs; the C++ reference where doxygen is installed.
docs: $(VENV)/documenting
	python docs/site/make.py

# The H4 whose Table 3 is close to the printed one: ten searches, some minutes.
twin: $(VENV)/installed
	python tools/twin_folder.py robots/h4-lirmm-twin

build/%/build.ninja: CMakeLists.txt CMakePresets.json tests/cpp/CMakeLists.txt benchmarks/CMakeLists.txt | $(VENV)/developing
	cmake --preset $* -DPython_EXECUTABLE=$(abspath $(BIN))/python

# pip writes to stamps' neighbours, not to the stamps: touch says when they are true.
$(VENV)/created:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "truepose needs Python 3.11 or later; $(PYTHON) is older (set PYTHON=...)"; exit 2; }
	$(PYTHON) -m venv $(VENV)
	@touch $@

$(VENV)/installed: $(PACKAGE) | $(VENV)/created
	@echo "building truepose into $(VENV) ..."
	@pip install --quiet --disable-pip-version-check .
	@touch $@

$(VENV)/developing: $(VENV)/installed
	@pip install --quiet --disable-pip-version-check ".[dev]"
	@touch $@ && touch -r $@ $(VENV)/installed

$(VENV)/documenting: pyproject.toml | $(VENV)/installed
	@python -c "import tomllib; \
	  extras = tomllib.load(open('pyproject.toml', 'rb'))['project']['optional-dependencies']; \
	  print(*extras['docs'], sep='\n')" | pip install --quiet --disable-pip-version-check -r /dev/stdin
	@touch $@

clean:
	rm -rf build dist $(VENV) truepose-report
