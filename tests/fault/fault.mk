# SPDX-License-Identifier: Apache-2.0
# Fault injection: a preloaded library makes the n-th call fail, programs in Python sweep n.
# Included by tests/module.mk. Sanitizers cannot be preloaded over: debug and release builds only.
FAULT_OBJ := $(patsubst %.c,$(BUILD)/%.o,$(wildcard tests/fault/inject*.c))
FAULT_TESTS := $(sort $(wildcard tests/fault/test_*.py))
FAULT_NEEDS := $(BUILD)/inject.so $(BUILD)/open_jobs $(addprefix $(BUILD)/,umbrage umbraged umbrage-bake umbrage-study scenegen)
fault-needs: $(FAULT_NEEDS)
.PHONY: fault-needs

# The functions are defined under both names, so the compiler must not rename one to the other, nor
# optimise calls of malloc by what it knows of them.
$(FAULT_OBJ): INC_tests += -U_FILE_OFFSET_BITS -U_FORTIFY_SOURCE -fno-builtin

$(BUILD)/inject.so: $(FAULT_OBJ)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) -shared $^ -ldl -o $@

# The job service on a folder, for images of power cuts.
$(BUILD)/open_jobs: $(BUILD)/tests/fault/open_jobs.o $(TEST_LIBS_jobs)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(TEST_SYS_jobs) -o $@

power-cuts: $(FAULT_NEEDS) ## every state of the disk after a power cut in a recorded run
	@BUILD=$(BUILD) /usr/bin/python3 tests/fault/test_power_cuts.py

fault: $(FAULT_NEEDS) ## make every n-th call fail: disk, memory, kill (debug or release)
	@for t in $(FAULT_TESTS); do echo "== $$t"; BUILD=$(BUILD) /usr/bin/python3 $$t || exit 1; done

fault-short: $(FAULT_NEEDS) ## the same with fewer points
	@BUILD=$(BUILD) FAULT=short $(RUN) $(FAULT_TESTS)

.PHONY: power-cuts fault fault-short
