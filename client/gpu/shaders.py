#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Makes the shader includes of all languages from walk.shader.

    shaders.py walk.shader FOLDER    writes umbrage.wgsl, umbrage_es.glsl, umbrage.glsl, umbrage.hlsl, umbrage.cuh and
                                     shaders.js, a module that has the two texts for browsers

The source is GLSL of a narrow kind. GLSL takes it as it is; for the others names of types change, WGSL declares in its own
way, and CUDA and C get the array of entries as the first argument of each function that reads it.
"""
import os
import re
import sys

NOTE = "// SPDX-License-Identifier: Apache-2.0\n// Made by client/gpu/shaders.py of umbrage from walk.shader.\n"
VECTORS = {"uvec2": ("uint2", "vec2u"), "uvec4": ("uint4", "vec4u"), "ivec3": ("int3", "vec3i"), "ivec4": ("int4", "vec4i"),
           "vec2": ("float2", "vec2f"), "vec3": ("float3", "vec3f"), "vec4": ("float4", "vec4f")}
SCALARS = {"uint": ("uint32_t", "u32"), "int": ("int32_t", "i32"), "float": ("float", "f32"), "bool": ("bool", "bool")}
TYPE = r"(uint|int|float|bool|uvec2|uvec4|ivec3|ivec4|vec2|vec3|vec4|Umbrage\w+)"
FUNCTION = re.compile(rf"^{TYPE} (umbrage_\w+)\((.*)\)$", re.MULTILINE)

PUBLIC = ["UmbragePlacement"] + ["umbrage_" + name for name in (
    "box tent coarse lamp_box footprint penumbra place place_steps place_lamp count_box count_tent count_cell".split())]

# Reading an entry, and counting bits, in each language.
GLSL_ES = """#ifndef UMBRAGE_ES_GLSL
#define UMBRAGE_ES_GLSL
// Needs `#version 300 es` and highp floats and ints. The texture: RGBA32UI, 2048 entries a row.
uniform highp usampler2D umbrage_data;

uvec4 umbrage_load(uint entry)
{
    return texelFetch(umbrage_data, ivec2(int(entry & 2047u), int(entry >> 11u)), 0);
}

uint umbrage_bits(uint word)
{
    uint pairs = word - ((word >> 1u) & 0x55555555u);
    uint fours = (pairs & 0x33333333u) + ((pairs >> 2u) & 0x33333333u);
    return (((fours + (fours >> 4u)) & 0x0f0f0f0fu) * 0x01010101u) >> 24u;
}
"""
GLSL = """#ifndef UMBRAGE_GLSL
#define UMBRAGE_GLSL
// For Vulkan and OpenGL. Define where the buffer is bound before this file, or take set 0, binding 0.
#ifndef UMBRAGE_LAYOUT
#define UMBRAGE_LAYOUT std430, set = 0, binding = 0
#endif
layout(UMBRAGE_LAYOUT) readonly buffer UmbrageData {
    uvec4 umbrage_data[];
};

uvec4 umbrage_load(uint entry)
{
    return umbrage_data[entry];
}

uint umbrage_bits(uint word)
{
    return uint(bitCount(word));
}
"""
HLSL = """#ifndef UMBRAGE_HLSL
#define UMBRAGE_HLSL
// Define the register before this file, or take t0.
#ifndef UMBRAGE_REGISTER
#define UMBRAGE_REGISTER t0
#endif
StructuredBuffer<uint4> umbrage_data : register(UMBRAGE_REGISTER);

uint4 umbrage_load(uint entry)
{
    return umbrage_data[entry];
}

uint umbrage_bits(uint word)
{
    return countbits(word);
}
"""
WGSL = """// Change the next line if the buffer is bound elsewhere.
@group(0) @binding(0) var<storage, read> umbrage_data: array<vec4u>;

fn umbrage_load(entry: u32) -> vec4u
{
    return umbrage_data[entry];
}

fn umbrage_bits(word: u32) -> u32
{
    return countOneBits(word);
}
"""
C = """#ifndef UMBRAGE_GPU_SHADER_H
#define UMBRAGE_GPU_SHADER_H
// For CUDA, and for C and C++ on any processor. `data` is the array of entries.
#include <stdint.h>
#ifdef __CUDACC__
#define UMBRAGE_FUNCTION static __device__ inline
#else
#include <math.h>
#include <stdbool.h>
#define UMBRAGE_FUNCTION static inline __attribute__((unused))
@types@
#endif

UMBRAGE_FUNCTION uint4 umbrage_load(const uint4 *data, uint32_t entry)
{
#ifdef __CUDA_ARCH__
    return __ldg(data + entry);
#else
    return data[entry];
#endif
}

UMBRAGE_FUNCTION uint32_t umbrage_bits(uint32_t word)
{
#ifdef __CUDA_ARCH__
    return (uint32_t)__popc(word);
#else
    return (uint32_t)__builtin_popcount(word);
#endif
}
"""


def words(text, names):
    """Replaces whole words."""
    return re.sub(r"\b(" + "|".join(names) + r")\b", lambda found: names[found.group()], text)


def make_c_types():
    """The vectors that CUDA has of itself."""
    lines = []
    for name, _ in VECTORS.values():
        each = {"u": "uint32_t", "i": "int32_t", "f": "float"}[name[0]]
        members = "xyzw"[:int(name[-1])]
        lines.append(f"typedef struct {{\n    {each} {', '.join(members)};\n}} {name};\n"
                     f"UMBRAGE_FUNCTION {name} make_{name}({', '.join(f'{each} {m}' for m in members)})\n{{\n"
                     f"    {name} made = {{{', '.join(members)}}};\n    return made;\n}}")
    return "\n".join(lines)


def readers(source):
    """The functions that read entries, themselves or by a function that they call."""
    bodies = {found.group(2): source[found.end():source.index("\n}\n", found.end())] for found in FUNCTION.finditer(source)}
    reading = {"umbrage_load"}
    while True:
        more = {name for name, body in bodies.items() if reading & set(re.findall(r"umbrage_\w+", body))}
        if more <= reading:
            return reading
        reading |= more


def to_hlsl(source):
    return words(source, {glsl: hlsl for glsl, (hlsl, _) in VECTORS.items()})


def to_c(source):
    reading = "|".join(readers(source))
    source = re.sub(r"(\d\.\d+)\b", r"\1f", source)
    source = FUNCTION.sub(r"UMBRAGE_FUNCTION \1 \2(\3)", source)
    source = re.sub(r"\bUmbragePlacement (\w+\[6\])", r"const UmbragePlacement \1", source)
    source = re.sub(rf"^(UMBRAGE_FUNCTION \w+ (?:{reading})\()", r"\1const uint4 *data, ", source, flags=re.MULTILINE)
    source = re.sub(rf"\b({reading})\((?!const uint4)", r"\1(data, ", source)
    source = re.sub(r"\b(uint|int|float)\(", lambda found: f"({SCALARS[found.group(1)][0]})(", source)
    source = re.sub(r"\b(u?i?vec[234])\(", lambda found: f"make_{VECTORS[found.group(1)][0]}(", source)
    source = re.sub(r"^struct (Umbrage\w+) \{(.*?)^\};", r"typedef struct {\2} \1;", source, flags=re.MULTILINE | re.DOTALL)
    source = re.sub(r"\b(abs|sqrt|floor|tan)\(", lambda found: {"abs": "fabsf("}.get(found.group(1), found.group(1) + "f("), source)
    names = {glsl: hlsl for glsl, (hlsl, _) in VECTORS.items()} | {"uint": "uint32_t", "int": "int32_t"}
    return "\n".join(line if line.lstrip().startswith("//") else words(line, names) for line in source.split("\n"))


def to_wgsl(source):
    def head(found):
        arguments = [argument.split() for argument in found.group(3).split(", ")]
        arguments = [(f"array<{kind}, {name[-2]}>", name[:-3]) if name.endswith("]") else (kind, name) for kind, name in arguments]
        return f"fn {found.group(2)}({', '.join(f'{name}: {kind}' for kind, name in arguments)}) -> {found.group(1)}"

    source = FUNCTION.sub(head, source)
    source = re.sub(r"^struct (\w+) \{(.*?)^\};", lambda found: "struct %s {%s}" % (
        found.group(1), re.sub(rf"^    {TYPE} (\w+);", r"    \2: \1,", found.group(2), flags=re.MULTILINE)),
        source, flags=re.MULTILINE | re.DOTALL)
    source = re.sub(rf"^(\s+(?:for \()?){TYPE} (\w+)( =|;)", r"\1var \3: \2\4", source, flags=re.MULTILINE)
    names = {glsl: wgsl for table in (VECTORS, SCALARS) for glsl, (_, wgsl) in table.items()}
    return "\n".join(line if line.lstrip().startswith("//") else words(line, names) for line in source.split("\n"))


def short_names(source):
    """Short names for the functions and types that guide and tests do not name."""
    names = [found.group(2) for found in FUNCTION.finditer(source)] + re.findall(r"^struct (\w+)", source, re.MULTILINE)
    return {name: f"{name[0]}mb{number}" for number, name in enumerate(names) if name not in PUBLIC}


def shorten(text, names):
    """A text as it goes over the web: without comments, indents, and blanks and ends of lines that mean nothing."""
    text = re.sub(r"\n\s+", "\n", re.sub(r"\s*//.*", "", text)).strip()
    text = re.sub(r" ?(==|[|&]{2}|[-+|&]=|>>|<<|(?<!-)>|[=,*+/;&|<]) ?", r"\1", text.replace("\n{", "{"))
    return words(re.sub(r"([{};,])\n(?!#)", r"\1", text), names)


def make(source):
    """The texts by the names of their files."""
    end = "\n#endif\n"
    texts = {"umbrage.wgsl": NOTE + WGSL + to_wgsl(source), "umbrage_es.glsl": NOTE + GLSL_ES + source + end,
             "umbrage.glsl": NOTE + GLSL + source + end, "umbrage.hlsl": NOTE + HLSL + to_hlsl(source) + end,
             "umbrage.cuh": NOTE + C.replace("@types@", make_c_types()) + to_c(source) + end}
    names = short_names(source)
    # The package has the walk once: its wgsl.js does what to_wgsl does.
    texts["shaders.js"] = (NOTE + 'import { toWgsl } from "./wgsl.js";\n\n' + f"const walk = `{shorten(source, names)}`;\n" +
                           f"export const glsl = `{shorten(GLSL_ES, names)}\n${{walk}}\n#endif\n`;\n" +
                           f"export const wgsl = `{shorten(WGSL, names)}` + toWgsl(walk);\n")
    return texts


def read(path):
    """The source without the line of its licence."""
    with open(path, encoding="utf-8") as file:
        return "\n" + file.read().split("\n", 1)[1]


def main():
    source, folder = sys.argv[1:]
    text = read(source)
    os.makedirs(folder, exist_ok=True)
    for name, made in make(text).items():
        with open(os.path.join(folder, name), "w", encoding="utf-8") as file:
            file.write(made)


if __name__ == "__main__":
    main()
