// SPDX-License-Identifier: Apache-2.0
// Where bytes come from: read(offset, length, signal) gives a Uint8Array, shorter only at the end.
import { UmbrageError, require } from "./errors.js";

const STALL_MS = 30_000; // A server that sends nothing for this long is given up
const PARALLEL = 6; // Requests at a time: browsers open no more connections to a server
const CODES = { 401: "E_UNAUTHENTICATED", 403: "E_PERMISSION", 404: "E_NOT_FOUND", 410: "E_NOT_FOUND" };
const ADDRESS = /^[a-z][a-z0-9+.-]*:\/\//i;

/** Collects a body of at most `length` bytes; `alive` is called for each part. */
async function collect(response, length, alive) {
  const reader = response.body.getReader(), bytes = new Uint8Array(length);
  let at = 0;
  for (;;) {
    const { done, value } = await reader.read();
    if (done) {
      return bytes.subarray(0, at);
    }
    alive();
    if (value.length > length - at) {
      await reader.cancel();
      throw new UmbrageError("E_PROTOCOL", `${response.url}: sends more than the ${length} bytes asked for`);
    }
    bytes.set(value, at);
    at += value.length;
  }
}

/** Ranges of a file from a web server. */
class HttpSource {
  parallel = PARALLEL;
  #url;
  #headers;
  #apart;
  #whole_bytes;
  #whole = null; // The file, from a server without ranges

  constructor(url, headers, apart, whole_bytes) {
    this.#url = url;
    this.#headers = headers;
    this.#apart = apart;
    this.#whole_bytes = whole_bytes;
  }

  /** Bytes of the whole file, if that is what came. */
  get received_bytes() {
    return this.#whole?.length;
  }

  /** Address of a range. Browsers with a cache ask for ranges of one address one after the other. */
  #addressOf(offset) {
    if (!this.#apart) {
      return this.#url;
    }
    const address = new URL(this.#url, globalThis.location?.href);
    address.searchParams.append("from", offset);
    return address;
  }

  async read(offset, length, signal) {
    if (this.#whole) {
      return this.#whole.subarray(offset, offset + length);
    }
    const ours = new AbortController();
    const stop = () => ours.abort(signal.reason);
    let timer, stalled = false;
    const alive = () => {
      const begun = performance.now();
      clearTimeout(timer);
      timer = setTimeout(() => {
        if (performance.now() - begun > 1.1 * STALL_MS) { // The page was busy, and what came is not handled yet
          alive();
          return;
        }
        stalled = true;
        ours.abort();
      }, STALL_MS);
    };
    signal?.throwIfAborted();
    signal?.addEventListener("abort", stop);
    alive();
    try {
      return await this.#request(offset, length, ours, alive);
    } catch (cause) {
      if (signal?.aborted || cause instanceof UmbrageError) {
        throw cause;
      }
      const message = stalled ? `sent nothing for ${STALL_MS / 1000} s` : cause.message;
      throw new UmbrageError("E_UNAVAILABLE", `${this.#url}: ${message}`, { cause });
    } finally {
      clearTimeout(timer);
      signal?.removeEventListener("abort", stop);
    }
  }

  async #request(offset, length, ours, alive) {
    const response = await fetch(this.#addressOf(offset), {
      headers: { ...this.#headers, Range: `bytes=${offset}-${offset + length - 1}` },
      signal: ours.signal,
    });
    if (response.ok && response.status !== 206) {
      this.#whole = await this.#takeWhole(response, ours, alive);
      return this.#whole.subarray(offset, offset + length);
    }
    if (response.status !== 206) {
      ours.abort();
      throw new UmbrageError(CODES[response.status] ?? "E_UNAVAILABLE", `${this.#url}: status ${response.status}`);
    }
    // Servers of another origin show this header only if they say so.
    const place = /^bytes (\d+)-/.exec(response.headers.get("Content-Range") ?? "");
    if (place && Number(place[1]) !== offset) {
      ours.abort();
      throw new UmbrageError("E_PROTOCOL", `${this.#url}: sends byte ${place[1]}, asked for ${offset}`);
    }
    return collect(response, length, alive);
  }

  /** Takes the whole file from a server that answers a range with it. */
  async #takeWhole(response, ours, alive) {
    const most = this.#whole_bytes, size = Number(response.headers.get("Content-Length") || Infinity);
    if (!(size <= most)) {
      ours.abort();
      throw new UmbrageError("E_UNSUPPORTED", `${this.#url}: the server knows no byte ranges (status ${response.status} ` +
        `to a request of one), and the file has ${size < Infinity ? size : "an unknown number of"} bytes; whole_bytes ` +
        `allows ${most}`);
    }
    return collect(response, size, alive);
  }
}

/** A file that the user chose. */
class BlobSource {
  parallel = 1;
  #blob;

  constructor(blob) {
    this.#blob = blob;
  }

  async read(offset, length) {
    return new Uint8Array(await this.#blob.slice(offset, offset + length).arrayBuffer());
  }
}

class BytesSource {
  parallel = 1;
  #bytes;

  constructor(bytes) {
    this.#bytes = bytes;
  }

  async read(offset, length) {
    return this.#bytes.subarray(offset, offset + length);
  }
}

/** A file, in node. */
class FileSource {
  parallel = 1;
  #file;

  constructor(file) {
    this.#file = file;
  }

  static async make(path) {
    const { open } = await import("node:fs/promises");
    try {
      return new FileSource(await open(path));
    } catch (cause) {
      throw new UmbrageError("E_NO_INPUT", `${path}: ${cause.message}`, { cause });
    }
  }

  async read(offset, length) {
    const bytes = new Uint8Array(length);
    let at = 0, got = 1;
    while (at < length && got > 0) {
      got = (await this.#file.read(bytes, at, length - at, offset + at)).bytesRead;
      at += got;
    }
    return bytes.subarray(0, at);
  }

  async close() {
    await this.#file.close();
  }
}

/** The source of what `open` was given. */
export async function sourceOf(where, { headers, apart = false, whole_bytes = 0 } = {}) {
  const in_node = typeof process === "object" && Boolean(process.versions?.node);
  const address = where instanceof URL ? where.href : where;
  if (typeof address === "string") {
    if (in_node && (!ADDRESS.test(address) || address.startsWith("file:"))) {
      return FileSource.make(ADDRESS.test(address) ? new URL(address) : address);
    }
    require(Number.isSafeInteger(whole_bytes) && whole_bytes >= 0, `whole_bytes: ${whole_bytes}, must be a number of bytes`);
    return new HttpSource(address, headers, apart, whole_bytes);
  }
  if (typeof Blob === "function" && where instanceof Blob) {
    return new BlobSource(where);
  }
  if (where instanceof ArrayBuffer || where instanceof Uint8Array) {
    return new BytesSource(new Uint8Array(where));
  }
  require(typeof where?.read === "function", "where: must be an address, a file, bytes or a source");
  return where;
}
