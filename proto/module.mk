# SPDX-License-Identifier: Apache-2.0
# Generated protobuf-c code stays in build/; the wire library turns it into plain structs.
INC_proto = -Iclient/include -Iclient/core -Iproto -I$(BUILD)/gen

PROTO_SRC := $(wildcard proto/umbrage/v1/*.proto) proto/grpc/health/v1/health.proto
PROTO_GEN_C := $(PROTO_SRC:proto/%.proto=$(BUILD)/gen/%.pb-c.c)
PROTO_GEN_O := $(PROTO_GEN_C:.c=.o)
WIRE_OBJ := $(patsubst %.c,$(BUILD)/%.o,$(wildcard proto/wire/*.c)) $(PROTO_GEN_O)
WIRE_LIB := $(BUILD)/libumbrage-wire.a

$(BUILD)/gen/%.pb-c.c $(BUILD)/gen/%.pb-c.h &: proto/%.proto
	@mkdir -p $(@D)
	$(call say,PROTOC,$<)
	$(Q)protoc-c -Iproto --c_out=$(BUILD)/gen $<

$(BUILD)/gen/%.pb-c.o: $(BUILD)/gen/%.pb-c.c
	$(call say,CC,$<)
	$(Q)$(CC) $(CFLAGS_ALL) -Wno-conversion -Wno-shadow -I$(BUILD)/gen -c $< -o $@

$(patsubst %.c,$(BUILD)/%.o,$(wildcard proto/wire/*.c)): | $(PROTO_GEN_C)
$(WIRE_LIB): $(WIRE_OBJ)

wire: $(WIRE_LIB) ## the wire library alone
.PHONY: wire
