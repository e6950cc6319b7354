# SPDX-License-Identifier: Apache-2.0
# Fuzz targets. `make fuzz T=600` runs each for T seconds with clang's libFuzzer under ASan and UBSan;
# `make check` replays seeds and past crashers without a fuzzer (tests/fuzz/seeds, tests/fuzz/regress).
INC_FUZZ := $(INC_tests) -Itests/fuzz
FUZZ_TARGETS := $(patsubst tests/fuzz/%.c,%,$(filter-out tests/fuzz/fuzz_replay.c,$(wildcard tests/fuzz/fuzz_*.c)))
FUZZ_REPLAYS := $(FUZZ_TARGETS:%=$(BUILD)/tests/fuzz/replay_%)
FUZZ_LIVES := $(FUZZ_TARGETS:%=$(BUILD)/tests/fuzz/live_%)

# What a target links; those that are not named have the first.
FUZZ_LIBS = $(BAKE_LIB) $(RAYS_LIB) $(SCENE_LIB) $(COMMON_LIB) $(TOOL_LIB) $(WIRE_LIB) $(MAPS_LIB) $(CORE_LIB)
FUZZ_SYS = -lembree3 -ljansson -lpng $(WIRE_LIBS) $(COMMON_LIBS) $(CORE_LIBS)
FUZZ_LIBS_fuzz_bakes = $(JOBS_LIB) $(COMMON_LIB) $(TOOL_LIB) $(WIRE_LIB) $(MAPS_LIB) $(CORE_LIB)
FUZZ_SYS_fuzz_bakes = -lsqlite3 $(WIRE_LIBS) $(COMMON_LIBS) $(CORE_LIBS)
FUZZ_LIBS_fuzz_farm = $(FUZZ_LIBS_fuzz_bakes)
FUZZ_SYS_fuzz_farm = $(FUZZ_SYS_fuzz_bakes)
FUZZ_LIBS_fuzz_bundle = $(BAKE_LIB) $(RAYS_LIB) $(SCENE_LIB) $(COMMON_LIB) $(CLI_LIB) $(TOOL_LIB) $(RPC_LIB) $(MAPS_LIB) $(CORE_LIB)
FUZZ_SYS_fuzz_bundle = -lembree3 -ljansson -lpng $(COMMON_LIBS) $(CLI_LIBS) $(RPC_LIBS) $(CORE_LIBS)
FUZZ_LIBS_fuzz_changes = $(CORE_LIB)
FUZZ_SYS_fuzz_changes = $(CORE_LIBS)
FUZZ_LIBS_fuzz_config = $(TEST_LIBS_daemon)
FUZZ_SYS_fuzz_config = $(TEST_SYS_daemon)
FUZZ_LIBS_fuzz_conn = $(TEST_LIBS_daemon)
FUZZ_SYS_fuzz_conn = $(TEST_SYS_daemon)
FUZZ_LIBS_fuzz_derive = $(WIRE_LIB) $(MAPS_LIB) $(CORE_LIB)
FUZZ_SYS_fuzz_derive = $(WIRE_LIBS) $(CORE_LIBS)
FUZZ_LIBS_fuzz_http1 = $(TEST_LIBS_daemon)
FUZZ_SYS_fuzz_http1 = $(TEST_SYS_daemon)
FUZZ_LIBS_fuzz_reply = $(RPC_LIB) $(CORE_LIB)
FUZZ_SYS_fuzz_reply = $(RPC_LIBS) $(CORE_LIBS)

# What CI fuzzes with coverage guidance.
FUZZ_CI := $(addprefix fuzz_,bakes bundle changes config conn derive farm geometry http1 readers reply want)
# Words of what a target takes.
FUZZ_WORDS := $(addprefix fuzz_,bakes conn derive reply wire)
fuzz_words = $(if $(filter $(1),$(FUZZ_WORDS)),-dict=tests/fuzz/protobuf.dict) \
	$(if $(filter $(1),fuzz_config),-dict=tests/fuzz/config.dict) \
	$(if $(filter $(1),fuzz_http1),-dict=tests/fuzz/http.dict)
FUZZ_RUN = -timeout=10 -rss_limit_mb=2048 -print_final_stats=1
T_CI ?= 120
T ?= 60

$(BUILD)/tests/fuzz/%.o: tests/fuzz/%.c
	@mkdir -p $(@D)
	$(call say,CC,$<)
	$(Q)$(CC) $(CFLAGS_ALL) $(INC_FUZZ) -c $< -o $@

# They walk through the array for a GPU as shaders do.
$(BUILD)/tests/fuzz/fuzz_asset.o $(BUILD)/tests/fuzz/fuzz_partial.o: $(GPU_DIR)/umbrage.cuh
$(BUILD)/tests/fuzz/fuzz_asset.o $(BUILD)/tests/fuzz/fuzz_partial.o: INC_FUZZ += -I$(GPU_DIR)

define fuzz_target
$(BUILD)/tests/fuzz/replay_$(1): $(BUILD)/tests/fuzz/$(1).o $(BUILD)/tests/fuzz/fuzz_replay.o $$(HARNESS_OBJ) $(or $(FUZZ_LIBS_$(1)),$(FUZZ_LIBS))
	$$(call say,LD,$$@)
	$$(Q)$$(CC) $$(LDFLAGS_ALL) $$^ $(or $(FUZZ_SYS_$(1)),$(FUZZ_SYS)) -o $$@
$(BUILD)/tests/fuzz/live_$(1): $(BUILD)/tests/fuzz/$(1).o $$(HARNESS_OBJ) $(or $(FUZZ_LIBS_$(1)),$(FUZZ_LIBS))
	$$(call say,LD,$$@)
	$$(Q)$$(CC) $$(LDFLAGS_ALL) -fsanitize=fuzzer $$^ $(or $(FUZZ_SYS_$(1)),$(FUZZ_SYS)) -lstdc++ -o $$@
endef
$(foreach target,$(FUZZ_TARGETS),$(eval $(call fuzz_target,$(target))))

# One after the other, T seconds each.
fuzz-live: $(FUZZ_LIVES)
	@for t in $(FUZZ_TARGETS); do \
		$(MAKE) --no-print-directory T_CI=$(T) fuzz-one-$$t || exit 1; done

# One target for T_CI seconds.
fuzz-one-%:
	@mkdir -p $(BUILD)/corpus/$*; \
	$(BUILD)/tests/fuzz/live_$* -max_total_time=$(T_CI) $(FUZZ_RUN) $(call fuzz_words,$*) \
		-artifact_prefix=$(BUILD)/corpus/crash-$*- $(BUILD)/corpus/$* $(wildcard tests/fuzz/seeds/$* tests/fuzz/regress/$*) \
		2>$(BUILD)/corpus/$*.log || { echo "FAILED $*"; tail -n 40 $(BUILD)/corpus/$*.log; exit 1; }; \
	echo "ok $*: $$(sed -n 's/^stat::number_of_executed_units: *//p' $(BUILD)/corpus/$*.log) executions," \
		"$$(sed -n 's/^stat::new_units_added: *//p' $(BUILD)/corpus/$*.log) new to it, in $(T_CI) s"
FUZZ_CLANG = CC=clang config=asan BUILD=build/fuzz CFLAGS="-O2 -fsanitize=fuzzer-no-link"
HAS_FUZZER = echo 'int LLVMFuzzerTestOneInput(const char *b, long n) { (void)b; (void)n; return 0; }' | \
	clang -fsanitize=fuzzer,address,undefined -x c - -o /dev/null 2>/dev/null
fuzz: ## fuzz every target for T seconds (clang)
	@$(MAKE) --no-print-directory -j$(CORES) $(FUZZ_CLANG) fuzz-live

# The targets of one run of CI: as many of FUZZ_CI as there are processors. The commit's hash
# chooses them; FUZZ_TURN=0, 1, 2 ... chooses one group after the other. FUZZ_NOW=all: all targets.
FUZZ_TURN ?= $(shell printf '%d' 0x$$(git rev-parse --short=7 HEAD 2>/dev/null || echo 0))
ifndef FUZZ_NOW
FUZZ_NOW := $(shell echo $(FUZZ_CI) | awk -v turn=$(FUZZ_TURN) -v each=$(CORES) \
	'{ turns = int((NF + each - 1) / each); for (i = (turn % turns) * each; i < NF && i < (turn % turns + 1) * each; i++) print $$(i + 1) }')
endif
FUZZ_TAKEN = $(if $(filter all,$(FUZZ_NOW)),$(FUZZ_CI),$(FUZZ_NOW))
fuzz-ci-live: $(FUZZ_TAKEN:%=$(BUILD)/tests/fuzz/live_%)
	@echo "fuzzes $(FUZZ_TAKEN), $(words $(FUZZ_TAKEN)) of $(words $(FUZZ_CI))"
	@$(MAKE) --no-print-directory $(FUZZ_TAKEN:%=fuzz-one-%)

fuzz-ci: ## fuzz a turn of the targets of FUZZ_CI (FUZZ_NOW=all: all) for T_CI seconds (120) each
	@if $(HAS_FUZZER); then $(MAKE) --no-print-directory -j$(CORES) $(FUZZ_CLANG) fuzz-ci-live; \
	else for t in $(FUZZ_TAKEN); do echo "skipped $$t: clang has no libFuzzer here"; done; fi

# The same build, so that one compilation serves both.
sanitize-clang: ## unit tests, past crashers and a serving daemon by clang under ASan and UBSan
	@if $(HAS_FUZZER); then UMBRAGE_SHORT=1 $(MAKE) --no-print-directory -j$(CORES) $(FUZZ_CLANG) sanitize-one; \
	elif command -v clang >/dev/null; then $(MAKE) --no-print-directory -j$(CORES) CC=clang BUILD=build/clang check; \
	else echo "skipped: clang is not installed (make deps-full installs it)"; fi

fuzz-replay: $(FUZZ_REPLAYS) ## seeds and past crashers of every target, and changes of them
	@BUILD=$(BUILD) $(RUN) $(FUZZ_REPLAYS)

.PHONY: fuzz fuzz-live fuzz-ci fuzz-ci-live fuzz-replay sanitize-clang
