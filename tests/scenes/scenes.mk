# SPDX-License-Identifier: Apache-2.0
# Generated test scenes: the scenegen program, and its makers for the tests that check them.
# Included by tests/module.mk after the unit tests.
INC_tests += -Itests/scenes

GEN_OBJ := $(patsubst %.c,$(BUILD)/%.o,$(wildcard tests/scenes/gen_*.c))

$(BUILD)/scenegen: $(BUILD)/tests/scenes/scenegen.o $(GEN_OBJ) $(CORE_LIB)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(CORE_LIBS) -o $@

$(BUILD)/tests/unit/scene/test_parts_scenes $(addprefix $(BUILD)/tests/unit/rays/test_,verify exact_rays): $(GEN_OBJ)

scenegen: $(BUILD)/scenegen ## scenegen: writes generated test scenes
.PHONY: scenegen
