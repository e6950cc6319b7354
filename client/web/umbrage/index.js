// SPDX-License-Identifier: Apache-2.0
// Shadow queries in browsers, workers and node: see index.d.ts, and docs/guide/web.md of umbrage.
import { Asset } from "./asset.js";
import { sourceOf } from "./sources.js";

export { Asset };
export { UmbrageError } from "./errors.js";

/** Opens an asset: reads its head and coarse pages, so that every point has an answer with bounds. */
export async function open(where, options = {}) {
  return Asset.open(await sourceOf(where, options), options);
}
