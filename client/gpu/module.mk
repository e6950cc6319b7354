# SPDX-License-Identifier: Apache-2.0
# The walk through an asset for shaders: one source, and an include for each language.
GPU_DIR := $(BUILD)/gpu
GPU_FILES := $(addprefix $(GPU_DIR)/,umbrage.wgsl umbrage_es.glsl umbrage.glsl umbrage.hlsl umbrage.cuh)

$(GPU_FILES) $(GPU_DIR)/shaders.js &: client/gpu/walk.shader client/gpu/shaders.py
	$(call say,GEN,$(GPU_DIR))
	$(Q)/usr/bin/python3 client/gpu/shaders.py $< $(GPU_DIR)
gpu: $(GPU_FILES) ## shader includes for WGSL, GLSL, HLSL, CUDA and C, in BUILD/gpu (python3)
# The unit test of the shaders' walk with more points.
GPU_POINTS ?= 1000000
gpu-walk: $(BUILD)/tests/unit/core/test_gpu_walk ## the shaders' walk as C against the core (GPU_POINTS=1000000): two minutes
	@UMBRAGE_CASES=$(GPU_POINTS) $<
.PHONY: gpu gpu-walk
