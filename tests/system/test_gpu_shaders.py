#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The shader includes compile in their languages, where the compilers are: GLSL ES, GLSL and HLSL by glslangValidator, CUDA
by nvcc, C++ by g++. WGSL is compiled by Chromium (test_gpu_browser.py), C by the unit test test_gpu_walk.
"""
import os
import shutil
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

INCLUDES = os.path.join(ut.BUILD, "gpu")
ES = """in vec3 position;
in vec3 normal;
uniform UmbragePlacement sun[2];
out vec4 colour;
void main() { colour = vec4(umbrage_box(sun[0], position, normal, 9), umbrage_tent(sun[1], position, normal, 5))
    + umbrage_coarse(sun[0], position, normal, 3u).xyxy; }
"""
GLSL = """layout(local_size_x = 64) in;
layout(std430, set = 1, binding = 0) buffer Points { UmbragePlacement sun; vec4 points[]; };
void main() { uint i = gl_GlobalInvocationID.x; points[i] = vec4(umbrage_box(sun, points[i].xyz, vec3(0.0), 9),
    umbrage_tent(sun, points[i].xyz, vec3(0.0), 5)) + umbrage_coarse(sun, points[i].xyz, vec3(0.0), 3u).xyxy; }
"""
HLSL = """cbuffer Lights : register(b0) { UmbragePlacement sun; };
RWStructuredBuffer<float4> points : register(u1);
[numthreads(64, 1, 1)] void main(uint3 id : SV_DispatchThreadID) { points[id.x] =
    float4(umbrage_box(sun, points[id.x].xyz, float3(0, 0, 0), 9), umbrage_tent(sun, points[id.x].xyz, float3(0, 0, 0), 5))
    + umbrage_coarse(sun, points[id.x].xyz, float3(0, 0, 0), 3u).xyxy; }
"""
CUDA = """#include "umbrage.cuh"
__global__ void shade(const uint4 *data, UmbragePlacement sun, const float3 *points, float4 *light)
{
    const unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
    const float2 box = umbrage_box(data, sun, points[i], make_float3(0, 0, 0), 9);
    const float2 tent = umbrage_tent(data, sun, points[i], make_float3(0, 0, 0), 5);
    const float2 coarse = umbrage_coarse(data, sun, points[i], make_float3(0, 0, 0), 3u);
    light[i] = make_float4(box.x, box.y, tent.x, coarse.x);
}
"""
NVCC = shutil.which("nvcc") or "/usr/local/cuda/bin/nvcc"
# Name, compiler, include and what stands before and behind it, file, options.
SHADERS = [
    ("GLSL ES 3.00", "glslangValidator", "umbrage_es.glsl", "#version 300 es\nprecision highp float;\nprecision highp int;\n",
     ES, "shader.frag", []),
    ("GLSL 4.50", "glslangValidator", "umbrage.glsl", "#version 450\n", GLSL, "shader.comp", ["-V", "-o", os.devnull]),
    ("HLSL", "glslangValidator", "umbrage.hlsl", "", HLSL, "shader.hlsl",
     ["-V", "-D", "-e", "main", "-S", "comp", "-o", os.devnull]),
    ("CUDA", NVCC, None, CUDA, "", "shader.cu", ["-Werror", "all-warnings", "-c", "-o", os.devnull, "-I", INCLUDES]),
    ("C++", "g++", None, '#include "umbrage.cuh"\n', "", "shader.cc",
     ["-std=c++11", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-fsyntax-only", "-I", INCLUDES]),
]

test = ut.Test()
for name, compiler, include, before, behind, file_name, options in SHADERS:
    if shutil.which(compiler) is None:
        ut.left_out(f"the {name} include", f"{os.path.basename(compiler)} is not installed")
        continue
    with test.check(f"the {name} include compiles"):
        text = ""
        if include:
            with open(os.path.join(INCLUDES, include), encoding="utf-8") as file:
                text = file.read()
        with open(test.path(file_name), "w", encoding="utf-8") as file:
            file.write(before + text + behind)
        done = subprocess.run([compiler, *options, test.path(file_name)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                              timeout=120, check=False)
        assert done.returncode == 0, done.stdout.decode()
test.finish()
