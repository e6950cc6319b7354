// SPDX-License-Identifier: Apache-2.0
import { browse } from "./browse.mjs";

self.postMessage(await browse("worker"));
