# SPDX-License-Identifier: Apache-2.0
# The independent oracle: a second reader of the file formats, and the program that compares every
# voxel of a bake with its scene. Links nothing of umbrage. Included by tests/module.mk.
ORACLE_READER_OBJ := $(patsubst %,$(BUILD)/tests/oracle/oracle_%.o,reader head packed page tree mapped occluder_depth transmittance receiver_mask)
ORACLE_DEPTH_OBJ := $(patsubst %,$(BUILD)/tests/oracle/oracle_%.o,scene closed depth)

$(BUILD)/oracle_check: $(BUILD)/tests/oracle/oracle_check.o $(ORACLE_READER_OBJ) $(ORACLE_DEPTH_OBJ)
	$(CC) $(LDFLAGS_ALL) $^ -lzstd -lxxhash -lcrypto -lm -o $@

$(BUILD)/tests/unit/core/test_oracle $(BUILD)/tests/unit/core/test_transmittance $(BUILD)/tests/unit/core/test_receiver_mask: $(ORACLE_READER_OBJ)
$(BUILD)/tests/unit/core/test_oracle_depth: $(ORACLE_DEPTH_OBJ)

oracle_check: $(BUILD)/oracle_check ## oracle_check: compares every voxel of a bake with its scene
.PHONY: oracle_check
