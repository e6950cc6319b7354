// SPDX-License-Identifier: Apache-2.0
// Shaders that answer points, in WebGL2 and in WebGPU. Both have the same functions:
//
//     engine.apply(changes)          entries of the asset
//     engine.points(points, count)   six floats each
//     engine.voxels(voxels)          four ints each: voxel, and 1 if the point faces away
//     await engine.run({ filter, taps, level, alike, width }, placement)   Uint32Array: counts low and high of each point;
//                                    of penumbras and footprints, which have a width, the bits of floats, and only for
//                                    each `every`-th group of 64 points
import * as gpu from "/package/gpu.js";

const WIDTH = 1280;
const FILTERS = { box: 0, tent: 1, coarse: 2, penumbra: 3, footprint: 4 };

// The same shader in both languages. alike: 1 = answers at the given voxel instead of the shader's
// own.
const GLSL = `#version 300 es
precision highp float;
precision highp int;
${gpu.glsl}
uniform highp sampler2D positions;
uniform highp sampler2D normals;
uniform highp isampler2D voxels;
uniform UmbragePlacement at[2];
uniform ivec4 ask; // filter, taps, level, alike
uniform float width;
uniform int every;
out uvec4 result;

void main()
{
    ivec2 texel = ivec2(gl_FragCoord.xy);
    ivec4 place = texelFetch(voxels, texel, 0);
    vec3 normal = texelFetch(normals, texel, 0).xyz;
    vec3 position = texelFetch(positions, texel, 0).xyz;
    place.w *= 2;
    if (ask.x > 2 && (texel.x + texel.y * ${WIDTH}) / 64 % every != 0) {
        result = uvec4(0u);
        return;
    }
    if (ask.x > 2) {
        vec2 share = ask.x == 3 ? umbrage_penumbra(at[1], position, normal, ask.y, width)
                                : umbrage_footprint(at[1], position, normal, ask.y, width);
        result = uvec4(floatBitsToUint(share), 0u, 0u);
        return;
    }
    if (ask.w == 0) {
        float steps = ask.x == 2 ? float(2 << ask.z) : 1.0;
        place = umbrage_place_steps(at[1], position, normal, float(ask.y), steps);
    }
    uint frustum = uint(at[1].info.y);
    uvec2 count = uvec2(0u);
    if (place.w != 2) {
        if (ask.x == 0) {
            count = umbrage_count_box(frustum, place.xyz, ask.y);
        } else if (ask.x == 1) {
            count = umbrage_count_tent(frustum, place.xyz, ask.y);
        } else {
            count = umbrage_count_cell(frustum, place.xyz, uint(ask.z));
        }
    }
    result = uvec4(count, place.w, 0u);
}`;

const WGSL = `${gpu.wgslAt(1, 3)}
struct Ask {
    at: UmbragePlacement,
    filtering: vec4i, // filter, taps, level, alike
    points: vec4u,    // number, bits of the width, every
}
@group(0) @binding(0) var<uniform> ask: Ask;
@group(0) @binding(1) var<storage, read> points: array<f32>;
@group(0) @binding(2) var<storage, read> voxels: array<vec4i>;
@group(0) @binding(3) var<storage, read_write> result: array<vec2u>;

@compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3u)
{
    let i = id.x;
    if (i >= ask.points.x || (ask.filtering.x > 2 && i / 64 % ask.points.z != 0)) {
        return;
    }
    var place = voxels[i];
    place.w *= 2;
    let position = vec3f(points[6 * i], points[6 * i + 1], points[6 * i + 2]);
    let normal = vec3f(points[6 * i + 3], points[6 * i + 4], points[6 * i + 5]);
    if (ask.filtering.x > 2) {
        let width = bitcast<f32>(ask.points.y);
        var share = vec2f(0.0, 0.0);
        if (ask.filtering.x == 3) {
            share = umbrage_penumbra(ask.at, position, normal, ask.filtering.y, width);
        } else {
            share = umbrage_footprint(ask.at, position, normal, ask.filtering.y, width);
        }
        result[i] = bitcast<vec2u>(share);
        return;
    }
    if (ask.filtering.w == 0) {
        let steps = select(1.0, f32(2u << u32(ask.filtering.z)), ask.filtering.x == 2);
        place = umbrage_place_steps(ask.at, position, normal, f32(ask.filtering.y), steps);
    }
    let frustum = u32(ask.at.info.y);
    var count = vec2u(0, 0);
    if (place.w != 2) {
        switch (ask.filtering.x) {
            case 0: { count = umbrage_count_box(frustum, place.xyz, ask.filtering.y); }
            case 1: { count = umbrage_count_tent(frustum, place.xyz, ask.filtering.y); }
            default: { count = umbrage_count_cell(frustum, place.xyz, u32(ask.filtering.z)); }
        }
    }
    result[i] = count;
}`;

export class WebGL {
  #gl = document.createElement("canvas").getContext("webgl2");
  #count = 0;
  #rows = 0;
  #textures = {};

  static async make() {
    const engine = new WebGL();
    return engine.#gl ? engine : null;
  }

  constructor() {
    const gl = this.#gl;
    if (!gl) {
      return;
    }
    this.nodes = new gpu.WebGLNodes(gl);
    this.program = gl.createProgram();
    const corner = "#version 300 es\nvoid main() { gl_Position = vec4(vec2((gl_VertexID & 1) * 4 - 1, (gl_VertexID & 2) * 2 - 1), 0, 1); }";
    for (const [kind, text] of [[gl.VERTEX_SHADER, corner], [gl.FRAGMENT_SHADER, GLSL]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) {
        throw new Error(gl.getShaderInfoLog(shader));
      }
      gl.attachShader(this.program, shader);
    }
    gl.linkProgram(this.program);
    gl.useProgram(this.program);
  }

  apply(changes) {
    this.nodes.apply(changes);
  }

  get bytes_sent() {
    return this.nodes.bytes_sent;
  }

  #put(name, unit, internal, format, type, words) {
    const gl = this.#gl;
    this.#textures[name] ??= gl.createTexture();
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, this.#textures[name]);
    gl.texImage2D(gl.TEXTURE_2D, 0, internal, WIDTH, this.#rows, 0, format, type, words);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    gl.uniform1i(gl.getUniformLocation(this.program, name), unit);
  }

  points(points, count) {
    const gl = this.#gl;
    this.#count = count;
    this.#rows = Math.ceil(count / WIDTH);
    for (const [unit, name] of ["positions", "normals"].entries()) {
      const words = new Float32Array(4 * WIDTH * this.#rows);
      for (let i = 0; i < count; i++) {
        words.set(points.subarray(6 * i + 3 * unit, 6 * i + 3 * unit + 3), 4 * i);
      }
      this.#put(name, 1 + unit, gl.RGBA32F, gl.RGBA, gl.FLOAT, words);
    }
  }

  voxels(voxels) {
    const words = new Int32Array(4 * WIDTH * this.#rows), gl = this.#gl;
    words.set(voxels);
    this.#put("voxels", 3, gl.RGBA32I, gl.RGBA_INTEGER, gl.INT, words);
  }

  async run({ filter, taps, level, alike, width = 0, every = 1 }, placement) {
    const gl = this.#gl;
    if (!this.frame) {
      gl.activeTexture(gl.TEXTURE4);
      gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
      gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32UI, WIDTH, this.#rows);
      this.frame = gl.createFramebuffer();
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, gl.getParameter(gl.TEXTURE_BINDING_2D), 0);
      gl.viewport(0, 0, WIDTH, this.#rows);
    }
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, this.nodes.texture);
    gl.uniform1i(gl.getUniformLocation(this.program, "umbrage_data"), 0);
    gpu.setPlacement(gl, this.program, "at[1]", placement);
    gl.uniform4i(gl.getUniformLocation(this.program, "ask"), FILTERS[filter], taps, level, alike ? 1 : 0);
    gl.uniform1f(gl.getUniformLocation(this.program, "width"), width);
    gl.uniform1i(gl.getUniformLocation(this.program, "every"), every);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    const all = new Uint32Array(4 * WIDTH * this.#rows), counts = new Uint32Array(2 * this.#count);
    gl.readPixels(0, 0, WIDTH, this.#rows, gl.RGBA_INTEGER, gl.UNSIGNED_INT, all);
    if (gl.getError() !== gl.NO_ERROR) {
      throw new Error("WebGL reports an error");
    }
    for (let i = 0; i < this.#count; i++) {
      counts[2 * i] = all[4 * i];
      counts[2 * i + 1] = all[4 * i + 1];
    }
    return counts;
  }
}

export class WebGPU {
  static async make() {
    const adapter = await navigator.gpu?.requestAdapter();
    if (!adapter) {
      return null;
    }
    const engine = new WebGPU();
    engine.device = await adapter.requestDevice();
    engine.device.onuncapturederror = (event) => {
      engine.error = event.error.message;
    };
    engine.nodes = new gpu.WebGPUNodes(engine.device);
    const module = engine.device.createShaderModule({ code: WGSL });
    const { messages } = await module.getCompilationInfo();
    if (messages.some((one) => one.type === "error")) {
      throw new Error(messages.map((one) => `${one.lineNum}: ${one.message}`).join("\n"));
    }
    engine.pipeline = await engine.device.createComputePipelineAsync({ layout: "auto", compute: { module, entryPoint: "main" } });
    return engine;
  }

  apply(changes) {
    this.nodes.apply(changes);
  }

  get bytes_sent() {
    return this.nodes.bytes_sent;
  }

  #buffer(words, usage) {
    const buffer = this.device.createBuffer({ size: words.byteLength, usage: usage | GPUBufferUsage.COPY_DST });
    this.device.queue.writeBuffer(buffer, 0, words);
    return buffer;
  }

  points(points, count) {
    this.count = count;
    this.position_buffer = this.#buffer(points, GPUBufferUsage.STORAGE);
    this.result_buffer = this.device.createBuffer({ size: 8 * count, usage: GPUBufferUsage.STORAGE | GPUBufferUsage.COPY_SRC });
    this.read_buffer = this.device.createBuffer({ size: 8 * count, usage: GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST });
  }

  voxels(voxels) {
    this.voxel_buffer?.destroy();
    this.voxel_buffer = this.#buffer(voxels, GPUBufferUsage.STORAGE);
  }

  async run({ filter, taps, level, alike, width = 0, every = 1 }, placement) {
    const { device, pipeline, count } = this, words = new Int32Array(56);
    words.set(new Int32Array(placement.bytes));
    words.set([FILTERS[filter], taps, level, alike ? 1 : 0, count], 48);
    new Float32Array(words.buffer)[53] = width;
    words[54] = every;
    const ask = this.#buffer(words, GPUBufferUsage.UNIFORM);
    const group = (number, buffers) => device.createBindGroup({ layout: pipeline.getBindGroupLayout(number),
      entries: buffers.map(([binding, buffer]) => ({ binding, resource: { buffer } })) });
    const encoder = device.createCommandEncoder(), pass = encoder.beginComputePass();
    pass.setPipeline(pipeline);
    pass.setBindGroup(0, group(0, [[0, ask], [1, this.position_buffer], [2, this.voxel_buffer], [3, this.result_buffer]]));
    pass.setBindGroup(1, group(1, [[3, this.nodes.buffer]]));
    pass.dispatchWorkgroups(Math.ceil(count / 64));
    pass.end();
    encoder.copyBufferToBuffer(this.result_buffer, 0, this.read_buffer, 0, 8 * count);
    device.queue.submit([encoder.finish()]);
    await this.read_buffer.mapAsync(GPUMapMode.READ);
    const counts = new Uint32Array(this.read_buffer.getMappedRange().slice(0));
    this.read_buffer.unmap();
    ask.destroy();
    if (this.error) {
      throw new Error(this.error);
    }
    return counts;
  }
}
