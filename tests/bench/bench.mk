# SPDX-License-Identifier: Apache-2.0
# Benchmarks. They print one JSON object a row on stdout and a table on stderr; with
# UMBRAGE_BENCH_BARS=FILE the table shows the bars of that file. SIZE=quick|full.
SIZE ?= quick
BENCH_PROGRAMS := $(BUILD)/bench_bake $(BUILD)/bench_query $(BUILD)/bench_frames $(BUILD)/bench_service
BENCH_SHARED := $(patsubst %,$(BUILD)/tests/bench/%.o,bench_report bench_arguments bench_machine bench_scene \
	bench_points bench_map16 place_floor_avx2 place_floor_avx512 lines_floor embree_peer yardstick_2014 voxel_truth bake_race lamp_race)
BENCH_STUDY := $(filter-out %/study_main.o,$(STUDY_OBJ))
BENCH_ORACLE := $(patsubst %,$(BUILD)/tests/oracle/oracle_%.o,scene closed depth)
# A sparse volume as peer, where its headers are.
ifneq ($(STUDY_VOLUME),)
BENCH_VOLUME := $(BUILD)/tests/bench/bench_nanovdb.o
$(BUILD)/tests/bench/bench_query.o: INC_tests += -DUMB_BENCH_NANOVDB
endif
BENCH_LIBS = $(BAKE_LIB) $(RAYS_LIB) $(SCENE_LIB) $(COMMON_LIB) $(TOOL_LIB) $(RPC_LIB) $(MAPS_LIB) $(CORE_LIB)
BENCH_SYS = -lembree3 -ljansson -lpng $(STUDY_LIBS) $(RPC_LIBS) $(COMMON_LIBS) $(CORE_LIBS)

# The peers are compiled to win.
$(BUILD)/tests/bench/place_floor_avx2.o: AVX2_FLAGS += -O3
$(BUILD)/tests/bench/embree_peer.o: INC_tests += -O3

$(BENCH_PROGRAMS): $(BUILD)/%: $(BUILD)/tests/bench/%.o $(BENCH_SHARED) $(BENCH_STUDY) \
		$(BENCH_ORACLE) $(GEN_OBJ) $(BENCH_LIBS)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(BENCH_SYS) -o $@

$(BUILD)/bench_query: $(BUILD)/tests/bench/bench_filters.o $(BENCH_VOLUME)
$(BUILD)/bench_frames: $(BUILD)/tests/bench/vsm_peer_avx2.o
$(BUILD)/tests/bench/vsm_peer_avx2.o: AVX2_FLAGS += -O3

# The service's races: one client, bare frames and gRPC's C++ library as peers.
PEER_OBJ := $(BUILD)/tests/bench/peer_work.o
$(BUILD)/bench_service: $(BUILD)/tests/bench/bench_caller.o $(BUILD)/tests/bench/bench_protocol.o $(PEER_OBJ)

$(BUILD)/peer_raw: $(BUILD)/tests/bench/peer_raw.o $(PEER_OBJ) $(WIRE_LIB) $(CORE_LIB)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(WIRE_LIBS) $(CORE_LIBS) -o $@

# Asked by the header, because pkg-config walks through all that gRPC needs for a third of a second.
ifneq ($(and $(wildcard /usr/include/grpcpp/grpcpp.h /usr/local/include/grpcpp/grpcpp.h),$(shell command -v grpc_cpp_plugin)),)
BENCH_PEERS := $(BUILD)/peer_raw $(BUILD)/peer_grpcpp
$(BUILD)/peer_grpcpp: tests/bench/peer_grpcpp.cc $(PEER_OBJ) $(CORE_LIB) proto/umbrage/v1/shadows.proto
	@mkdir -p $(BUILD)/gen/cpp
	$(Q)protoc -Iproto --cpp_out=$(BUILD)/gen/cpp --grpc_out=$(BUILD)/gen/cpp \
		--plugin=protoc-gen-grpc=$$(command -v grpc_cpp_plugin) umbrage/v1/shadows.proto
	$(call say,CXX,$@)
	$(Q)$(CXX) -std=c++17 -O2 -DNDEBUG -Iclient/include -Itests/bench -I$(BUILD)/gen/cpp $< \
		$(BUILD)/gen/cpp/umbrage/v1/shadows.pb.cc $(BUILD)/gen/cpp/umbrage/v1/shadows.grpc.pb.cc \
		$(PEER_OBJ) $(CORE_LIB) $$(pkg-config --cflags --libs grpc++ protobuf) $(CORE_LIBS) -o $@
else
BENCH_PEERS := $(BUILD)/peer_raw
endif

# The C program that the Python module is raced against, with the same shared library.
$(BUILD)/python_peer: $(BUILD)/tests/bench/python_peer.o $(BUILD)/libumbrage-core.so.$(SONAME)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ -Wl,-rpath,'$$ORIGIN' -o $@
bench-python: $(PROGRAMS) python $(BUILD)/scenegen $(BUILD)/python_peer ## the Python module against C: batches of 10^7 and of 64 points
	@BUILD=$(BUILD) /usr/bin/python3 tests/bench/bench_python.py
.PHONY: bench-python

# Counted by tests/system/test_kernel_counts.sh.
$(BUILD)/kernel_count: $(BUILD)/tests/bench/kernel_count.o $(HARNESS_OBJ) $(CORE_LIB)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(TEST_SYS_core) -lcmocka -o $@

# Counted by tests/system/test_page_costs.sh.
$(BUILD)/page_count: $(BUILD)/tests/bench/page_count.o $(HARNESS_OBJ) $(RPC_LIB) $(CORE_LIB)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(TEST_SYS_rpc) -lcmocka -o $@

# The same program with one effect compiled out of queries. Only the lists of stages and filters
# depend on that; all other objects are shared. Compared by tests/system/test_effect_costs.sh.
SWITCHED_SRC := client/core/query/query.c client/core/query/filter.c
EFFECT_SWITCHES := $(sort $(shell sed -n 's/^.if.*def UMB_WITHOUT_//p' $(SWITCHED_SRC)))
WITHOUT_BINS := $(EFFECT_SWITCHES:%=$(BUILD)/kernel_count_without_%)
define without_effect
WITHOUT_OBJ_$(1) := $$(SWITCHED_SRC:%.c=$$(BUILD)/without_$(1)/%.o)
$$(WITHOUT_OBJ_$(1)): $$(BUILD)/without_$(1)/%.o: %.c
	@mkdir -p $$(@D)
	$$(call say,CC,$$< without $(1))
	$$(Q)$$(CC) $$(CFLAGS_ALL) $$(INC_client) -DUMB_WITHOUT_$(1) -c $$< -o $$@
$$(BUILD)/kernel_count_without_$(1): $$(BUILD)/tests/bench/kernel_count.o $$(WITHOUT_OBJ_$(1)) $$(HARNESS_OBJ) $$(CORE_LIB)
	$$(call say,LD,$$@)
	$$(Q)$$(CC) $$(LDFLAGS_ALL) $$^ $$(TEST_SYS_core) -lcmocka -o $$@
endef
$(foreach effect,$(EFFECT_SWITCHES),$(eval $(call without_effect,$(effect))))

$(BUILD)/failure_pictures: $(BUILD)/tests/bench/failure_pictures.o $(HARNESS_OBJ) $(TEST_LIBS_study)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(TEST_SYS_study) -lcmocka -o $@
$(BUILD)/picture_sheet: $(BUILD)/tests/bench/picture_sheet.o $(TEST_LIBS_study)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(TEST_SYS_study) -o $@
failure-pictures: $(BUILD)/failure_pictures ## how shadow maps fail and what helps: docs/pictures/failures.png
	@$< docs/pictures/failures.png
.PHONY: failure-pictures

bench-bake: $(BUILD)/bench_bake ## sizes, depth, voxels against their yardsticks (SIZE=quick|full)
	@$(BUILD)/bench_bake --size $(SIZE)

# Footprints of a lamp over a city, and of suns behind translucent casters; bench_query has those of
# opaque suns.
$(BUILD)/bench_footprints: $(BUILD)/tests/bench/bench_footprints.o $(patsubst %,$(BUILD)/tests/bench/%.o,bench_report bench_machine) $(CORE_LIB)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(CORE_LIBS) -o $@
FOOTPRINT_NEEDS := $(BUILD)/bench_footprints $(BUILD)/umbrage-bake $(BUILD)/umbrage-study $(BUILD)/scenegen
FOOTPRINT_POINTS := --kind gbuffer --normals --size 640x360 --quiet
bench-footprints: $(FOOTPRINT_NEEDS) ## footprints against windows of 9 taps, for lamps and translucent casters: a minute
	@folder=$$(mktemp -d) && trap 'rm -rf "$$folder"' EXIT && cd "$$folder" && \
	bin="$(abspath $(BUILD))" && bake="$$bin/umbrage-bake" && \
	"$$bin/scenegen" city --size 20 --format ply -o city.ply && \
	/usr/bin/python3 "$(CURDIR)/tests/harness/translucent_scenes.py" glass glass.obj && \
	"$$bake" city.ply -o lamp.umb --up z --closed off --point 0,0,120 --resolution 16384 --verify 0 --quiet && \
	"$$bake" glass.obj -o glass.umb --up z --sun 150,40 --resolution 4096 --verify 0 --quiet && \
	"$$bin/umbrage-study" points city.ply --up z -o city.points $(FOOTPRINT_POINTS) --camera eye=200,-200,90,target=0,0,0,fov=50 && \
	"$$bin/umbrage-study" points glass.obj --up z -o glass.points $(FOOTPRINT_POINTS) && \
	"$$bin/bench_footprints" city-16k-lamp lamp.umb city.points 24 glass-4k glass.umb glass.points 8
.PHONY: bench-footprints

bench-query: $(BUILD)/bench_query ## queries against shadow maps and rays
	@$(BUILD)/bench_query --size $(SIZE)

bench-frames: $(BUILD)/bench_frames ## cascades drawn and variance maps blurred for each picture, against an asset
	@$(BUILD)/bench_frames --size $(SIZE)
.PHONY: bench-frames

bench-service: $(BUILD)/bench_service $(BUILD)/umbraged $(BENCH_PEERS) ## the daemon against the library in process
	@$(BUILD)/bench_service --size $(SIZE) --umbraged $(BUILD)/umbraged --peers $(BUILD)

bench-overload: $(PROGRAMS) $(BUILD)/scenegen ## goodput, memory and recovery at twice the knee; greedy and polite clients
	@BUILD=$(BUILD) /usr/bin/python3 tests/bench/bench_overload.py

bench-http: $(PROGRAMS) $(BUILD)/scenegen ## CPU time of requests over HTTP, beside nginx
	@BUILD=$(BUILD) /usr/bin/python3 tests/bench/http_cost.py

query-instructions: $(PROGRAMS) $(BUILD)/scenegen ## instructions of one small Query in the daemon (BEFORE=FOLDER: beside another build)
	@BUILD=$(BUILD) /usr/bin/python3 tests/bench/query_instructions.py $(BEFORE) $(BUILD)
.PHONY: query-instructions

bench-deep: $(BUILD)/umbrage-study ## windows over deep maps of hair: searched, linked, streamed
	@BUILD=$(BUILD) /usr/bin/python3 tests/bench/bench_deep.py

# Orders of leaves under a window, on the octree of 2014.
$(BUILD)/bench_orders: $(BUILD)/tests/bench/bench_orders.o $(BENCH_SHARED) $(BENCH_STUDY) $(BENCH_ORACLE) $(GEN_OBJ) $(BENCH_LIBS)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(BENCH_SYS) -o $@
bench-orders: $(BUILD)/bench_orders ## orders of the leaves under a window, on the octree of 2014
	@$<
.PHONY: bench-orders

# Races the paper's linked lists with arrays, links and streams.
$(BUILD)/bench_deep_ways: $(patsubst %,$(BUILD)/tests/bench/%.o,bench_deep_ways bench_report bench_arguments bench_machine) $(MAPS_LIB) $(CORE_LIB)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(CORE_LIBS) -o $@
bench-deep-ways: $(BUILD)/bench_deep_ways ## ways through the lists of deep maps, by mean length
	@$<
.PHONY: bench-deep-ways

# Run one after the other, whatever -j says, so that they do not disturb each other. The later ones
# use the bakes of the first; nothing is kept from one run to the next.
bench: $(BENCH_PROGRAMS) $(BUILD)/umbraged $(BENCH_PEERS) ## every benchmark (SIZE=quick|full)
	@assets=$$(mktemp -d) && trap 'rm -rf "$$assets"' EXIT && \
	$(BUILD)/bench_bake --size $(SIZE) --assets "$$assets" && \
	$(BUILD)/bench_query --size $(SIZE) --assets "$$assets" && \
	$(BUILD)/bench_frames --size $(SIZE) --assets "$$assets" && \
	$(BUILD)/bench_service --size $(SIZE) --assets "$$assets" --umbraged $(BUILD)/umbraged --peers $(BUILD)

.PHONY: bench-overload bench-http bench-deep bench bench-bake bench-query bench-service

# Segments, columns and boxes: closed scenes with their front, in process and from a daemon.
$(BUILD)/bench_volume_queries: $(BUILD)/tests/bench/bench_volume_queries.o $(RPC_LIB) $(CORE_LIB)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(RPC_LIBS) $(CORE_LIBS) -o $@
bench-volume-queries: $(PROGRAMS) $(BUILD)/scenegen $(BUILD)/bench_volume_queries ## what segments, columns and boxes cost in process and over gRPC
	@folder=$$(mktemp -d) && mkdir $$folder/store && trap 'kill $$daemon; rm -rf "$$folder"' EXIT && \
	$(BUILD)/scenegen city --size 59 --format ply -o $$folder/city.ply && $(BUILD)/scenegen terrain --size 1024 --format ply -o $$folder/terrain.ply && \
	for scene in city terrain; do $(BUILD)/umbrage-bake $$folder/$$scene.ply -o $$folder/store/$$scene.umb --closed on --effect front=on \
		--resolution 4096 --sun 27,45 --quiet --verify 0 || exit 1; done; \
	$(BUILD)/umbraged --store $$folder/store --listen unix:$$folder/socket >$$folder/log 2>&1 & daemon=$$!; \
	until $(BUILD)/umbrage list --address unix:$$folder/socket >/dev/null 2>&1; do kill -0 $$daemon || exit 1; sleep 0.2; done; \
	for scene in city terrain; do echo "$$scene, 4096 voxels a side:"; \
		$(BUILD)/bench_volume_queries $$folder/store/$$scene.umb unix:$$folder/socket $$scene || exit 1; done
.PHONY: bench-volume-queries

# Far views: compares footprints, and MRAA and VOAA of Sintorn et al. 2014, with the mean over a
# pixel. The levels of MRAA are bakes of their own.
$(BUILD)/far_views: $(BUILD)/tests/bench/far_views.o $(BUILD)/tests/bench/far_modes.o $(BUILD)/tests/bench/bench_report.o \
		$(BENCH_STUDY) $(BAKE_LIB) $(RAYS_LIB) $(SCENE_LIB) $(COMMON_LIB) $(TOOL_LIB) $(RPC_LIB) $(MAPS_LIB) $(CORE_LIB)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(BENCH_SYS) -o $@
FAR_city    := city --size 59
FAR_terrain := terrain --size 1024
FAR_CAMERA_city    := eye=0,-1500,700,target=0,0,0,fov=12
FAR_CAMERA_terrain := eye=0,-6000,3000,target=0,0,0,fov=12
far-views: $(BUILD)/umbrage-bake $(BUILD)/scenegen $(BUILD)/far_views ## table of far views: one tap, windows, MRAA, VOAA, footprints
	@folder=$$(mktemp -d) && trap 'rm -rf "$$folder"' EXIT; \
	$(foreach scene,city terrain,$(BUILD)/scenegen $(FAR_$(scene)) --format ply -o $$folder/$(scene).ply && \
	for n in 16384 8192 4096 2048 1024 512; do $(BUILD)/umbrage-bake $$folder/$(scene).ply -o $$folder/$$n.umb --closed off \
		--resolution $$n --sun 135,40 --up z --quiet --verify 0 || exit 1; done && echo "$(scene):" && \
	$(BUILD)/far_views $$folder/$(scene).ply $(FAR_CAMERA_$(scene)) $$folder &&) true
.PHONY: far-views

# The depth map of one view, for tests/bench/paging_figures.py.
$(BUILD)/depth_view: $(BUILD)/tests/bench/depth_view.o $(CORE_LIB)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ $(CORE_LIBS) -o $@

paging-figures: $(PROGRAMS) $(BUILD)/scenegen $(BUILD)/depth_view ## tables of docs/results/paging.md: bytes and seconds until a view is known (SIZE=quick|full)
	@BUILD=$(BUILD) /usr/bin/python3 tests/bench/paging_figures.py --size $(SIZE)
.PHONY: paging-figures
