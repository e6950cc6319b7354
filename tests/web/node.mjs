// SPDX-License-Identifier: Apache-2.0
// The suite in node: node.mjs PACKAGE CONFIG FOLDER [URL]. Prints the checks as JSON. With URL, assets come from there.
import { readFile } from "node:fs/promises";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";
import { run } from "./suite.mjs";

const [library, config, folder, url] = process.argv.slice(2);
const umbrage = await import(pathToFileURL(resolve(library, "index.js")));
const read = async (name) => Uint8Array.from(await readFile(join(folder, name))).buffer;
const where = (name) => url ? `${url}/${name}` : join(folder, name);
console.log(JSON.stringify(await run(umbrage, JSON.parse(await readFile(config)), read, where)));
