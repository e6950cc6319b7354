# SPDX-License-Identifier: Apache-2.0
# Which lines and branches the tests run, counted by gcc (tests/coverage/coverage_table.py says how).
#
#   COVERAGE=daemon   unit tests of the daemon and the tests of COVERAGE_daemon alone
#
# EXEMPT=1 lets bakes and importers run without their sandbox, as in sanitizer builds: its filter kills
# a process that writes its counts. Processes that are killed leave no counts; those that drain do, and
# those that call __gcov_dump before they end at once (test_simulation.c).
COVERAGE ?= all
COVERAGE_BUILD := build/cov
COVERAGE_CFLAGS := --coverage -fprofile-update=atomic -DEXEMPT=1
COVERAGE_daemon := $(sort $(wildcard tests/interop/test_*)) tests/fault/test_fault_calls.py \
	$(patsubst %,tests/system/test_%,admin_port.py attacks.py bake_calls.py cli.sh derive.py descriptors.py drain.py occluder_depth.sh \
	hostile_peers.py idle_peers.py job_owners.py job_place.py job_tiles.py jobs.py load.py private_files.py service_manager.py \
	signals.py slow_servers.py slurm_executor.py store.py store_damage.py submit.py transmittance.sh without_token.py)
COVERAGE_all := $(COVERAGE_daemon) $(patsubst %,tests/system/test_%,dial.sh examples.py light_products.py \
	lights.sh lying_server.py oracle.sh pictures.sh scenes.sh spots.sh static.sh paging.py study.sh techniques.py tiles.py)
COVERAGE_UNITS_all = $(UNIT_TESTS)
COVERAGE_UNITS_daemon = $(UNIT_BIN_daemon)

coverage: ## lines and branches that the tests run (COVERAGE=daemon: its part): half an hour
	@$(MAKE) --no-print-directory -j$(CORES) config=debug werror= BUILD=$(COVERAGE_BUILD) \
		CFLAGS="$(CFLAGS) $(COVERAGE_CFLAGS)" LDFLAGS="$(LDFLAGS) --coverage -Wl,-u,__gcov_dump" coverage-one

coverage-one: $(COVERAGE_UNITS_$(COVERAGE)) $(PROGRAMS) $(BUILD)/scenegen $(BUILD)/intruder.so $(BUILD)/inject.so \
		$(BUILD)/open_jobs $(BUILD)/oracle_check $(BUILD)/light_products $(BUILD)/interop/umbraged $(BUILD)/interop/wire_echo
	@find $(BUILD) -name '*.gcda' -delete
	@BUILD=$(BUILD) FAULT=short TEST_ATTEMPTS=$(or $(TEST_ATTEMPTS),2) $(RUN) $(COVERAGE_UNITS_$(COVERAGE)) $(COVERAGE_$(COVERAGE)) || \
		echo "coverage: a test failed; what it did not reach counts as not run"
	@/usr/bin/python3 tests/coverage/coverage_table.py $(BUILD)

.PHONY: coverage coverage-one
