// SPDX-License-Identifier: Apache-2.0
// Shadows in shaders: the text of the shaders, and an asset's entries in a texture or buffer. See gpu.d.ts and
// docs/guide/gpu.md of umbrage.
import { require } from "./errors.js";
import { glsl, wgsl } from "./shaders.js";

export { glsl, wgsl };

const ENTRY_BYTES = 16;
const ROW = 2048; // Entries of a row of the texture

/** The WGSL text with the buffer at another binding. */
export function wgslAt(group, binding) {
  return wgsl.replace("@group(0) @binding(0)", `@group(${group}) @binding(${binding})`);
}

/** Calls put(first, count, words) for each range of changed entries. */
function eachRange({ ranges, words }, put) {
  for (let i = 0, done = 0; i < ranges.length; i += 2) {
    const count = ranges[i + 1], size = count * ENTRY_BYTES / 4;
    put(ranges[i], count, words.subarray(done, done + size));
    done += size;
  }
}

/** An asset's entries in a WebGL2 texture. */
export class WebGLNodes {
  /** The texture: RGBA32UI. Another one after apply() if more entries came than it has room for. */
  texture = null;
  bytes_sent = 0;
  #gl;
  #rows = 0;

  constructor(gl) {
    this.#gl = gl;
  }

  /** Copies what changed. `changes`: what asset.changes() gave, in their order. Restores the bound texture. */
  apply(changes) {
    const gl = this.#gl, bound = gl.getParameter(gl.TEXTURE_BINDING_2D), before = this.texture;
    const buffer = gl.getParameter(gl.PIXEL_UNPACK_BUFFER_BINDING), stores = [];
    for (const [name, value] of [["UNPACK_ALIGNMENT", 4], ["UNPACK_ROW_LENGTH", 0], ["UNPACK_SKIP_ROWS", 0],
      ["UNPACK_SKIP_PIXELS", 0], ["UNPACK_FLIP_Y_WEBGL", false], ["UNPACK_PREMULTIPLY_ALPHA_WEBGL", false]]) {
      stores.push([gl[name], gl.getParameter(gl[name])]);
      gl.pixelStorei(gl[name], value);
    }
    gl.bindBuffer(gl.PIXEL_UNPACK_BUFFER, null);
    this.#fit(changes.capacity);
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    eachRange(changes, (first, count, words) => this.#put(first, count, words));
    gl.bindTexture(gl.TEXTURE_2D, bound === before ? this.texture : bound); // `before` may be deleted
    gl.bindBuffer(gl.PIXEL_UNPACK_BUFFER, buffer);
    for (const [name, value] of stores) {
      gl.pixelStorei(name, value);
    }
  }

  /** Makes a texture with room for `capacity` entries, unless the present one has that size. */
  #fit(capacity) {
    const gl = this.#gl, rows = Math.ceil(capacity / ROW), most = gl.getParameter(gl.MAX_TEXTURE_SIZE);
    if (rows === this.#rows) {
      return;
    }
    require(rows <= most, `asset: ${rows} rows of ${ROW} entries, textures have at most ${most}`);
    this.dispose();
    this.texture = gl.createTexture();
    this.#rows = rows;
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32UI, ROW, rows);
    for (const [name, value] of [["MIN_FILTER", "NEAREST"], ["MAG_FILTER", "NEAREST"], ["WRAP_S", "CLAMP_TO_EDGE"],
      ["WRAP_T", "CLAMP_TO_EDGE"]]) {
      gl.texParameteri(gl.TEXTURE_2D, gl[`TEXTURE_${name}`], gl[value]);
    }
  }

  /** Copies a range: the rest of a row, whole rows, the begin of a row. */
  #put(first, count, words) {
    const gl = this.#gl, end = first + count;
    this.bytes_sent += count * ENTRY_BYTES;
    for (let at = first; at < end;) {
      const x = at % ROW, rows = x === 0 ? Math.floor((end - at) / ROW) : 0;
      const width = rows > 0 ? ROW : Math.min(ROW - x, end - at), height = Math.max(rows, 1);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, x, Math.floor(at / ROW), width, height, gl.RGBA_INTEGER, gl.UNSIGNED_INT,
        words, (at - first) * 4);
      at += width * height;
    }
  }

  dispose() {
    this.#gl.deleteTexture(this.texture);
    this.texture = null;
    this.#rows = 0;
  }
}

/** An asset's entries in a WebGPU buffer. */
export class WebGPUNodes {
  /** The storage buffer. Another one after apply() if more entries came than it has room for. */
  buffer = null;
  bytes_sent = 0;
  #device;

  constructor(device) {
    this.#device = device;
  }

  /** Copies what changed. `changes`: what asset.changes() gave, in their order. */
  apply(changes) {
    const size = changes.capacity * ENTRY_BYTES, most = this.#device.limits.maxStorageBufferBindingSize;
    if (this.buffer?.size !== size) {
      require(size <= most, `asset: ${size} bytes, storage buffers of this device have at most ${most}`);
      this.dispose();
      this.buffer = this.#device.createBuffer({ size, usage: 0x80 | 0x8 }); // STORAGE and COPY_DST
    }
    eachRange(changes, (first, count, words) => {
      this.#device.queue.writeBuffer(this.buffer, first * ENTRY_BYTES, words);
      this.bytes_sent += count * ENTRY_BYTES;
    });
  }

  dispose() {
    this.buffer?.destroy();
    this.buffer = null;
  }
}

const places = new WeakMap(); // Of uniforms, by program, name and field

/** Sets a uniform of type UmbragePlacement of the program in use. `name` may be that of an array's element. */
export function setPlacement(gl, program, name, { fields }) {
  const known = places.get(program) ?? new Map();
  places.set(program, known);
  for (const [field, values] of Object.entries(fields)) {
    const key = `${name}.${field}`;
    if (!known.has(key)) {
      known.set(key, gl.getUniformLocation(program, key));
    }
    const place = known.get(key), set = values instanceof Float32Array ? "uniform4fv" : values instanceof Int32Array ? "uniform4iv" : "uniform4uiv";
    gl[set](place, values);
  }
}
