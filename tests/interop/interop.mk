# SPDX-License-Identifier: Apache-2.0
# umbraged with the service that the gRPC project's interop clients call, for tests only.
INTEROP := tests/interop/service
INTEROP_OBJ := $(BUILD)/interop/interop_service.o $(BUILD)/interop/interop_test.pb-c.o

$(BUILD)/gen/interop_test.pb-c.c $(BUILD)/gen/interop_test.pb-c.h &: $(INTEROP)/interop_test.proto
	@mkdir -p $(@D)
	$(call say,GEN,$@)
	$(Q)protoc-c -I$(INTEROP) --c_out=$(BUILD)/gen $<

# Generated code is compiled as it comes.
$(BUILD)/interop/interop_test.pb-c.o: $(BUILD)/gen/interop_test.pb-c.c
	@mkdir -p $(@D)
	$(call say,CC,$<)
	$(Q)$(CC) $(filter-out -W%,$(CFLAGS_ALL)) -I$(BUILD)/gen -c $< -o $@

$(BUILD)/interop/interop_service.o: $(INTEROP)/interop_service.c | $(BUILD)/gen/interop_test.pb-c.h $(PROTO_GEN_C)
	@mkdir -p $(@D)
	$(call say,CC,$<)
	$(Q)$(CC) $(CFLAGS_ALL) $(INC_server) -c $< -o $@

$(BUILD)/interop/umbraged: $(INTEROP_OBJ) $(DAEMON_LIB) $(JOBS_LIB) $(STORE_LIB) $(COMMON_LIB) $(TOOL_LIB) $(WIRE_LIB) $(MAPS_LIB) $(CORE_LIB)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ -lsqlite3 -luv -lnghttp2 $(WIRE_LIBS) -lssl $(COMMON_LIBS) -linih $(CORE_LIBS) -o $@

# Decodes and encodes messages, for test_wire.py.
$(BUILD)/interop/wire_echo.o: $(INTEROP)/wire_echo.c
	@mkdir -p $(@D)
	$(call say,CC,$<)
	$(Q)$(CC) $(CFLAGS_ALL) $(INC_server) -c $< -o $@

$(BUILD)/interop/wire_echo: $(BUILD)/interop/wire_echo.o $(WIRE_LIB) $(MAPS_LIB) $(CORE_LIB)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(WIRE_LIBS) $(CORE_LIBS) -o $@
