# SPDX-License-Identifier: Apache-2.0
# umbrage: one Makefile for everything. `make help` lists the targets.
#
#   config=release|debug|asan|tsan|ubsan   which build (each in its own folder)
#   werror=1                         warnings are errors (CI)
#   warn=                            no warnings: for sources that another build has compiled
#   BUILD=DIR                        another build folder
#   IPSEC_MB=, NANOVDB=              without libipsec-mb or NanoVDB, also where they are installed
#   harden=                          a release build without the hardening flags, to measure what they cost
-include Makefile.config

config ?= release
BUILD  ?= build/$(config)
# BUILD always becomes the same relative path, however it is given. The dependency files (*.d, which
# headers an object includes) name an object by the path under which it was compiled. The path of the
# tree may have spaces, so it never passes through a function that splits words.
BUILD_HERE := $(subst $(CURDIR)/,,$(BUILD))
ifneq ($(words $(BUILD_HERE)),1)
$(error BUILD: '$(BUILD)' has spaces, at which make splits names; give a folder without)
endif
override BUILD := $(if $(filter /% ../%,$(BUILD_HERE)),$(abspath $(BUILD_HERE)),$(patsubst /%,%,$(abspath /$(BUILD_HERE))))
ifeq ($(origin CC),default)
CC := gcc
endif
PREFIX ?= /usr/local
DESTDIR ?=

.DEFAULT_GOAL := all
.DELETE_ON_ERROR:
.SUFFIXES:

# Quiet by default: V=1 shows the commands.
Q := $(if $(V),,@)
say = $(if $(V),,@echo "  $(1) $(2)")

# The version comes from the header umbrage/version.h; `make version VERSION=1.2.3` sets it. SONAME is
# the number at the end of the shared libraries' names.
HEADER_VERSION := $(shell awk '/^.define UMB_VERSION_(MAJOR|MINOR|PATCH) / { v = v dot $$3; dot = "." } END { print v }' \
	client/include/umbrage/version.h)
VERSION := $(HEADER_VERSION)
ifneq ($(VERSION),$(HEADER_VERSION))
ifneq ($(MAKECMDGOALS),version)
$(error VERSION: $(VERSION) is not $(HEADER_VERSION), that of umbrage/version.h; run make version VERSION=$(VERSION) first)
endif
endif
SONAME := 1
CORES := $(shell nproc)

opt_release := -O2 -DNDEBUG
opt_debug   := -O0
opt_asan    := -O1 -g1 -fsanitize=address,undefined -fno-sanitize-recover=all -fno-omit-frame-pointer
opt_tsan    := -O1 -g1 -fsanitize=thread -fno-omit-frame-pointer
opt_ubsan   := -O2 -fsanitize=undefined -fno-sanitize-recover=all
ifeq ($(opt_$(config)),)
$(error config=$(config) is not one of release debug asan tsan ubsan)
endif

# Hardening of release builds: docs/explained/testing.md says what each flag is for,
# tests/system/test_hardening.py reads it back from the built programs. Debug builds have no
# optimiser for FORTIFY, and sanitizers see more than it does.
harden ?= yes
ifeq ($(config)$(harden),releaseyes)
takes = $(shell $(CC) -Werror $(1) -fsyntax-only -x c /dev/null 2>/dev/null && echo $(1))
FORTIFY := $(if $(shell printf '\043if !__has_builtin(__builtin_dynamic_object_size)\n\043error\n\043endif\n' | \
	$(CC) -E -x c - >/dev/null 2>&1 && echo yes),3,2)
HARDEN_CFLAGS := -U_FORTIFY_SOURCE -D_FORTIFY_SOURCE=$(FORTIFY) -fstack-protector-strong \
	$(call takes,-fstack-clash-protection) $(call takes,-fcf-protection=full) $(call takes,-ftrivial-auto-var-init=zero)
HARDEN_LDFLAGS := -Wl,-z,relro,-z,now,-z,noexecstack
endif

warn ?= yes
WARN := $(if $(warn),-Wall -Wextra -Wshadow -Wconversion -Wstrict-prototypes -Wmissing-prototypes -Wvla,-w)
# Releases name no path of the machine that built them.
PLACE := $(if $(filter release,$(config)),'-ffile-prefix-map=$(CURDIR)=.')
CFLAGS_ALL := -std=c11 -g $(PLACE) $(opt_$(config)) $(HARDEN_CFLAGS) $(WARN) $(if $(werror),-Werror) \
	-fvisibility=hidden -ffp-contract=off -fPIC -pthread \
	-D_POSIX_C_SOURCE=200809L -D_FILE_OFFSET_BITS=64 -MMD -MP $(CFLAGS)
LDFLAGS_ALL := -pthread $(HARDEN_LDFLAGS) $(filter -fsanitize=%,$(opt_$(config))) $(LDFLAGS)

# Flags of files named *_avx2.c and *_avx512.c. Never FMA, so that all kernels compute the same bits.
ifneq ($(filter x86_64%,$(shell $(CC) -dumpmachine)),)
AVX2_FLAGS := -mavx2 -mpopcnt -mbmi -mbmi2 -mno-fma
AVX512_FLAGS := -mavx512f -mavx512vl -mavx512bw -mavx512dq -O3
endif

all: client daemon bake study ## build every program and library

include client/module.mk
include proto/module.mk
include server/module.mk
include tests/module.mk
include deploy/module.mk

$(BUILD)/%_avx2.o: %_avx2.c
	@mkdir -p $(@D)
	$(call say,CC,$<)
	$(Q)$(CC) $(CFLAGS_ALL) $(AVX2_FLAGS) $(INC_$(firstword $(subst /, ,$*))) -c $< -o $@

$(BUILD)/%_avx512.o: %_avx512.c
	@mkdir -p $(@D)
	$(call say,CC,$<)
	$(Q)$(CC) $(CFLAGS_ALL) $(AVX512_FLAGS) $(INC_$(firstword $(subst /, ,$*))) -c $< -o $@

$(BUILD)/%.o: %.c
	@mkdir -p $(@D)
	$(call say,CC,$<)
	$(Q)$(CC) $(CFLAGS_ALL) $(INC_$(firstword $(subst /, ,$*))) -c $< -o $@

$(BUILD)/%.a:
	@mkdir -p $(@D)
	@rm -f $@
	$(call say,AR,$@)
	$(Q)ar rcsD $@ $^

clean: ## remove every build
	rm -rf build demo-out

help: ## this list
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sort | awk -F':.*## ' '{printf "  %-14s %s\n", $$1, $$2}'

.PHONY: all clean help

-include $(shell test -d $(BUILD) && find $(BUILD) -type f -name '*.d')
