# make demo   a node and a client over real DDS, with a table and a picture; METHODS=all asks all methods
# make test   all tests but those that take long
# make test-plain   the core's tests with plain compilation, as for a numba version that was not tested
# make lint   what needs no run: likely mistakes and layout by ruff, types by pyright
# make venv   what all need: .venv with the pinned dependencies, the interfaces and this package, editable
# make check-all   lint and test, then what takes hours: thousands of random examples of each kind, a build with the
#             C++ interfaces, the site with all commands and snippets of the pages for users, release, and soak
# make pictures   the docs' pictures whose sources changed; hours, where experiments of the evaluation are among them
# make docs   the site: all pages and the generated reference, in docs/_build/index.html
# make wheels   a wheel with compiled kernels for each Python 3.11, 3.12 and 3.13 found, and one without, in dist/
# make release  wheels, source distribution and notes of a release, checked, in dist/; needs an hour
# make soak   random and malformed requests to the node for ten minutes, a robot's day in five, and its memory
# make clean  remove .venv, if make made it, and what builds leave behind
#
# PYTHON=... chooses the Python, 3.11 or 3.12, and VENV=... another folder than .venv. Each step leaves a stamp in it,
# so an interrupted one is made again. A folder without stamps is somebody else's, and stays as it is.

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help

# Another ROS that the shell has sourced, or a wheel's own environment, must not reach into .venv.
unexport $(filter-out ROS_DOMAIN_ID, $(filter AMENT_% COLCON_% RMW_% ROS_%, $(.VARIABLES)))
unexport CMAKE_PREFIX_PATH LD_LIBRARY_PATH PKG_CONFIG_PATH PYTHONHOME PYTHONPATH _ROS_WHEELS_BOOTSTRAP_COMPLETE

VENV := .venv
VENV_PYTHON := $(VENV)/bin/python
PIP := $(VENV_PYTHON) -m pip -q --no-input --disable-pip-version-check install --no-compile -c requirements/constraints.txt
MADE := $(VENV)/made
PREFIX := $(CURDIR)/$(VENV)
CMAKE := env PATH="$(PREFIX)/bin:$(PATH)" AMENT_PREFIX_PATH="$(PREFIX)" CMAKE_PREFIX_PATH="$(PREFIX)" \
    PYTHONPATH="$(CURDIR)/cmake/parse_once" PARSED_INTERFACES="$(PREFIX)/made/build/parsed" cmake
INTERFACES := $(wildcard unc_physics_msgs/*.* unc_physics_msgs/*/*.*)

# A venv knows its folder: one that was moved or whose Python is gone is made anew.
ifneq ($(shell cat $(MADE)/python 2>/dev/null),$(CURDIR))
$(MADE)/python: FORCE
else ifneq ($(shell $(VENV_PYTHON) -c 'import pip; print("works")' 2>/dev/null),works)
$(MADE)/python: FORCE
endif

.PHONY: help venv demo lint linted test test-plain check-all pictures docs wheels release soak clean FORCE

help:
	@sed -n 's/^# \?//; /^$$/q; p' Makefile

ALL_METHODS := $(if $(filter all, $(METHODS)),--all-methods)

# For the demo, pip installs ROS and the interfaces compile while the kernels compile.
MAKE_STEPS := $(MAKE) -s --no-print-directory -j2

venv:
	@$(MAKE_STEPS) $(MADE)/package

demo:
	@$(MAKE_STEPS) $(MADE)/kernels $(MADE)/package $(MADE)/more_kernels $(ALL_METHODS:%=$(MADE)/kernels_of_all_methods)
	@$(VENV_PYTHON) -m unc_physics.ros.demo $(ALL_METHODS)

# Without the variable pyright would look for a newer version of itself.
lint:
	@$(MAKE_STEPS) linted

linted: $(MADE)/evaluation
	@$(VENV_PYTHON) -m ruff check -q .
	@$(VENV_PYTHON) -m ruff format -q --check .
	@PYRIGHT_PYTHON_IGNORE_WARNINGS=1 $(VENV_PYTHON) -m pyright --pythonpath $(VENV_PYTHON)

# A file's tests run in one process, as they share fixtures. Three processes keep two processors busy: tests of the
# node and of the browser wait half of their time.
test:
	@$(MAKE_STEPS) $(MADE)/evaluation $(MADE)/all_kernels $(MADE)/paper_kernels
	@$(VENV_PYTHON) -m pytest test -m "not long" -n 3 --dist loadfile --no-loadscope-reorder

test-plain:
	@$(MAKE_STEPS) $(MADE)/evaluation
	@UNC_PHYSICS_COMPILER=plain $(VENV_PYTHON) -m pytest test/compiler test/physics test/prediction test/propagators \
	    -n 2 --dist loadfile --no-loadscope-reorder

check-all:
	@$(MAKE) -s --no-print-directory lint
	@$(MAKE) -s --no-print-directory test
	@$(VENV_PYTHON) -m pytest test -m long
	@$(VENV_PYTHON) -m pytest test/checks test/physics test/shapes test/propagators --hypothesis-profile=thousands
	@$(VENV_PYTHON) -m pytest test/cli/test_anything.py test/cli/test_bad_input.py test/ros/test_any_request.py \
	    --hypothesis-profile=thousands
	@CPP_INTERFACES=ON $(VENV_PYTHON) -m pytest -q test/packaging/test_colcon.py
	@CONE_ROLLOUT=ON $(VENV_PYTHON) -m pytest -q test/extending/test_shape.py
	@$(MAKE) -s --no-print-directory docs
	@$(VENV_PYTHON) docs/count_words.py
	@$(VENV_PYTHON) docs/run_pages.py
	@$(MAKE) -s --no-print-directory $(MADE)/notebooks
	@$(VENV_PYTHON) docs/run_notebooks.py
	@for python in python3.11 python3.12; do \
	    if "$$python" -c "$$FITS" 2>/dev/null; then \
	        BASE_PYTHON="$$(command -v "$$python")" $(VENV_PYTHON) -m pytest -q test/packaging/test_pip.py; \
	    fi; \
	done
	@$(MAKE) -s --no-print-directory release
	@$(MAKE) -s --no-print-directory soak

pictures:
	@$(MAKE_STEPS) $(MADE)/evaluation
	@$(VENV_PYTHON) docs/pictures.py

docs:
	@$(MAKE_STEPS) $(MADE)/docs
	@PYTHONPATH=$(VENV)/docs $(VENV_PYTHON) -m sphinx -q -W --keep-going docs docs/_build
	@echo "docs/_build/index.html"

wheels:
	@set --; for python in python3.11 python3.12 python3.13; do \
	    if "$$python" -c "import ensurepip, venv" 2>/dev/null; then set -- "$$@" "$$python"; fi; \
	done; "$$1" release/wheels.py --python "$$@"

release: wheels venv
	@$(PIP) twine
	@$(VENV_PYTHON) release/release.py

soak: venv
	@$(VENV_PYTHON) test/ros/soak.py
	@$(VENV_PYTHON) test/ros/day_on_a_robot.py

clean:
	@if [[ -d $(MADE) ]]; then rm -rf $(VENV); fi
	rm -rf dist {.,evaluation}/{build,*.egg-info} docs/_build docs/reference/generated/python_*.md install log unc_physics/__pycache__/kernels-* unc_physics/kernels .pytest_cache .hypothesis .ruff_cache .import_linter_cache

# A Python fits if it runs at all (a shim may not), can make a venv, and has the headers to compile against.
define FITS
import ensurepip, os, sys, sysconfig, venv
header = os.path.join(sysconfig.get_path("include"), "Python.h")
sys.exit(sys.version_info[:2] not in ((3, 11), (3, 12)) or not os.path.exists(header))
endef
export FITS

$(MADE)/python:
	@if [[ -e $(VENV) && ! -d $(MADE) ]]; then \
	    echo "$(VENV) was not made by make, and would be erased. Move it away, or choose another folder, as with" \
	        "\`make VENV=.venv-ros\`." >&2; exit 1; \
	fi; \
	for python in $(or $(PYTHON),python3.12 python3.11 python3); do \
	    if "$$python" -c "$$FITS" 2>/dev/null; then \
	        echo "Making .venv with $$("$$python" --version) ..."; \
	        rm -rf $(VENV) && mkdir -p $(MADE) && "$$python" -m venv $(VENV) && $(PIP) pip && echo "$(CURDIR)" > $@; \
	        exit; \
	    fi; \
	done; \
	echo "No Python 3.11 or 3.12 with venv and headers (on Ubuntu: python3-venv, python3-dev) among:" \
	    "$(or $(PYTHON),python3.12 python3.11 python3). Name one with PYTHON=..." >&2; exit 1

# First, as the kernels take longest to compile and need nothing else.
$(MADE)/run: $(MADE)/python requirements/run.txt requirements/constraints.txt
	@echo "[1] Installing the library's dependencies: about 15 s ..."
	@$(PIP) -r requirements/run.txt
	@touch $@

$(MADE)/ros: $(MADE)/run requirements/ros.txt
	@echo "[2] Installing ROS 2 Jazzy: about 20 s ..."
	@$(PIP) -r requirements/ros.txt
	@touch $@

# Removed before they are built again, as libraries that a build no longer makes would stay and be loaded.
INSTALLED_INTERFACES = $(VENV)/lib/libunc_physics_msgs__* $(VENV)/share/unc_physics_msgs \
    $(VENV)/lib/python3.*/site-packages/unc_physics_msgs

$(MADE)/interfaces: requirements/ros.txt $(INTERFACES) cmake/ros_wheels.cmake | $(MADE)/ros
	@echo "[3] Building unc_physics_msgs, beside the other steps: half a minute ..."
	@rm -rf $(MADE)/build $(INSTALLED_INTERFACES) && mkdir -p $(MADE)/build/parsed
	@{ $(CMAKE) -S unc_physics_msgs -B $(MADE)/build -DCMAKE_C_FLAGS=-O1 -DCMAKE_CXX_FLAGS=-O1 -DCPP_INTERFACES=OFF \
	        -DCMAKE_UNITY_BUILD=ON -DCMAKE_UNITY_BUILD_BATCH_SIZE=20 -DBUILD_TESTING=OFF \
	        -DCMAKE_PROJECT_INCLUDE="$(CURDIR)/cmake/ros_wheels.cmake" \
	        -DPython3_EXECUTABLE="$(PREFIX)/bin/python" -DCMAKE_INSTALL_PREFIX="$(PREFIX)" && \
	    $(CMAKE) --build $(MADE)/build --parallel 2 && $(CMAKE) --install $(MADE)/build; \
	} > $(MADE)/interfaces.log 2>&1 || { tail -n 30 $(MADE)/interfaces.log; exit 1; }
	@rm -rf $(MADE)/build && touch $@

# What the demo asks of the kernels, for its node and client to find them compiled. One process compiles the time loop of
# rollouts; after the interfaces, the other one compiles what builds on rollouts, and draws the first picture.
define COMPILE
import sys
from unc_physics import Upright, predict
from unc_physics.prediction.warm_up import warm_up
from unc_physics.ros.demo_scene import table_scene
scene, belief = table_scene()
if "cloud" in sys.argv:
    warm_up([])
for propagator in sys.argv[1:]:
    prediction = predict(scene, belief, propagator, 0.1, events=[Upright("carton")])
if "cloud" in sys.argv:
    prediction.plot()
endef
export COMPILE

$(MADE)/kernels: $(MADE)/run
	@echo "[4] Compiling the kernels of rollouts: 40 s ..."
	@$(VENV_PYTHON) -c "$$COMPILE" monte_carlo
	@touch $@

$(MADE)/more_kernels: $(MADE)/run | $(MADE)/interfaces
	@echo "[5] Compiling what else the demo needs, beside the first: about 20 s ..."
	@$(VENV_PYTHON) -c "$$COMPILE" cloud sigma_points auto
	@touch $@

$(MADE)/kernels_of_all_methods: $(MADE)/kernels | $(MADE)/more_kernels
	@echo "[6] Compiling the kernels of all other methods: about a minute ..."
	@$(VENV_PYTHON) -c "$$COMPILE" linearization surrogate local_sampling
	@touch $@

# What nearly all tests ask of the kernels: it compiles while pip downloads what else they need.
$(MADE)/all_kernels: $(MADE)/run
	@$(VENV_PYTHON) -m unc_physics warm-up > $(MADE)/all_kernels.log
	@touch $@

$(MADE)/paper_kernels: $(MADE)/run
	@$(VENV_PYTHON) -m unc_physics warm-up --physics paper > $(MADE)/paper_kernels.log
	@touch $@

# Launch files, scripts and configuration are copied for ros2 run and ros2 launch.
$(MADE)/package: $(MADE)/run $(MADE)/interfaces setup.py setup.cfg package.xml $(wildcard config/* launch/* scripts/*)
	@PYTHONWARNINGS=ignore $(PIP) --no-deps --no-build-isolation -e .
	@touch $@

$(MADE)/test: $(MADE)/package requirements/test.txt
	@echo "Installing what the tests need ..."
	@$(PIP) -r requirements/test.txt
	@touch $@

# In a folder of its own, as Sphinx and colcon want different docutils.
$(MADE)/docs: $(MADE)/run requirements/docs.txt
	@echo "Installing Sphinx ..."
	@rm -rf $(VENV)/docs
	@$(filter-out -c requirements/constraints.txt, $(PIP)) --no-deps --target $(VENV)/docs -r requirements/docs.txt
	@touch $@

$(MADE)/notebooks: $(MADE)/run requirements/notebooks.txt
	@$(PIP) -r requirements/notebooks.txt
	@touch $@

$(MADE)/evaluation: $(MADE)/test evaluation/pyproject.toml
	@PYTHONWARNINGS=ignore $(PIP) --no-deps --no-build-isolation -e ./evaluation
	@touch $@
