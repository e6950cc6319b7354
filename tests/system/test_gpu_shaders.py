#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The shader includes compile in their languages, where the compilers are: GLSL ES, GLSL and HLSL by glslangValidator, CUDA
by nvcc, C++ by g++. The Vulkan example answers as the file does, by any Vulkan driver. WGSL is compiled by Chromium (test_gpu_browser.py), C by the unit test test_gpu_walk.
"""
import glob
import os
import shutil
import struct
import subprocess
import sys

sys.path[:0] = [os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", *path) for path in (["harness"], ["..", "client", "gpu"])]
import shaders  # noqa: E402
import umbrage_test as ut  # noqa: E402

INCLUDES = os.path.join(ut.BUILD, "gpu")
ES = """in vec3 position;
in vec3 normal;
uniform UmbragePlacement sun[2];
out vec4 colour;
void main() { colour = vec4(umbrage_box(sun[0], position, normal, 9), umbrage_tent(sun[1], position, normal, 5))
    + umbrage_coarse(sun[0], position, normal, 3u).xyxy + umbrage_footprint(sun[0], position, normal, 3, 2.5).xyxy
    + umbrage_penumbra(sun[1], position, normal, 3, 0.01).xyxy; }
"""
GLSL = """layout(local_size_x = 64) in;
layout(std430, set = 1, binding = 0) buffer Points { UmbragePlacement sun; vec4 points[]; };
void main() { uint i = gl_GlobalInvocationID.x; points[i] = vec4(umbrage_box(sun, points[i].xyz, vec3(0.0), 9),
    umbrage_tent(sun, points[i].xyz, vec3(0.0), 5)) + umbrage_coarse(sun, points[i].xyz, vec3(0.0), 3u).xyxy
    + umbrage_footprint(sun, points[i].xyz, vec3(0.0), 3, 2.5).xyxy + umbrage_penumbra(sun, points[i].xyz, vec3(0.0), 3, 0.01).xyxy; }
"""
HLSL = """cbuffer Lights : register(b0) { UmbragePlacement sun; };
RWStructuredBuffer<float4> points : register(u1);
[numthreads(64, 1, 1)] void main(uint3 id : SV_DispatchThreadID) { points[id.x] =
    float4(umbrage_box(sun, points[id.x].xyz, float3(0, 0, 0), 9), umbrage_tent(sun, points[id.x].xyz, float3(0, 0, 0), 5))
    + umbrage_coarse(sun, points[id.x].xyz, float3(0, 0, 0), 3u).xyxy + umbrage_footprint(sun, points[id.x].xyz, float3(0, 0, 0), 3, 2.5).xyxy
    + umbrage_penumbra(sun, points[id.x].xyz, float3(0, 0, 0), 3, 0.01).xyxy; }
"""
with open(os.path.join(ut.ROOT, "docs", "examples", "cuda_shadows.cu"), encoding="utf-8") as example_file:
    CUDA = example_file.read()
NVCC = shutil.which("nvcc") or "/usr/local/cuda/bin/nvcc"
# Name, compiler, include and what stands before and behind it, file, options.
SHADERS = [
    ("GLSL ES 3.00", "glslangValidator", "umbrage_es.glsl", "#version 300 es\nprecision highp float;\nprecision highp int;\n",
     ES, "shader.frag", []),
    ("GLSL 4.50", "glslangValidator", "umbrage.glsl", "#version 450\n", GLSL, "shader.comp", ["-V", "-o", os.devnull]),
    ("HLSL", "glslangValidator", "umbrage.hlsl", "", HLSL, "shader.hlsl",
     ["-V", "-D", "-e", "main", "-S", "comp", "-o", os.devnull]),
    ("CUDA", NVCC, None, CUDA, "", "shader.cu", ["-Werror", "all-warnings", "-c", "-o", os.devnull, "-I", INCLUDES, "-I", os.path.join(ut.ROOT, "client", "include")]),
    ("C++", "g++", None, '#include "umbrage.cuh"\n', "", "shader.cc",
     ["-std=c++11", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-fsyntax-only", "-I", INCLUDES]),
]



def vulkan_lacks():
    """What the Vulkan example needs and is not here, or None."""
    if shutil.which("glslangValidator") is None:
        return "glslangValidator is not installed"
    if subprocess.run(["pkg-config", "--exists", "vulkan"], check=False).returncode != 0:
        return "libvulkan-dev is not installed"
    return None if glob.glob("/usr/share/vulkan/icd.d/*.json") else "there is no Vulkan driver (mesa-vulkan-drivers)"


def check_vulkan(test):
    """Each answer of the example is that of `umbrage query`, unless the look-up is next to a voxel's border."""
    example, points, count = os.path.join(ut.ROOT, "docs", "examples"), test.path("points.f32"), 40000
    scene = test.scene("city", 6)
    test.bake(scene, test.path("city.umb"), "--resolution", 2048, "--verify", 0)
    ut.run("umbrage", "points", scene, "-o", points, "--count", count, "--normals", "--quiet")
    ut.run("umbrage", "query", test.path("city.umb"), "--points", points, "--format", "f32", "--normals", "--encoding",
           "f32", "-o", test.path("expected.f32"), "--taps", 9, "--quiet")
    ut.run("gpu_voxels", test.path("city.umb"), points, 0, 9, 0, test.path("places"))
    subprocess.run(["glslangValidator", "-V", "-I" + INCLUDES, os.path.join(example, "vulkan_shadows.comp"), "-o",
                    test.path("shadows.spv")], check=True, stdout=subprocess.DEVNULL)
    subprocess.run(["gcc", "-std=c11", "-Wall", "-Wextra", "-Werror", "-I" + os.path.join(ut.ROOT, "client", "include"),
                    os.path.join(example, "vulkan_shadows.c"), os.path.join(ut.BUILD, "libumbrage-core.a"), "-lvulkan",
                    "-lxxhash", "-lzstd", "-lm", "-o", test.path("shadows")], check=True)
    done = subprocess.run([test.path("shadows"), test.path("city.umb"), points, test.path("shadows.spv")],
                          stdout=subprocess.PIPE, timeout=120, check=True)
    with open(test.path("expected.f32"), "rb") as file:
        expected = struct.unpack(f"<{count}f", file.read())
    with open(test.path("places"), "rb") as file:
        places = list(struct.iter_unpack("<4i2f", file.read()))
    answers = struct.unpack(f"<{count}f", done.stdout)
    differ = [i for i in range(count) if answers[i] != expected[i]]
    assert len(set(expected)) > 40, "points that do not test anything"
    for i in differ:
        assert min(places[i][4:]) < 1 / 256, f"point {i}: {answers[i]}, not {expected[i]}: {places[i]}"
    print(f"{len(differ)} of {count} answers differ, next to a border")


# Options of the bake: by voxels, and by the effect's words.
RULES = {"open": ["--closed", "off"], "closed": ["--closed", "on", "--effect", "front=on"]}
# Filter, taps and width: narrow and wide penumbras; footprints of one level and of several.
WIDE = [("penumbra", 3, 0.05), ("penumbra", 9, 0.2), ("penumbra", 3, 0.6), ("footprint", 3, 0.5), ("footprint", 9, 20)]


def check_wide(test, rule):
    """Penumbras and footprints of the shaders as C are those of the core, on voxels and on occluder depths."""
    scene, count = test.scene("houses", 12), 5000
    test.bake(scene, test.path(f"{rule}.umb"), "--resolution", 2048, "--verify", 0, *RULES[rule])
    ut.run("umbrage", "points", scene, "-o", test.path("houses.f32"), "--count", count, "--normals", "--quiet")
    for filter_name, taps, width in WIDE:
        words = ut.run("gpu_answers", test.path(f"{rule}.umb"), test.path("houses.f32"), filter_name, taps, width).stdout.split()
        print(rule, filter_name, taps, width, *(word.decode() for word in words))
        assert int(words[0]) == count and int(words[1]) > count // 100, "points that do not test anything"
        assert int(words[3]) == 0, "with the core's voxels no share differs by more than 2^-12"
        assert int(words[5]) <= count // 1000, "with its own voxels few shares differ, next to a border"


test = ut.Test()
for rule in RULES:
    with test.check(f"penumbras and footprints of the shaders are the core's: {rule}"):
        check_wide(test, rule)
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
PACKAGE = os.path.join(ut.BUILD, "web", "umbrage", "shaders.js")
if shutil.which("node") is None or not os.path.exists(PACKAGE):
    ut.left_out("the package's WGSL", "node or the package umbrage is not there")
else:
    with test.check("the package makes the WGSL of umbrage.wgsl"):
        made = subprocess.run(["node", "--input-type=module", "-e", "const { wgsl } = await import(process.argv[1]); process.stdout.write(wgsl);",
                               PACKAGE], stdout=subprocess.PIPE, timeout=60, check=True).stdout.decode()
        with open(os.path.join(INCLUDES, "umbrage.wgsl"), encoding="utf-8") as file:
            names = shaders.short_names(shaders.read(os.path.join(ut.ROOT, "client", "gpu", "walk.shader")))
            assert made == shaders.shorten(file.read(), names), "make web is older than make gpu, or wgsl.js differs from to_wgsl"
lacks = "the core is built with sanitizers" if ut.is_sanitized() else vulkan_lacks()
if lacks:
    ut.left_out("the Vulkan example", lacks)
else:
    with test.check("the Vulkan example answers as the file does"):
        check_vulkan(test)
test.finish()
