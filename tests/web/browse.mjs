// SPDX-License-Identifier: Apache-2.0
// The suite in a browser; the test's server has the package, the assets and the configuration.
import * as umbrage from "/package/index.js";
import { run } from "./suite.mjs";

export async function browse(place) {
  const read = async (name) => (await fetch(`/files/${name}`)).arrayBuffer();
  try {
    const config = await (await fetch(`/files/${place}.json`)).json();
    const shared = typeof SharedArrayBuffer;
    const checks = await run(umbrage, config, read, (name) => `/files/${name}`);
    return [{ name: `no SharedArrayBuffer: ${shared}`, ok: shared === "undefined", detail: "" }, ...checks];
  } catch (error) {
    return [{ name: `${place} runs`, ok: false, detail: String(error.stack ?? error) }];
  }
}
