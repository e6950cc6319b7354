# SPDX-License-Identifier: Apache-2.0
# Every tests/unit/PART/test_*.c is a cmocka program of its own, linked with PART's libraries only.
INC_tests = -Iclient/include -Iclient/core -Iclient -Iproto -Iserver -Itests/harness -Itests/oracle -I$(BUILD)/gen

# The shaders' walk as C.
GPU_TESTS := $(addprefix $(BUILD)/tests/,unit/core/test_gpu_walk.o unit/core/test_gpu_lamps.o agreement/gpu_answers.o)
$(GPU_TESTS): $(GPU_DIR)/umbrage.cuh
$(GPU_TESTS): INC_tests += -I$(GPU_DIR)

# Tests are compiled more often than they run.
ifeq ($(config),release)
$(BUILD)/tests/unit/%.o: CFLAGS_ALL += -O1 -g1
endif

HARNESS_OBJ := $(patsubst %.c,$(BUILD)/%.o,$(wildcard tests/harness/*.c))

TEST_LIBS_core   = $(CORE_LIB)
TEST_LIBS_maps   = $(MAPS_LIB) $(CORE_LIB)
TEST_LIBS_web    = $(WEB_LIB) $(CORE_LIB)
TEST_LIBS_wire   = $(WIRE_LIB) $(CORE_LIB)
TEST_LIBS_rpc    = $(RPC_LIB) $(CORE_LIB)
TEST_LIBS_tool   = $(TOOL_LIB) $(CORE_LIB)
TEST_LIBS_load   = $(LOAD_LIB) $(CLI_LIB) $(TOOL_LIB) $(RPC_LIB) $(MAPS_LIB) $(CORE_LIB)
TEST_LIBS_cli    = $(CLI_LIB) $(TOOL_LIB) $(RPC_LIB) $(MAPS_LIB) $(CORE_LIB)
TEST_LIBS_common = $(COMMON_LIB) $(TOOL_LIB) $(CORE_LIB)
TEST_LIBS_scene  = $(SCENE_LIB) $(COMMON_LIB) $(TOOL_LIB) $(CORE_LIB)
TEST_LIBS_store  = $(STORE_LIB) $(COMMON_LIB) $(TOOL_LIB) $(CORE_LIB)
TEST_LIBS_rays   = $(RAYS_LIB) $(SCENE_LIB) $(COMMON_LIB) $(TOOL_LIB) $(CORE_LIB)
TEST_LIBS_study  = $(STUDY_LIB) $(RAYS_LIB) $(SCENE_LIB) $(COMMON_LIB) $(TOOL_LIB) $(RPC_LIB) $(MAPS_LIB) $(CORE_LIB)
TEST_LIBS_bake   = $(BAKE_LIB) $(RAYS_LIB) $(SCENE_LIB) $(COMMON_LIB) $(TOOL_LIB) $(CORE_LIB)
TEST_LIBS_jobs   = $(JOBS_LIB) $(COMMON_LIB) $(TOOL_LIB) $(CORE_LIB)
TEST_LIBS_daemon = $(DAEMON_LIB) $(JOBS_LIB) $(STORE_LIB) $(COMMON_LIB) $(TOOL_LIB) $(WIRE_LIB) $(MAPS_LIB) $(CORE_LIB)
TEST_SYS_core   = $(CORE_LIBS) -lcrypto
TEST_SYS_maps   = $(CORE_LIBS)
TEST_SYS_web    = $(CORE_LIBS) -lcrypto
TEST_SYS_wire   = $(WIRE_LIBS) $(CORE_LIBS)
TEST_SYS_rpc    = $(RPC_LIBS) $(CORE_LIBS)
TEST_SYS_tool   = $(CORE_LIBS)
TEST_SYS_load   = $(CLI_LIBS) $(RPC_LIBS) $(CORE_LIBS)
TEST_SYS_cli    = $(CLI_LIBS) $(RPC_LIBS) $(CORE_LIBS)
TEST_SYS_common = $(COMMON_LIBS) $(CORE_LIBS)
TEST_SYS_scene  = $(COMMON_LIBS) $(CORE_LIBS)
TEST_SYS_store  = -luv $(COMMON_LIBS) $(CORE_LIBS)
TEST_SYS_rays   = -lembree3 $(COMMON_LIBS) $(CORE_LIBS)
TEST_SYS_study  = -lembree3 -lpng $(STUDY_LIBS) $(RPC_LIBS) $(COMMON_LIBS) $(CORE_LIBS)
TEST_SYS_bake   = -lembree3 -ljansson -lpng $(COMMON_LIBS) $(CORE_LIBS)
TEST_SYS_jobs   = -lsqlite3 $(COMMON_LIBS) $(CORE_LIBS)
TEST_SYS_daemon = -lsqlite3 -luv -lnghttp2 $(WIRE_LIBS) -lssl $(COMMON_LIBS) -linih $(CORE_LIBS)

UNIT_PARTS := core maps web wire rpc tool cli load common scene store rays study bake jobs daemon
UNIT_TESTS :=

define unit_part
UNIT_BIN_$(1) := $$(patsubst %.c,$$(BUILD)/%,$$(wildcard tests/unit/$(1)/test_*.c))
UNIT_TESTS += $$(UNIT_BIN_$(1))
$$(UNIT_BIN_$(1)): $$(BUILD)/%: $$(BUILD)/%.o $$(HARNESS_OBJ) $$(TEST_LIBS_$(1))
	$$(call say,LD,$$@)
	$$(Q)$$(CC) $$(LDFLAGS_ALL) $$^ $$(TEST_SYS_$(1)) -lcmocka -o $$@
unit-$(1): $$(UNIT_BIN_$(1))
	@for t in $$(UNIT_BIN_$(1)); do echo "== $$$$t"; timeout 300 $$$$t || exit 1; done
.PHONY: unit-$(1)
endef
$(foreach part,$(UNIT_PARTS),$(eval $(call unit_part,$(part))))

-include tests/scenes/scenes.mk
-include tests/oracle/oracle.mk
-include tests/fuzz/fuzz.mk
-include tests/fault/fault.mk
-include tests/bench/bench.mk
-include tests/interop/interop.mk

unit: $(UNIT_TESTS) ## build the unit tests
RUN := sh tests/harness/run.sh
SYSTEM_TESTS := $(sort $(wildcard tests/agreement/test_* tests/system/test_* tests/interop/test_*))
PROGRAMS := $(BUILD)/umbrage $(BUILD)/umbraged $(BUILD)/umbrage-bake $(BUILD)/umbrage-study

check: $(UNIT_TESTS) $(PROGRAMS) layers ## unit tests and include rules: under a minute once built
	@BUILD=$(BUILD) $(RUN) $(UNIT_TESTS)

# A bake that was taken over by its scene.
$(BUILD)/intruder.so: $(BUILD)/tests/system/intruder.o
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) -shared $^ -o $@

SYSTEM_NEEDS := $(PROGRAMS) $(addprefix $(BUILD)/,scenegen intruder.so oracle_check kernel_count page_count light_products lamp_check gpu_voxels gpu_answers interop/umbraged interop/wire_echo) $(WITHOUT_BINS)
system: python gpu web-if-here $(SYSTEM_NEEDS) ## real processes on loopback, agreement, interop
	@BUILD=$(BUILD) TEST_ATTEMPTS=2 $(RUN) $(SYSTEM_TESTS)

# Unit, system and short fault tests in one run, so that what waits runs beside what computes.
release-needs: all python gpu web-if-here $(UNIT_TESTS) $(BENCH_PROGRAMS) $(SYSTEM_NEEDS) $(FAULT_NEEDS)
release-tests: release-needs layers
	@BUILD=$(BUILD) FAULT=short TEST_ATTEMPTS=2 $(RUN) $(UNIT_TESTS) $(SYSTEM_TESTS) $(FAULT_TESTS)

# The random cases of segments, columns and boxes in full: three frames of 350000 each.
VOLUME_QUERIES := $(addprefix $(BUILD)/tests/unit/core/test_,segments segments_faces boxes)
volume-queries: $(VOLUME_QUERIES) $(PROGRAMS) $(BUILD)/scenegen ## segments, columns, boxes: 10^6 random cases each, and against rays
	@for t in $(VOLUME_QUERIES); do UMBRAGE_CASES=350000 timeout 900 $$t || exit 1; done
	@folder=$$(mktemp -d) && trap 'rm -rf "$$folder"' EXIT && for scene in "city 12" "bridge 30"; do \
		file=$$folder/$${scene% *} && \
		$(BUILD)/scenegen $${scene% *} --size $${scene#* } --format ply -o $$file.ply && \
		$(BUILD)/umbrage-bake $$file.ply -o $$file.umb --closed on --effect front=on --sun 140,38 --resolution 4096 --quiet --verify 0 && \
		for what in segments columns boxes; do echo "$$scene: $$what against rays" && \
			$(BUILD)/umbrage verify $$file.umb --scene $$file.ply --ask $$what || exit 1; done || exit 1; done

# Pages of partial assets that come and go: 10000 random steps on each of eight assets.
partial-changes: $(BUILD)/tests/unit/core/test_partial_changes ## partial assets against a layout made anew: 10000 steps on eight assets
	@UMBRAGE_CASES=10000 timeout 7200 $<

# Compares every hard case with long double or exact references, in 10^6 random cases or more of
# each; 10^8 for rays through edges and corners.
NUMERICS := $(addprefix $(BUILD)/tests/unit/,$(addprefix maps/test_,aliasing cascades maps_channels maps_frustum maps_moments) \
	$(addprefix bake/test_,coverage_exact coverage_watertight eye_clip light_frame) core/test_query_places)
NUMERIC_ROUNDS := $(addprefix $(BUILD)/tests/unit/maps/test_maps_,bounds deep pcf)
numerics: $(NUMERICS) $(NUMERIC_ROUNDS) $(BUILD)/tests/unit/rays/test_rays_watertight ## hard cases against long double: 10^6 random ones of each
	@for t in $(NUMERICS); do echo "$$t"; UMBRAGE_CASES=1000000 timeout 3000 $$t || exit 1; done
	@for t in $(NUMERIC_ROUNDS); do echo "$$t"; for r in 1 2 3 4 5 6 7 8 9 10 11 12 13; do UMBRAGE_ROUND=$$r $$t || exit 1; done; done
	@UMBRAGE_CASES=100000000 $(BUILD)/tests/unit/rays/test_rays_watertight

# Integer techniques by two compilers, without and with all optimisation, with and without AVX2.
$(BUILD)/same_bits: $(BUILD)/tests/agreement/same_bits.o $(HARNESS_OBJ) $(MAPS_LIB) $(TEST_LIBS_bake)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(TEST_SYS_bake) -lcmocka -o $@
SAME_BITS := gcc-debug gcc-release clang-debug clang-release
same-bits: ## the same bits by gcc and clang, at -O0 and -O3, with and without AVX2
	@for b in $(SAME_BITS); do $(MAKE) --no-print-directory CC=$${b%-*} config=$${b#*-} \
		opt_release="-O3 -DNDEBUG" BUILD=build/same-$$b build/same-$$b/same_bits || exit 1; done
	@for b in $(SAME_BITS); do for o in "" --plain; do echo "$$b $$o"; \
		build/same-$$b/same_bits $$o >build/same-$$b/bits || exit 1; \
		diff build/same-gcc-debug/bits build/same-$$b/bits || exit 1; done; done
	@echo "$$(wc -l <build/same-gcc-debug/bits) digests agree"
DETERMINISM := gcc-O2 gcc-O3 clang-O2 clang-O3
determinism: ## equal ids by gcc and clang, -O2 and -O3, AVX and portable, for threads, tiles, and resumed
	@for b in $(DETERMINISM); do $(MAKE) --no-print-directory CC=$${b%-*} config=release werror= \
		opt_release="-$${b#*-} -DNDEBUG" BUILD=build/det-$$b build/det-$$b/umbrage-bake build/det-$$b/scenegen || exit 1; done
	@tests/system/determinism.py $(DETERMINISM:%=build/det-%)
.PHONY: numerics same-bits determinism

# Compares the light behind translucent casters of a bake with products over all surfaces that the
# light meets.
$(BUILD)/light_products: $(BUILD)/tests/agreement/light_products.o $(TEST_LIBS_scene)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(TEST_SYS_scene) -o $@

# Kernels, slices and threads at 16384 voxels a side, 10^7 points of a scene for each window.
$(BUILD)/kernel_bits: $(BUILD)/tests/agreement/kernel_bits.o $(CORE_LIB)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(CORE_LIBS) -o $@
KERNEL_BITS ?= 10000000
kernel-bits: $(PROGRAMS) $(BUILD)/scenegen $(BUILD)/kernel_bits ## the same bits by all kernels, slices and threads: 10^7 points a scene
	@folder=$$(mktemp -d) && trap 'rm -rf "$$folder"' EXIT && \
	$(BUILD)/scenegen terrain --size 1024 --format ply -o "$$folder/terrain.ply" && $(BUILD)/scenegen city --size 59 --format ply -o "$$folder/city.ply" && \
	for scene in terrain city; do for rule in on off; do \
		$(BUILD)/umbrage-bake "$$folder/$$scene.ply" -o "$$folder/$$scene-$$rule.umb" --closed $$rule --sun 27,45 --quiet --verify 0 || exit 1; done; \
		$(BUILD)/umbrage-bake "$$folder/$$scene.ply" -o "$$folder/$$scene-lamp.umb" --point 21,-33,400 --resolution 4096 --quiet --verify 0 || exit 1; done && \
	$(BUILD)/kernel_bits $(KERNEL_BITS) "$$folder"/*.umb
.PHONY: kernel-bits

# Compares random lamps on, above, below and inside surfaces with brute force in long double.
$(BUILD)/lamp_check: $(BUILD)/tests/agreement/lamp_check.o $(CORE_LIB)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(CORE_LIBS) -o $@
$(BUILD)/gpu_voxels $(BUILD)/gpu_answers: $(BUILD)/%: $(BUILD)/tests/agreement/%.o $(CORE_LIB)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(CORE_LIBS) -o $@
LAMPS ?= 2000
LAMP_SEED ?= 1
lamps: $(PROGRAMS) $(BUILD)/lamp_check ## random lamps near surfaces, each bake against brute force (LAMPS=2000 LAMP_SEED=1): twenty minutes
	@BUILD=$(BUILD) /usr/bin/python3 tests/system/lamps.py $(LAMPS) $(LAMP_SEED)
.PHONY: lamps

# Compares penumbras of lamps with rays to the lamps' points.
AREA_LIGHTS ?= 4096 480 16
area-lights: $(PROGRAMS) $(BUILD)/scenegen ## penumbras of lamps and area lights in five scenes against rays (AREA_LIGHTS="VOXELS PIXELS RAYS"): five minutes
	@BUILD=$(BUILD) /usr/bin/python3 tests/system/area_lights.py $(AREA_LIGHTS)
.PHONY: area-lights

# Every prefix and every flipped bit of small assets with all kinds of sections, both encodings.
$(BUILD)/file_sweep: $(BUILD)/tests/agreement/file_sweep.o $(CORE_LIB)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(CORE_LIBS) -o $@
file-sweeps: $(PROGRAMS) $(BUILD)/scenegen $(BUILD)/file_sweep ## every prefix and flipped bit of small assets, both encodings: minutes
	@BUILD=$(BUILD) sh tests/agreement/file_sweeps.sh
.PHONY: file-sweeps

# False shadow and false light at full size.
accuracy: $(PROGRAMS) $(BUILD)/scenegen ## tables of docs/results/accuracy.md and study.md; false shadow and false light against rays: minutes
	@BUILD=$(BUILD) /usr/bin/python3 tests/bench/accuracy_tables.py
	@BUILD=$(BUILD) /usr/bin/python3 tests/bench/study_tables.py
	@UMBRAGE_ACCURACY=full BUILD=$(BUILD) sh tests/system/test_accuracy.sh

$(BUILD)/bias_race: $(BUILD)/tests/bench/bias_race.o $(TEST_LIBS_study)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(TEST_SYS_study) -o $@
bias-table: $(PROGRAMS) $(BUILD)/scenegen $(BUILD)/bias_race ## biases of wide windows against rays, five scenes, three suns: ten minutes
	@BUILD=$(BUILD) /usr/bin/python3 tests/bench/bias_table.py
picture-table: $(PROGRAMS) $(BUILD)/scenegen ## false light and false shadow of default pictures, six scenes, three suns: minutes
	@BUILD=$(BUILD) /usr/bin/python3 tests/bench/picture_table.py
# The viewer's split picture: both sides against rays.
$(BUILD)/ray_shares: $(BUILD)/tests/bench/ray_shares.o $(TEST_LIBS_study)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(TEST_SYS_study) -o $@
view-edges: web $(PROGRAMS) $(BUILD)/scenegen $(BUILD)/ray_shares ## edges of the viewer's shadows and of cascades by three.js against rays: minutes
	@BUILD=$(BUILD) /usr/bin/python3 tests/bench/view_edges.py
view-waits: web $(PROGRAMS) $(BUILD)/scenegen ## how long a browser waits for a street over 20 Mbit/s and 100 ms, and twenty reloads: a minute
	@BUILD=$(BUILD) /usr/bin/python3 tests/bench/view_waits.py
.PHONY: bias-table picture-table view-edges view-waits

# What this version promises to later ones: once for each release.
COMPAT ?= tests/compat/$(VERSION)
compat-record: $(PROGRAMS) python ## record files, ids, answers, messages and interfaces for later versions in tests/compat/VERSION (COMPAT=DIR)
	@BUILD=$(BUILD) /usr/bin/python3 tests/compat/compat.py record "$(COMPAT)"
.PHONY: compat-record

# Packages: root and debootstrap; the release is made twice, without a cache of compilers.
test-deb: deb ## Debian packages in a bare root: first answer, purge, upgrade, downgrade (root, debootstrap)
	@BUILD=$(BUILD) sh tests/packaging/test_deb.sh

test-wheel: wheel ## the wheel: what it carries, its tag, pip in a bare root
	@BUILD=$(BUILD) sh tests/packaging/test_wheel.sh

test-reproducible: ## two releases on other paths, times, locales, umasks have the same bits: half an hour
	@BUILD=$(BUILD) sh tests/packaging/reproducible.sh
.PHONY: test-deb test-wheel test-reproducible

budgets: $(PROGRAMS) $(BUILD)/scenegen ## --budget on 10^6 points against its calibration: two minutes
	@BUILD=$(BUILD) /usr/bin/python3 tests/bench/budgets.py

study-twice: $(PROGRAMS) $(BUILD)/scenegen ## a study of SCENE=FILE twice: equal errors, times within 15 %
	@BUILD=$(BUILD) /usr/bin/python3 tests/bench/study_twice.py "$(SCENE)" $(STUDY_OPTIONS)

verify-scenes: $(PROGRAMS) ## real scenes against a million rays each (RESOLUTIONS="4096 16384"): ten minutes
	@BUILD=$(BUILD) /usr/bin/python3 tests/bench/verify_scenes.py $(RESOLUTIONS)

PLAN_SCENES ?= --resolution 4096,16384
plan-scenes: $(PROGRAMS) $(BUILD)/scenegen ## is the plan right about the closed rule? all scenes under both rules (PLAN_SCENES="--resolution 4096"): ten minutes
	@BUILD=$(BUILD) /usr/bin/python3 tests/bench/plan_scenes.py $(PLAN_SCENES)
effects-table: $(PROGRAMS) ## tables of docs/results/effects.md: plans of real scenes, what effects cost (RESOLUTION=2048): ten minutes
	@BUILD=$(BUILD) /usr/bin/python3 tests/bench/effects_table.py $(RESOLUTION)

larger-than-memory: $(PROGRAMS) $(BUILD)/scenegen ## a large asset under 128 MiB of memory (root, a memory cgroup)
	@BUILD=$(BUILD) /usr/bin/python3 tests/system/larger_than_memory.py

soak: $(PROGRAMS) $(BUILD)/scenegen ## 100 restarts, 1000 swaps, 200 damaged files under load: five minutes
	@BUILD=$(BUILD) /usr/bin/python3 tests/system/soak.py
	@BUILD=$(BUILD) ROUNDS=160 /usr/bin/python3 tests/system/test_store_damage.py

attack: $(PROGRAMS) $(BUILD)/scenegen ## nineteen attacks by 1, 8 and 64 attackers, 60 s each, beside a victim: an hour
	@BUILD=$(BUILD) SECONDS=$${SECONDS:-60} ATTACKERS=$${ATTACKERS:-1,8,64} /usr/bin/python3 tests/system/test_attacks.py
.PHONY: verify-scenes plan-scenes effects-table larger-than-memory soak attack

# Sanitizer runs: all unit tests under ASan and UBSan, those that have threads under TSan, the daemon
# serving real clients under both. What the short form leaves out is in docs/explained/testing.md.
sanitize: ## unit tests and a serving daemon under ASan with UBSan, then under TSan
	@$(MAKE) --no-print-directory -j$(CORES) config=asan warn= sanitize-one
	@$(MAKE) --no-print-directory -j$(CORES) config=tsan warn= sanitize-one
# The core, maps and wire start no threads; a test of theirs may.
THREADLESS := $(UNIT_BIN_core) $(UNIT_BIN_maps) $(UNIT_BIN_wire)
THREADED := $(filter-out $(THREADLESS),$(UNIT_TESTS)) $(patsubst %.c,$(BUILD)/%,$(shell grep -l pthread_create $(THREADLESS:$(BUILD)/%=%.c)))
SANITIZED := $(if $(filter tsan,$(config)),$(THREADED),$(UNIT_TESTS) $(FUZZ_REPLAYS))
sanitize-needs: $(SANITIZED) $(addprefix $(BUILD)/,umbrage umbraged umbrage-bake scenegen)
sanitize-one: sanitize-needs
	@echo "== $(config)"
	@BUILD=$(BUILD) TEST_ATTEMPTS=2 $(RUN) \
		$(if $(filter tsan,$(config)),$$(sh tests/harness/with_threads.sh $(SANITIZED)),$(SANITIZED)) \
		tests/interop/test_grpcio.py tests/system/test_drain.py

# Guards taken out one at a time, in copies of the tree below build/mutants.
mutants: ## take the guards of mutants.toml out one at a time: a test notices each (half an hour)
	@/usr/bin/python3 tests/mutants/run_mutants.py --jobs $(CORES)

mutants-short: ## a handful of them
	@/usr/bin/python3 tests/mutants/run_mutants.py --jobs $(CORES) --short
.PHONY: mutants mutants-short

-include tests/coverage/coverage.mk

test: deps ## everything but sanitizers: lint, units, system, interop, faults (docs/explained/testing.md)
	@$(MAKE) --no-print-directory -j$(CORES) lint release-needs
	@$(MAKE) --no-print-directory -j2 release-tests $(BESIDE)

memory races: %: deps
	@$(MAKE) --no-print-directory -j$(CORES) $(SANITIZER_$*)-needs
	@UMBRAGE_SHORT=1 $(MAKE) --no-print-directory $(BUILD_$(SANITIZER_$*)) sanitize-one
memory: ## unit tests, past crashers and a serving daemon under ASan with UBSan: four minutes
races: ## the tests that can start a thread, and a serving daemon, under TSan: three minutes

# Builds for sanitizers. CI makes those of its later parts beside `make test` (BESIDE), whose tests leave
# processors idle while they wait.
SANITIZER_memory := asan
SANITIZER_races := tsan
BUILD_asan := config=asan warn=
BUILD_tsan := config=tsan warn=
asan-needs tsan-needs: %-needs:
	@nice $(MAKE) --no-print-directory $(BUILD_$*) say= sanitize-needs
clang-needs:
	@if $(HAS_FUZZER); then nice $(MAKE) --no-print-directory $(FUZZ_CLANG) say= sanitize-needs; fi

layers: $(PROGRAMS) ## prove the include rules, and that no files or folders call each other in a circle
	@/usr/bin/python3 tests/lint/layers.py
	@/usr/bin/python3 tests/lint/circles.py --build $(BUILD)

prose-sample: ## 60 comments and 24 paragraphs drawn at random (SEED=1)
	@/usr/bin/python3 tests/lint/prose_sample.py $(or $(SEED),1)

tidy: $(PROTO_GEN_C) ## clang-tidy's checks of .clang-tidy: under a minute
	@INCLUDES="$(INC_tests)" sh tests/lint/tidy.sh

lint: ## banned functions, names, lengths
	@sh tests/lint/lint.sh
	@tests/abi/abi.py check && echo "abi: ok"

format: ## lay out all sources with clang-format
	git ls-files '*.c' '*.h' | xargs clang-format -i

.PHONY: unit check memory volume-queries partial-changes accuracy system sanitize sanitize-needs sanitize-one asan-needs tsan-needs clang-needs races release-needs release-tests test layers lint tidy prose-sample format

# Tests of the wire library look at generated code.
$(patsubst %.c,$(BUILD)/%.o,$(wildcard tests/unit/wire/*.c)): | $(PROTO_GEN_C)
