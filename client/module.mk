# SPDX-License-Identifier: Apache-2.0
# libumbrage-core (pure), libumbrage-maps on top of it, libumbrage (rpc), the toolbox of the programs and
# the umbrage command.
INC_client = -Iclient/include -Iclient/core -Iclient -Iproto -I$(BUILD)/gen

MAPS_SRC := $(sort $(wildcard client/core/maps/*.c))
MAPS_OBJ := $(MAPS_SRC:%.c=$(BUILD)/%.o)
MAPS_LIB := $(BUILD)/libumbrage-maps.a
# Kernels of WebAssembly are compiled by client/web alone.
CORE_SRC := $(filter-out $(MAPS_SRC) %_simd128.c,$(sort $(wildcard client/core/*/*.c)))
CORE_OBJ := $(CORE_SRC:%.c=$(BUILD)/%.o)
CORE_LIB := $(BUILD)/libumbrage-core.a
ifeq ($(config),release)
# The kernels' inner loops are short: unrolled they take a third less.
$(patsubst %,$(BUILD)/client/core/query/kernel_%.o,base avx2 avx512): CFLAGS_ALL += -O3 -funroll-loops
# Loops over receivers take roots, which compilers vectorise only if errno is not wanted.
$(patsubst %,$(BUILD)/client/core/query/kernel_squares_%.o,base avx2 avx512): CFLAGS_ALL += -O3 -fno-math-errno
endif
# Queries keep points, windows and answers in arrays on the stack, which they fill themselves: set to
# zero first, they cost 3 to 13 % of the instructions.
$(BUILD)/client/core/query/%.o $(BUILD)/client/core/partial/partial_query.o: CFLAGS_ALL += $(if $(filter -ftrivial%,$(HARDEN_CFLAGS)),-ftrivial-auto-var-init=uninitialized)
# A window's walk enters a function a square, whose two words on the stack the stack protector would
# check each time: 4 % of a penumbra query. It indexes no array by anything that comes from a file.
$(BUILD)/client/core/query/slice_count.o: CFLAGS_ALL += $(if $(HARDEN_CFLAGS),-fno-stack-protector)
$(BUILD)/client/core/query/kernel_avx512.o $(BUILD)/client/core/query/kernel_squares_avx512.o: AVX512_FLAGS := $(if $(AVX512_FLAGS),$(AVX2_FLAGS) $(filter -m%,$(AVX512_FLAGS)) -mavx512cd)
CORE_LIBS := -lxxhash -lzstd -lm

RPC_OBJ := $(patsubst %.c,$(BUILD)/%.o,$(sort $(wildcard client/rpc/*.c)))
RPC_LIB := $(BUILD)/libumbrage.a
RPC_LIBS = -luv -lnghttp2 $(WIRE_LIBS) -lssl -lcrypto

# What the four programs share; sees the public headers and base only.
TOOL_OBJ := $(patsubst %.c,$(BUILD)/%.o,$(sort $(wildcard client/tool/*.c)))
TOOL_LIB := $(BUILD)/libumbrage-tool.a

# Shared libraries for other programs; ours link the archives. A library exports what its list in
# client/exports names, and nothing else of it can be seen. Calls within a library are direct.
EXPORTS := umbrage umbrage-core umbrage-maps
SHARED_LIBS := $(if $(filter release debug,$(config)),$(EXPORTS:%=$(BUILD)/lib%.so.$(SONAME)))
$(EXPORTS:%=$(BUILD)/gen/%.map): $(BUILD)/gen/%.map: client/exports/%.txt
	@mkdir -p $(@D)
	$(call say,GEN,$@)
	$(Q){ echo 'UMBRAGE_$(SONAME) { global:'; sed 's/$$/;/' $<; echo 'local: *; };'; } >$@

# The copies in BUILD/wheel find what the wheel carries beside them. RPATH, unlike RUNPATH, also serves the needs of the
# carried libraries.
WHEEL_LIBS := $(EXPORTS:%=$(BUILD)/wheel/lib/lib%.so.$(SONAME))
WHEEL_LDFLAGS := -s -Wl,--disable-new-dtags -Wl,-rpath,'$$ORIGIN/../lib'
wheel_flags = $(if $(filter $(BUILD)/wheel/%,$@),$(WHEEL_LDFLAGS))
define shared_library
@mkdir -p $(@D)
$(call say,LD,$@)
$(Q)$(CC) $(LDFLAGS_ALL) $(wheel_flags) -shared -Wl,-soname,$(@F),-z,defs,-Bsymbolic-functions,--version-script=$< \
	$(filter %.o,$^) -Wl,--as-needed $(filter-out %.o %.map,$^) $(LIBS_$*) -o $@
endef
$(EXPORTS:%=$(BUILD)/lib%.so.$(SONAME)): $(BUILD)/lib%.so.$(SONAME): $(BUILD)/gen/%.map
	$(shared_library)
$(WHEEL_LIBS): $(BUILD)/wheel/lib/lib%.so.$(SONAME): $(BUILD)/gen/%.map
	$(shared_library)

# Small private units that two libraries use are compiled into both.
RPC_SHARED := $(patsubst %,$(BUILD)/client/core/%.o,base/query_settings base/utf8 maps/map_view)
both = $(addsuffix /$(1).so.$(SONAME),$(BUILD) $(BUILD)/wheel/lib)
$(call both,libumbrage-core): $(CORE_OBJ)
$(call both,libumbrage-maps): $(MAPS_OBJ) $(BUILD)/client/core/base/memory.o $(BUILD)/libumbrage-core.so.$(SONAME)
$(call both,libumbrage): $(RPC_OBJ) $(RPC_SHARED) $(BUILD)/libumbrage-wire.a $(BUILD)/libumbrage-core.so.$(SONAME)
LIBS_umbrage-core = $(CORE_LIBS)
LIBS_umbrage-maps = -lm
LIBS_umbrage      = $(RPC_LIBS) -lm

# $(call page,FILE): FILE's bytes, an HTML page, as umbu_page_NAME in gen/NAME.c.
define page
$(BUILD)/gen/$(basename $(notdir $(1))).c: $(1)
	@mkdir -p $$(@D)
	$$(call say,GEN,$$@)
	$$(Q){ echo '#include <stddef.h>'; name=umbu_page_$(basename $(notdir $(1))); \
	  echo "extern const unsigned char $$$$name[];"; echo "extern const size_t $$$${name}_size;"; \
	  echo "const unsigned char $$$$name[] = {"; \
	  od -An -v -tx1 $$< | sed 's/ \([0-9a-f][0-9a-f]\)/0x\1,/g'; echo '};'; \
	  echo "const size_t $$$${name}_size = sizeof $$$$name;"; } >$$@
$(BUILD)/gen/$(basename $(notdir $(1))).o: $(BUILD)/gen/$(basename $(notdir $(1))).c
	$$(call say,CC,$$<)
	$$(Q)$$(CC) $$(CFLAGS_ALL) -c $$< -o $$@
endef
$(eval $(call page,client/tool/report_head.html))
$(eval $(call page,client/load/load_page.html))

CLI_OBJ := $(patsubst %.c,$(BUILD)/%.o,$(sort $(wildcard client/cli/*.c client/cli/*/*.c)))
LOAD_OBJ := $(patsubst %.c,$(BUILD)/%.o,$(sort $(wildcard client/load/*.c))) $(BUILD)/gen/load_page.o

CLI_LIB := $(BUILD)/libumbrage-cli.a
LOAD_LIB := $(BUILD)/libumbrage-load.a
CLI_LIBS := -lcurl

# Numerics: the sanitizers also watch floats that do not fit an integer and divisions by zero.
FLOAT_CHECKS := -fsanitize=float-cast-overflow,float-divide-by-zero
$(foreach part,base format maps partial query,$(BUILD)/client/core/$(part)/%.o): CFLAGS_ALL += $(if $(filter asan,$(config)),$(FLOAT_CHECKS))

$(CORE_LIB): $(CORE_OBJ)
$(MAPS_LIB): $(MAPS_OBJ)
$(RPC_LIB): $(RPC_OBJ) $(RPC_SHARED)
$(TOOL_LIB): $(TOOL_OBJ) $(BUILD)/gen/report_head.o
$(LOAD_LIB): $(LOAD_OBJ)
$(CLI_LIB): $(filter-out %/cli_main.o,$(CLI_OBJ))

$(BUILD)/umbrage: $(BUILD)/client/cli/cli_main.o $(LOAD_LIB) $(CLI_LIB) $(TOOL_LIB) $(RPC_LIB) $(MAPS_LIB) $(CORE_LIB)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(CLI_LIBS) $(RPC_LIBS) $(CORE_LIBS) -o $@

core: $(CORE_LIB) ## the core library alone
libraries: $(CORE_LIB) $(MAPS_LIB) $(RPC_LIB) $(SHARED_LIBS) ## libumbrage-core, libumbrage-maps, libumbrage
client: $(BUILD)/umbrage libraries ## the libraries and the umbrage command

include client/python/module.mk
include client/gpu/module.mk
include client/web/module.mk

abi: libraries ## compare the libraries with those of the last tag (abidiff, where it is)
	@sh tests/abi/last_tag.sh $(BUILD)
abi-record: $(CORE_LIB) $(MAPS_LIB) $(RPC_LIB) ## write export lists and tests/abi/record.txt anew from the headers
	@tests/abi/abi.py write $(BUILD)
.PHONY: core libraries client abi abi-record
