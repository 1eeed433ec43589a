# Intuitive Physics. `make` alone lists what there is.

.DEFAULT_GOAL := help
.PHONY: help setup lint types docs test library-tests system-tests test-oldest demo bench-simulation \
	bench-prediction bench-perception bench-learning bench-flights bench-robot torture clean

# A ROS, or a Python, that the caller's shell has sourced must not mix with ours.
unexport PYTHONPATH PYTHONHOME LD_LIBRARY_PATH AMENT_PREFIX_PATH CMAKE_PREFIX_PATH
unexport COLCON_PREFIX_PATH ROS_DISTRO ROS_LOCALHOST_ONLY

# Nodes of one run talk among themselves and on this machine only, through the one middleware that
# comes as wheels; its profile says itself what it is for.
run_environment = \
	ROS_DOMAIN_ID=$$(( $$$$ % 100 + 1 )) \
	ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST \
	ROS_LOG_DIR="$(CURDIR)/build/ros_log" \
	RMW_IMPLEMENTATION=rmw_fastrtps_cpp \
	FASTRTPS_DEFAULT_PROFILES_FILE="$(CURDIR)/.venv/share/intuitive_physics_bringup/config/fastdds_profile.xml"

# Open3D brings dash, whose pytest plug-in serves nothing here and warns in every run.
pytest = .venv/bin/pytest -p no:dash

# Tests of libraries, and of one node each, share nothing but the machine: files of them run side by
# side, in the order of conftest.py. The long ones of the whole system have it for themselves.
one_thread = OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
side_by_side = --maxprocesses=4 --dist=loadfile --no-loadscope-reorder

# Tests of nodes wait most of the time.
node_workers = $(shell echo $$(( $$(nproc) + 1 )))

# One that waits in the middleware for ever, with Python's lock, its own time-out cannot end: after
# 450 s its process ends, and another one goes on.
no_hang = --max-worker-restart=2 -o faulthandler_timeout=450 -o faulthandler_exit_on_timeout=true

python_packages = $(dir $(wildcard src/*/setup.py))
node_tests = $(wildcard src/*/test/nodes)
ros_packages = src/intuitive_physics_ros src/intuitive_physics_bringup
library_tests = $(addsuffix test,$(filter-out $(addsuffix /,$(ros_packages)),$(python_packages))) \
	$(addprefix --ignore=,$(node_tests))

help: ## List the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-16s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

setup: ## Make .venv and build the messages; the others do it when needed
	@tools/setup.sh

lint: setup ## Only check style, imports and types, and build the documentation
	@echo "── lint"
	@.venv/bin/ruff check .
	@.venv/bin/ruff format --check --quiet . || { .venv/bin/ruff format --diff --quiet . ; exit 1; }
	@.venv/bin/lint-imports --no-logo --no-cache > build/imports.log || { cat build/imports.log ; exit 1; }
	@$(MAKE) --no-print-directory types docs

types: ## Only check types, with the environment as it is
	@MYPYPATH=$(subst $(eval ) ,:,$(python_packages)) .venv/bin/mypy --namespace-packages \
		$(foreach package,$(python_packages),$(package)$(notdir $(package:/=))) benchmarks tools

docs: setup ## Build the documentation site into docs/_build/html; warnings are errors
	@echo "── docs"
	@.venv/bin/python -m sphinx -W --keep-going -q -b html docs docs/_build/html
	@echo "docs/_build/html/index.html"

test: setup ## Lint, test the libraries, test the nodes and the whole system
	@failed=; for stage in lint library-tests system-tests; do \
		$(MAKE) --no-print-directory $$stage || failed="$$failed $$stage"; \
	done; \
	if [ -n "$$failed" ]; then echo "failed:$$failed"; exit 1; fi; \
	echo "all tests passed"

library-tests: setup ## Only test what knows nothing of ROS; only=needs for those with this mark
	@echo "── library tests"
	@$(one_thread) $(pytest) --numprocesses=auto $(side_by_side) $(library_tests) $(if $(only),-m "$(only)") $(options)

system-tests: setup ## Only test nodes, as processes that talk over DDS; only=needs as well
	@echo "── system tests"
	@failed=0; \
	$(run_environment) $(pytest) --numprocesses=$(node_workers) $(side_by_side) $(no_hang) $(addsuffix /test,$(ros_packages)) $(node_tests) test \
		-m "$(if $(only),$(only) and )not long" $(options) || failed=1; \
	$(run_environment) $(pytest) test -m "$(if $(only),$(only) and )long" $(options) || failed=1; \
	exit $$failed

test-oldest: ## Test the libraries with the versions of Ubuntu 24.04, in build/oldest
	@tools/system_packages.sh && tools/oldest.sh
	@$(one_thread) build/oldest/venv/bin/pytest -p no:dash --numprocesses=auto $(side_by_side) $(library_tests)

demo: setup ## Perceive, learn from and predict thrown balls; write a report
	@$(run_environment) .venv/bin/python -m intuitive_physics_experiments.demo

bench-simulation: setup ## Race our simulators against other engines; options="--quick"
	@tools/bench_packages.sh
	@.venv/bin/python -m benchmarks.simulation $(options)

bench-learning: setup ## Learners on the paper's synthetic sets beside the oracle; options="--quick"
	@tools/bench_packages.sh emcee
	@.venv/bin/python -m benchmarks.learning $(options)

bench-prediction: setup ## Race the predictor node against its clock; options="--quick"
	@tools/bench_packages.sh || echo "benchmarks: goes on without ODE"
	@$(run_environment) .venv/bin/python -m benchmarks.prediction $(options)

bench-perception: setup ## Hold perception against the truth and against others; options="--quick"
	@.venv/bin/python -m pip --disable-pip-version-check install -qq -r requirements/bench.txt
	@$(run_environment) OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1 \
		.venv/bin/python -m benchmarks.perception $(options)

bench-flights: setup ## Estimate recorded spins beside a filter of robots; options="--quick"
	@.venv/bin/python -m benchmarks.flights $(options)

bench-robot: setup ## Start, kill and stop the suite by the real ros2; options="--quick"
	@$(run_environment) .venv/bin/python -m benchmarks.robot $(options)

torture: setup ## Kill, fuzz, starve and soak the nodes; options="--quick"
	@$(run_environment) .venv/bin/python -m benchmarks.torture $(options)

clean: ## Remove the environment and everything built
	rm -rf .venv build log install demo_output docs/_build docs/reference .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find src -name __pycache__ | xargs rm -rf
