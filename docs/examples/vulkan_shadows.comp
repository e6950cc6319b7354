#version 450
// SPDX-License-Identifier: Apache-2.0
// Shares of light of points; vulkan_shadows.c says how to compile and run it.
#extension GL_GOOGLE_include_directive : require
#include "umbrage.glsl"

layout(local_size_x = 64) in;
layout(std430, set = 0, binding = 1) readonly buffer Points {
    float points[]; // x y z nx ny nz each
};
layout(std430, set = 0, binding = 2) writeonly buffer Light {
    float light[];
};
layout(std430, set = 0, binding = 3) readonly buffer Sun {
    UmbragePlacement sun;
    uint count;
    int taps;
};

void main()
{
    uint i = gl_GlobalInvocationID.x;
    if (i < count) {
        vec3 position = vec3(points[6u * i], points[6u * i + 1u], points[6u * i + 2u]);
        vec3 normal = vec3(points[6u * i + 3u], points[6u * i + 4u], points[6u * i + 5u]);
        light[i] = umbrage_box(sun, position, normal, taps).x;
    }
}
