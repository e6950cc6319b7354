# SPDX-License-Identifier: Apache-2.0
# Generated protobuf-c code stays in build/; the wire library turns it into plain structs.
INC_proto = -Iclient/include -Iclient/core -Iproto -I$(BUILD)/gen

PROTO_SRC := $(sort $(wildcard proto/umbrage/v1/*.proto)) proto/grpc/health/v1/health.proto \
	proto/grpc/reflection/v1/reflection.proto
PROTO_GEN_C := $(PROTO_SRC:proto/%.proto=$(BUILD)/gen/%.pb-c.c)
PROTO_GEN_O := $(PROTO_GEN_C:.c=.o)
WIRE_C_OBJ := $(patsubst %.c,$(BUILD)/%.o,$(sort $(wildcard proto/grpc/*.c proto/wire/*.c)))
WIRE_OBJ := $(WIRE_C_OBJ) $(PROTO_GEN_O) $(BUILD)/gen/descriptor_set.o
WIRE_LIB := $(BUILD)/libumbrage-wire.a
WIRE_LIBS := -lprotobuf-c -lz

$(BUILD)/gen/%.pb-c.c $(BUILD)/gen/%.pb-c.h &: proto/%.proto
	@mkdir -p $(@D)
	$(call say,PROTOC,$<)
	$(Q)protoc-c -Iproto --c_out=$(BUILD)/gen $<

# The descriptors of all .proto files as an array of bytes in C; the service of server reflection
# sends them.
PROTO_ALPHA := $(BUILD)/gen/alpha/grpc/reflection/v1alpha/reflection.proto
$(BUILD)/gen/descriptor_set.c: $(PROTO_SRC)
	@mkdir -p $(dir $(PROTO_ALPHA))
	$(call say,PROTOC,$@)
	$(Q)sed 's/^package grpc\.reflection\.v1;/package grpc.reflection.v1alpha;/' \
		proto/grpc/reflection/v1/reflection.proto >$(PROTO_ALPHA)
	$(Q)protoc -Iproto -I$(BUILD)/gen/alpha --descriptor_set_out=$(@:.c=.bin) $(PROTO_SRC) $(PROTO_ALPHA)
	$(Q){ echo '#include "wire/messages.h"'; echo 'const uint8_t umbw__descriptor_set[] = {'; \
		od -An -v -tu1 $(@:.c=.bin) | sed 's/  */,/g; s/^,//; s/$$/,/'; echo '};'; \
		echo 'const size_t umbw__descriptor_set_bytes = sizeof umbw__descriptor_set;'; } >$@

$(BUILD)/gen/descriptor_set.o: $(BUILD)/gen/descriptor_set.c
	$(call say,CC,$<)
	$(Q)$(CC) $(CFLAGS_ALL) $(INC_proto) -c $< -o $@

$(BUILD)/gen/%.pb-c.o: $(BUILD)/gen/%.pb-c.c
	$(call say,CC,$<)
	$(Q)$(CC) $(CFLAGS_ALL) -Wno-conversion -Wno-shadow -I$(BUILD)/gen -c $< -o $@

$(WIRE_C_OBJ): | $(PROTO_GEN_C)
$(WIRE_LIB): $(WIRE_OBJ)
# Addresses and TLS: part of the client library and of the daemon. Requests of HTTP: of the daemon and of `umbrage view`.
NET_OBJ := $(patsubst %.c,$(BUILD)/%.o,$(sort $(wildcard proto/net/*.c)))
HTTP1_OBJ := $(filter %/http1_request.o %/http1_fields.o,$(NET_OBJ))
$(RPC_LIB) $(call both,libumbrage): $(filter-out $(HTTP1_OBJ),$(NET_OBJ))
$(CLI_LIB): $(HTTP1_OBJ)
# Installed libraries contain the wire library's objects, so it is not installed itself. Only
# servers decompress requests (gunzip).
$(RPC_LIB): $(filter-out %/gunzip.o,$(WIRE_OBJ))

wire: $(WIRE_LIB) ## the wire library alone
.PHONY: wire
