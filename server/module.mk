# SPDX-License-Identifier: Apache-2.0
# umbraged, umbrage-bake and umbrage-study. common, scene, store, jobs and rays are
# libraries that they share.
INC_server = -Iclient/include -Iclient/core -Iclient -Iproto -Iserver -I$(BUILD)/gen

COMMON_OBJ := $(patsubst %.c,$(BUILD)/%.o,$(sort $(wildcard server/common/*.c)))
SCENE_OBJ  := $(patsubst %.c,$(BUILD)/%.o,$(sort $(wildcard server/scene/*.c)))
STORE_OBJ  := $(patsubst %.c,$(BUILD)/%.o,$(sort $(wildcard server/store/*.c)))
RAYS_OBJ   := $(patsubst %.c,$(BUILD)/%.o,$(sort $(wildcard server/rays/*.c)))
JOBS_OBJ   := $(patsubst %.c,$(BUILD)/%.o,$(sort $(wildcard server/jobs/*.c)))
DAEMON_OBJ := $(patsubst %.c,$(BUILD)/%.o,$(sort $(wildcard server/daemon/*.c server/daemon/*/*.c)))
BAKE_OBJ   := $(patsubst %.c,$(BUILD)/%.o,$(sort $(wildcard server/bake/*.c server/bake/*/*.c)))
STUDY_OBJ  := $(patsubst %.c,$(BUILD)/%.o,$(sort $(wildcard server/study/*.c))) $(BUILD)/gen/study_page.o
# The study compares NanoVDB, a sparse volume, with umbrage where NanoVDB's headers are installed
# (libnanovdb-dev); NANOVDB= builds without it.
NANOVDB ?= $(shell $(CXX) -std=c++17 -include nanovdb/NanoVDB.h -E -x c++ /dev/null >/dev/null 2>&1 && echo yes)
ifneq ($(NANOVDB),)
STUDY_VOLUME := $(BUILD)/server/study/nanovdb_peer.o
STUDY_OBJ    := $(filter-out %/nanovdb_absent.o,$(STUDY_OBJ)) $(STUDY_VOLUME)
STUDY_LIBS   := -lstdc++
$(STUDY_VOLUME): server/study/nanovdb_peer.cc server/study/nanovdb_peer.h
	@mkdir -p $(@D)
	$(call say,CXX,$<)
	$(Q)$(CXX) -std=c++17 -g $(PLACE) -O3 -DNDEBUG $(HARDEN_CFLAGS) $(AVX2_FLAGS) -ffp-contract=off -fPIC -Iserver -c $< -o $@
endif
# The shadow map that the study compares with umbrage gets more optimisation than umbrage itself.
$(BUILD)/server/study/shadow_map16_avx2.o: AVX2_FLAGS += -O3

# SHA-256 of many pages at once, where Intel's library for it is installed (libipsec-mb-dev, amd64); IPSEC_MB=
# builds without it.
COMMON_LIBS := -lcrypto
IPSEC_MB ?= $(shell $(CC) -DNO_COMPAT_IMB_API_053 -include intel-ipsec-mb.h -fsyntax-only -x c /dev/null 2>/dev/null && echo yes)
ifneq ($(IPSEC_MB),)
COMMON_LIBS += -Wl,--as-needed -lIPSec_MB -Wl,--no-as-needed
$(BUILD)/server/common/sha256_lanes.o: INC_server += -DHAVE_IPSEC_MB
endif
# This file records whether the build folder has libipsec-mb. When that changes, sha256_lanes.o and
# the programs are made anew.
IPSEC_MB_BUILT := $(BUILD)/gen/ipsec_mb_$(if $(IPSEC_MB),with,without)
$(IPSEC_MB_BUILT):
	@mkdir -p $(@D)
	@rm -f $(@D)/ipsec_mb_*
	@touch $@
$(BUILD)/server/common/sha256_lanes.o: $(IPSEC_MB_BUILT)

COMMON_LIB := $(BUILD)/libumbrage-common.a
SCENE_LIB  := $(BUILD)/libumbrage-scene.a
STORE_LIB  := $(BUILD)/libumbrage-store.a
RAYS_LIB   := $(BUILD)/libumbrage-rays.a
JOBS_LIB   := $(BUILD)/libumbrage-jobs.a
BAKE_LIB   := $(BUILD)/libumbrage-bake.a
STUDY_LIB  := $(BUILD)/libumbrage-study.a
DAEMON_LIB := $(BUILD)/libumbrage-daemon.a

$(eval $(call page,server/study/study_page.html))

# The sanitizers check conversions of floats here as in the core (client/module.mk).
$(BUILD)/server/bake/%.o $(BUILD)/server/rays/%.o $(foreach part,common scene store,$(BUILD)/server/$(part)/%.o): CFLAGS_ALL += $(if $(filter asan,$(config)),$(FLOAT_CHECKS))

$(COMMON_LIB): $(COMMON_OBJ)
$(SCENE_LIB): $(SCENE_OBJ)
$(STORE_LIB): $(STORE_OBJ)
$(RAYS_LIB): $(RAYS_OBJ)
$(JOBS_LIB): $(JOBS_OBJ)
$(BAKE_LIB): $(filter-out %/bake_main.o,$(BAKE_OBJ))
$(STUDY_LIB): $(filter-out %/study_main.o,$(STUDY_OBJ))
$(DAEMON_LIB): $(filter-out %/daemon_main.o,$(DAEMON_OBJ)) $(NET_OBJ)

$(BUILD)/umbraged: $(BUILD)/server/daemon/daemon_main.o $(DAEMON_LIB) $(JOBS_LIB) $(STORE_LIB) $(COMMON_LIB) $(TOOL_LIB) $(WIRE_LIB) $(MAPS_LIB) $(CORE_LIB)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ -lsqlite3 -luv -lnghttp2 $(WIRE_LIBS) -lssl $(COMMON_LIBS) -linih $(CORE_LIBS) -o $@

$(BUILD)/umbrage-bake $(BUILD)/wheel/bin/umbrage-bake: $(BUILD)/server/bake/bake_main.o $(BAKE_LIB) $(RAYS_LIB) $(SCENE_LIB) $(COMMON_LIB) $(TOOL_LIB) $(CORE_LIB)
	@mkdir -p $(@D)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $(wheel_flags) $^ -lembree3 -ljansson -lpng $(COMMON_LIBS) $(CORE_LIBS) -o $@

$(BUILD)/umbrage-study: $(BUILD)/server/study/study_main.o $(STUDY_LIB) $(RAYS_LIB) $(SCENE_LIB) $(COMMON_LIB) $(TOOL_LIB) $(RPC_LIB) $(MAPS_LIB) $(CORE_LIB)
	$(call say,LD,$@)
	$(Q)$(CC) $(LDFLAGS_ALL) $^ -lembree3 -lpng $(STUDY_LIBS) $(RPC_LIBS) $(COMMON_LIBS) $(CORE_LIBS) -o $@

daemon: $(BUILD)/umbraged ## umbraged
bake: $(BUILD)/umbrage-bake ## umbrage-bake
study: $(BUILD)/umbrage-study ## umbrage-study: render, verify against rays
.PHONY: daemon bake study
