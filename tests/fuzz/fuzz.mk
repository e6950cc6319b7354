# SPDX-License-Identifier: Apache-2.0
# Fuzz targets. `make fuzz T=600` runs each for T seconds with clang's libFuzzer under ASan and UBSan;
# `make check` replays seeds and past crashers without a fuzzer (tests/fuzz/seeds, tests/fuzz/regress).
INC_FUZZ := $(INC_tests) -Itests/fuzz
FUZZ_TARGETS := $(patsubst tests/fuzz/%.c,%,$(filter-out tests/fuzz/fuzz_replay.c,$(wildcard tests/fuzz/fuzz_*.c)))
FUZZ_REPLAYS := $(FUZZ_TARGETS:%=$(BUILD)/tests/fuzz/replay_%)
FUZZ_LIBS = $(BAKE_LIB) $(RAYS_LIB) $(COMMON_LIB) $(WIRE_LIB) $(CORE_LIB)
FUZZ_SYS = -lembree3 -lassimp -lpng $(WIRE_LIBS) $(COMMON_LIBS) $(CORE_LIBS)
T ?= 60

$(BUILD)/tests/fuzz/%.o: tests/fuzz/%.c
	@mkdir -p $(@D)
	$(call say,CC,$<)
	$(Q)$(CC) $(CFLAGS_ALL) $(INC_FUZZ) -c $< -o $@

$(FUZZ_REPLAYS): $(BUILD)/tests/fuzz/replay_%: $(BUILD)/tests/fuzz/%.o $(BUILD)/tests/fuzz/fuzz_replay.o $(HARNESS_OBJ) $(FUZZ_LIBS)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(FUZZ_SYS) -o $@

$(BUILD)/tests/fuzz/live_%: $(BUILD)/tests/fuzz/%.o $(HARNESS_OBJ) $(FUZZ_LIBS)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) -fsanitize=fuzzer $^ $(FUZZ_SYS) -lstdc++ -o $@

fuzz-live: $(FUZZ_TARGETS:%=$(BUILD)/tests/fuzz/live_%)
	@for t in $(FUZZ_TARGETS); do \
		mkdir -p $(BUILD)/corpus/$$t tests/fuzz/seeds/$$t tests/fuzz/regress/$$t; \
		echo "== $$t for $(T) s"; \
		$(BUILD)/tests/fuzz/live_$$t -max_total_time=$(T) -timeout=10 -rss_limit_mb=2048 -print_final_stats=1 \
			-artifact_prefix=$(BUILD)/corpus/crash-$$t- $(BUILD)/corpus/$$t tests/fuzz/seeds/$$t tests/fuzz/regress/$$t \
			2>$(BUILD)/corpus/$$t.log || { tail -n 40 $(BUILD)/corpus/$$t.log; exit 1; }; \
		grep -E 'stat::(number_of_executed_units|new_units_added|peak_rss_mb)' $(BUILD)/corpus/$$t.log; \
	done

fuzz: ## fuzz every target for T seconds (clang)
	@$(MAKE) --no-print-directory -j$(CORES) CC=clang config=asan BUILD=build/fuzz CFLAGS=-fsanitize=fuzzer-no-link fuzz-live

fuzz-replay: $(FUZZ_REPLAYS)
	@for t in $(FUZZ_TARGETS); do $(BUILD)/tests/fuzz/replay_$$t $$(for d in seeds regress; do [ -d tests/fuzz/$$d/$$t ] && echo tests/fuzz/$$d/$$t; done) || exit 1; done

.PHONY: fuzz fuzz-live fuzz-replay
