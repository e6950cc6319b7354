# SPDX-License-Identifier: Apache-2.0
# Every tests/unit/PART/test_*.c is a cmocka program of its own, linked with PART's libraries only.
INC_tests = -Iclient/include -Iclient/core -Iproto -Iserver -Itests/harness -Itests/oracle -I$(BUILD)/gen

HARNESS_OBJ := $(patsubst %.c,$(BUILD)/%.o,$(wildcard tests/harness/*.c))

TEST_LIBS_core   = $(CORE_LIB)
TEST_LIBS_wire   = $(WIRE_LIB) $(CORE_LIB)
TEST_LIBS_rpc    = $(RPC_LIB) $(WIRE_LIB) $(CORE_LIB)
TEST_LIBS_common = $(COMMON_LIB) $(CORE_LIB)
TEST_LIBS_rays   = $(RAYS_LIB) $(COMMON_LIB) $(CORE_LIB)
TEST_LIBS_bake   = $(BAKE_LIB) $(RAYS_LIB) $(COMMON_LIB) $(CORE_LIB)
TEST_LIBS_daemon = $(DAEMON_LIB) $(COMMON_LIB) $(WIRE_LIB) $(CORE_LIB)
TEST_SYS_core   = $(CORE_LIBS) -lcrypto
TEST_SYS_wire   = -lprotobuf-c $(CORE_LIBS)
TEST_SYS_rpc    = $(RPC_LIBS) $(CORE_LIBS)
TEST_SYS_common = -luv -lcrypto $(CORE_LIBS)
TEST_SYS_rays   = -lembree3 -lcrypto $(CORE_LIBS)
TEST_SYS_bake   = -lembree3 -lassimp -lcrypto $(CORE_LIBS)
TEST_SYS_daemon = -luv -lnghttp2 -lprotobuf-c -lcrypto $(CORE_LIBS)

UNIT_PARTS := core wire rpc common rays bake daemon
UNIT_TESTS :=

define unit_part
UNIT_BIN_$(1) := $$(patsubst %.c,$$(BUILD)/%,$$(wildcard tests/unit/$(1)/test_*.c))
UNIT_TESTS += $$(UNIT_BIN_$(1))
$$(UNIT_BIN_$(1)): $$(BUILD)/%: $$(BUILD)/%.o $$(HARNESS_OBJ) $$(TEST_LIBS_$(1))
	$$(CC) $$(LDFLAGS_ALL) $$^ $$(TEST_SYS_$(1)) -lcmocka -o $$@
unit-$(1): $$(UNIT_BIN_$(1))
	@for t in $$(UNIT_BIN_$(1)); do echo "== $$$$t"; timeout 300 $$$$t || exit 1; done
.PHONY: unit-$(1)
endef
$(foreach part,$(UNIT_PARTS),$(eval $(call unit_part,$(part))))
