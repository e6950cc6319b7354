// SPDX-License-Identifier: Apache-2.0
// The WebAssembly module: loading, and calls with their errors. One instance holds one asset.
import { UmbrageError } from "./errors.js";

const IN_NODE = typeof process === "object" && Boolean(process.versions?.node);
const TEXT_BYTES = 512; // Room for the longest text that is passed
const compiled = new Map(); // WebAssembly.Module promises by address

async function compile(address) {
  const url = new URL(address);
  if (IN_NODE && url.protocol === "file:") {
    const { readFile } = await import("node:fs/promises");
    return WebAssembly.compile(await readFile(url));
  }
  const response = await fetch(url);
  if (!response.ok) {
    throw new UmbrageError("E_UNAVAILABLE", `${url}: status ${response.status}`);
  }
  // compileStreaming refuses servers that do not know the type application/wasm.
  return WebAssembly.compile(await response.arrayBuffer());
}

/** The module at an address, compiled once; by default the file beside this one. */
function load(wasm) {
  if (wasm instanceof WebAssembly.Module) {
    return wasm;
  }
  const address = String(wasm ?? new URL("umbrage.wasm", import.meta.url));
  if (!compiled.has(address)) {
    const made = compile(address);
    compiled.set(address, made);
    made.catch(() => compiled.delete(address));
  }
  return compiled.get(address);
}

/** An instance, and its memory as typed arrays. Memory moves when it grows: arrays are made anew. */
export class Module {
  #exports;
  #text;

  static async make(wasm) {
    return new Module(await WebAssembly.instantiate(await load(wasm), {}));
  }

  constructor(instance) {
    this.#exports = instance.exports;
    this.#exports._initialize?.();
    this.#text = this.room(TEXT_BYTES);
  }

  /** Calls a function that returns no status. */
  call(name, ...values) {
    try {
      return this.#exports[`umbx_${name}`](...values);
    } catch (cause) {
      throw new UmbrageError("E_INTERNAL", `${name}: the module failed: ${cause.message}`, { cause });
    }
  }

  /** Calls a function that returns a status. Throws unless it is 0. */
  run(name, ...values) {
    const status = this.call(name, ...values);
    if (status !== 0) {
      throw new UmbrageError(this.text(this.call("status_name", status)), this.text(this.call("message")));
    }
  }

  /** Allocates bytes; returns their place. */
  room(bytes) {
    const at = this.call("room", bytes);
    if (at === 0) {
      throw new UmbrageError("E_NO_MEMORY", `module: no memory for ${bytes} bytes`);
    }
    return at;
  }

  release(at) {
    this.call("release", at);
  }

  bytes(at, count) {
    return new Uint8Array(this.#exports.memory.buffer, at, count);
  }

  floats(at, count) {
    return new Float32Array(this.#exports.memory.buffer, at, count);
  }

  words(at, count) {
    return new Uint32Array(this.#exports.memory.buffer, at, count);
  }

  /** The block of numbers that functions take and give beside their arguments. */
  numbers(count) {
    return new Float64Array(this.#exports.memory.buffer, this.call("numbers"), count);
  }

  /** Bytes of the module's memory, which never shrinks. */
  get memoryBytes() {
    return this.#exports.memory.buffer.byteLength;
  }

  text(at) {
    const bytes = new Uint8Array(this.#exports.memory.buffer);
    return new TextDecoder().decode(bytes.slice(at, bytes.indexOf(0, at)));
  }

  /** Passes up to two short texts; returns their places. */
  #put(first, second) {
    const room = this.bytes(this.#text, TEXT_BYTES), half = TEXT_BYTES / 2;
    room.fill(0);
    for (const [index, text] of [first, second].entries()) {
      new TextEncoder().encodeInto(text, room.subarray(index * half, (index + 1) * half - 1));
    }
    return [this.#text, this.#text + half];
  }

  /** Sets a setting of queries: a number, a word, or an array of three numbers. */
  set(name, value) {
    const values = Array.isArray(value) ? value : [value];
    for (const [index, one] of values.entries()) {
      const [at, word] = this.#put(name, String(one));
      if (typeof one === "string") {
        this.run("set_word", at, word);
      } else {
        this.run("set", at, index, Number(one));
      }
    }
  }

  /** Copies bytes in, calls use(place), and frees the copy. */
  lend(bytes, use) {
    const at = this.room(bytes.length);
    try {
      this.bytes(at, bytes.length).set(bytes);
      return use(at);
    } finally {
      this.release(at);
    }
  }
}
