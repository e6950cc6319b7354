# SPDX-License-Identifier: Apache-2.0
# The npm package `umbrage`: the core as WebAssembly (module/), and its JavaScript (umbrage/). Needs clang, lld,
# wasi-libc and libclang-rt-dev-wasm32; nothing else of the tree needs them, or this.
WEB_DIR := $(BUILD)/web
WEB_PACKAGE := $(WEB_DIR)/umbrage
WEB_CC ?= clang
# Vector instructions of 128 bits are in every browser since 2023. Kernels are unrolled as the native ones are.
WEB_FLAGS := --target=wasm32-wasi -std=c11 -O2 -DNDEBUG -msimd128 -mbulk-memory -ffp-contract=off -fvisibility=hidden \
	-ffunction-sections -fdata-sections $(WARN) $(if $(werror),-Werror) -D_POSIX_C_SOURCE=200809L \
	-MMD -MP -I$(WEB_DIR)/include -Iclient/include -Iclient/core -Iclient
# The core without files, processes and wider vectors. What a thin client does not call is left out by the linker.
WEB_CORE := $(filter-out %_avx2.c %_avx512.c $(addprefix client/core/,base/file_map.c base/page_alloc.c \
	format/node_pool.c format/pack_write.c format/page_compress.c query/query_picture.c),\
	$(foreach part,base format query curve partial,$(wildcard client/core/$(part)/*.c)))
WEB_CORE_OBJ := $(WEB_CORE:%.c=$(WEB_DIR)/obj/%.o)
WEB_OBJ := $(patsubst %.c,$(WEB_DIR)/obj/%.o,$(wildcard client/web/module/*.c))
WEB_FILES := $(patsubst client/web/umbrage/%,$(WEB_PACKAGE)/%,$(wildcard client/web/umbrage/*.js client/web/umbrage/*.ts))

$(WEB_DIR)/tools: client/web/tools.sh
	@mkdir -p $(@D)
	@sh $< "$(WEB_CC)" && touch $@
# The headers of these two libraries, without the C library beside them.
.SECONDARY: $(WEB_DIR)/include/xxhash.h $(WEB_DIR)/include/zstd.h
$(WEB_DIR)/include/%.h:
	@mkdir -p $(@D)
	$(Q)cp $(firstword $(wildcard /usr/local/include/$*.h /usr/include/$*.h)) $@
$(WEB_DIR)/obj/%.o: %.c | $(WEB_DIR)/tools $(WEB_DIR)/include/xxhash.h $(WEB_DIR)/include/zstd.h
	@mkdir -p $(@D)
	$(call say,WASM,$<)
	$(Q)$(WEB_CC) $(WEB_FLAGS) -c $< -o $@
# Kernels are compiled for speed. Code that runs once for a page, a view or a query is compiled for size.
$(WEB_DIR)/obj/client/core/query/kernel_simd128.o: WEB_FLAGS += -O3 -funroll-loops
WEB_SMALL := $(foreach part,base curve format partial,$(filter client/core/$(part)/%,$(WEB_CORE))) client/web/module/web_module.c \
	$(patsubst %,client/core/query/%.c,explain filter gpu_placement lamp_penumbra penumbra query settings volume)
$(WEB_SMALL:%.c=$(WEB_DIR)/obj/%.o): WEB_FLAGS += -Os
$(WEB_DIR)/libcore.a: $(WEB_CORE_OBJ)
	@rm -f $@
	$(Q)llvm-ar rcsD $@ $^

# The stack comes first in memory, so that one that overflows ends the call instead of changing data.
$(WEB_PACKAGE)/umbrage.wasm: $(WEB_OBJ) $(WEB_DIR)/libcore.a
	@mkdir -p $(@D)
	$(call say,LD,$@)
	$(Q)$(WEB_CC) --target=wasm32-wasi -mexec-model=reactor $^ -Wl,--gc-sections -Wl,--strip-all -Wl,--stack-first \
		-Wl,-z,stack-size=1048576 -Wl,--max-memory=4294901760 -o $@
# Scripts go without lines of comments, except the licence: the types have the descriptions.
WEB_BARE := sed '2,$$ { /^ *\/\/ /d; /^ *\/\*\* .*\*\/$$/d; }'
$(WEB_FILES): $(WEB_PACKAGE)/%: client/web/umbrage/%
	@mkdir -p $(@D)
	$(Q)$(if $(filter %.js,$<),$(WEB_BARE),cat) $< >$@
$(WEB_PACKAGE)/package.json: client/web/umbrage/package.json.in client/include/umbrage/version.h
	@mkdir -p $(@D)
	$(Q)sed 's/@version@/$(VERSION)/' $< >$@
$(WEB_PACKAGE)/LICENSE: LICENSE
	@mkdir -p $(@D)
	$(Q)cp $< $@

# The page of `umbrage view`. three.js comes from Debian's package when the page is served or exported.
VIEWER_FILES := $(patsubst client/web/viewer/%,$(WEB_DIR)/viewer/%,$(wildcard client/web/viewer/*))
$(VIEWER_FILES): $(WEB_DIR)/viewer/%: client/web/viewer/%
	@mkdir -p $(@D)
	$(Q)cp $< $@

# The same decoder and hash for this machine: tests compare them with the libraries.
WEB_LIB := $(BUILD)/libumbrage-web.a
$(WEB_LIB): $(patsubst %,$(BUILD)/client/web/module/%.o,web_sha256 zstd_frame zstd_fse zstd_literals)

$(WEB_PACKAGE)/shaders.js: $(GPU_DIR)/shaders.js
	@mkdir -p $(@D)
	$(Q)cp $< $@

web: $(WEB_PACKAGE)/umbrage.wasm $(WEB_FILES) $(WEB_PACKAGE)/shaders.js $(WEB_PACKAGE)/package.json $(WEB_PACKAGE)/LICENSE $(VIEWER_FILES) ## the npm package `umbrage` and the page of `umbrage view`, in BUILD/web (clang, lld, wasi-libc)

# The package where its tools are; tests skip it by its name elsewhere.
web-if-here:
	@if why=$$(sh client/web/tools.sh "$(WEB_CC)"); then $(MAKE) --no-print-directory web; else echo "skipped web: $$why"; fi
test-web: web-if-here $(PROGRAMS) $(BUILD)/scenegen $(BUILD)/gpu_voxels ## the package in node and in headless Chromium, where they are installed
	@BUILD=$(BUILD) $(RUN) tests/system/test_web.py tests/system/test_web_browser.py \
		tests/system/test_view.py tests/system/test_view_browser.py tests/system/test_view_scenes.py && \
	BUILD=$(BUILD) UMBRAGE_PIXELS=921600 $(RUN) tests/system/test_gpu_browser.py
.PHONY: web web-if-here test-web

# Speed of the package against the native kernels without AVX.
$(BUILD)/base_kernels: $(BUILD)/tests/bench/base_kernels.o $(CORE_LIB)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(CORE_LIBS) -o $@
web-race: web $(PROGRAMS) $(BUILD)/scenegen $(BUILD)/base_kernels ## node against the native kernels without AVX, city of 16384 voxels: two minutes
	@folder=$$(mktemp -d) && trap 'rm -rf "$$folder"' EXIT && $(BUILD)/scenegen city --size 50 -o $$folder/city.glb && \
	$(BUILD)/umbrage-bake $$folder/city.glb -o $$folder/city.umb --resolution 16384 --sun 135,45 --quiet --verify 0 && \
	$(BUILD)/umbrage points $$folder/city.glb -o $$folder/city.f32 --kind gbuffer --camera eye=1,1.7,1,target=100,1.7,9,fov=60 \
		--normals --quiet && BUILD=$(BUILD) tests/bench/web_race.py $$folder/city.umb $$folder/city.f32
.PHONY: web-race
