// SPDX-License-Identifier: Apache-2.0
/*
 * The daemon as clients of @grpc/grpc-js see it. Run by tests/interop/test_grpc_js.py, which starts the
 * daemon and says in the environment where it is and what the answers must be (SUITE, a JSON file).
 * One line a check, as all system tests print; exit code 1 if one failed.
 */
"use strict";
const assert = require("assert");
const fs = require("fs");
const path = require("path");
const load = (name) => require(require.resolve(name, { paths: [process.env.UMBRAGE_GRPC_JS] }));
const grpc = load("@grpc/grpc-js");
const loader = load("@grpc/proto-loader");

const suite = JSON.parse(fs.readFileSync(process.env.SUITE, "utf8"));
const definition = loader.loadSync(
  ["umbrage/v1/shadows.proto", "grpc/health/v1/health.proto"], {
    includeDirs: [suite.proto], longs: Number, enums: String, defaults: true });
const api = grpc.loadPackageDefinition(definition);
const points = fs.readFileSync(suite.points); // floats x y z
const expected = fs.readFileSync(suite.expected); // a byte a point
const soon = (seconds) => ({ deadline: Date.now() + 1000 * seconds });

let passed = 0;
let failed = 0;
async function check(name, body) {
  try {
    await body();
    passed++;
    console.log(`ok ${name}`);
  } catch (error) {
    failed++;
    console.log(`FAILED ${name}: ${error.stack}`);
  }
}

function call(client, method, request, options = soon(30), metadata = new grpc.Metadata()) {
  return new Promise((resolve, reject) => client[method](request, metadata, options,
    (error, reply) => (error ? reject(error) : resolve(reply))));
}

async function refused(promise, code, word) {
  const error = await promise.then(() => assert.fail("it was answered"), (e) => e);
  assert.strictEqual(error.code, code, error.message);
  assert.ok(word === undefined || error.details.includes(word), error.details);
  return error;
}

const ask = (client, count, more = {}, options = undefined) => call(client, "Query", {
  asset: "city", points: points.subarray(0, 12 * count), taps: suite.taps, ...more }, options);

async function eachTransport(name, target, credentials) {
  const shadows = new api.umbrage.v1.Shadows(target, credentials);
  for (const count of [1, 64, 4096, suite.count]) {
    await check(`${name}: ${count} points get the file's bits`, async () => {
      const reply = await ask(shadows, count);
      assert.ok(Buffer.compare(reply.visibility, expected.subarray(0, count)) === 0, "other bits");
      assert.strictEqual(reply.assetId.toString("hex"), suite.asset);
    });
  }
  await check(`${name}: a hundred calls at once get each its answer`, async () => {
    await Promise.all(Array.from({ length: 100 }, async (_, i) => {
      const reply = await ask(shadows, i + 1);
      assert.ok(Buffer.compare(reply.visibility, expected.subarray(0, i + 1)) === 0, `call ${i}`);
    }));
  });
  shadows.close();
}

async function errors(shadows) {
  await check("an unknown asset is NOT_FOUND and is named", () => refused(
    call(shadows, "Query", { asset: "nowhere", points: points.subarray(0, 12) }),
    grpc.status.NOT_FOUND, "nowhere"));
  await check("a length that is no whole point is INVALID_ARGUMENT and names the field", () => refused(
    call(shadows, "Query", { asset: "city", points: points.subarray(0, 13) }),
    grpc.status.INVALID_ARGUMENT, "points"));
  await check("text beyond ASCII survives the status message", () => refused(
    call(shadows, "Query", { asset: "städt % ", points: points.subarray(0, 12) }),
    grpc.status.NOT_FOUND, "%"));
  await check("a deadline that passes is DEADLINE_EXCEEDED", () => refused(
    ask(shadows, suite.count, { taps: 17 }, { deadline: Date.now() + 1 }), grpc.status.DEADLINE_EXCEEDED));
  await check("a cancelled call is CANCELLED, and the next one is answered", async () => {
    const request = { asset: "city", points, taps: 17 };
    await refused(new Promise((resolve, reject) => {
      const running = shadows.Query(request, (error, reply) => (error ? reject(error) : resolve(reply)));
      setImmediate(() => running.cancel());
    }), grpc.status.CANCELLED);
    assert.strictEqual((await ask(shadows, 8)).visibility.length, 8);
  });
  await check("a method that is not there is UNIMPLEMENTED", () => refused(
    new Promise((resolve, reject) => shadows.makeUnaryRequest("/umbrage.v1.Shadows/Guess", (x) => x, (x) => x,
      Buffer.alloc(0), (error, reply) => (error ? reject(error) : resolve(reply)))),
    grpc.status.UNIMPLEMENTED));
}

async function others(shadows, health) {
  await check("Describe tells the id and the lights", async () => {
    const reply = await call(shadows, "Describe", { asset: "city" });
    assert.strictEqual(reply.summary.id.toString("hex"), suite.asset);
    assert.ok(reply.lights.length > 0);
  });
  await check("List names the asset", async () => {
    const reply = await call(shadows, "List", {});
    assert.deepStrictEqual(reply.assets.map((asset) => asset.name), ["city"]);
  });
  await check("gzip requests are inflated", async () => {
    const reply = await ask(shadows, 4096, {}, {
      ...soon(30), "grpc.default_compression_algorithm": grpc.compressionAlgorithms.gzip });
    assert.ok(Buffer.compare(reply.visibility, expected.subarray(0, 4096)) === 0);
  });
  await check("health says SERVING, and NOT_FOUND for what is not there", async () => {
    assert.strictEqual((await call(health, "Check", { service: "umbrage.v1.Shadows" })).status, "SERVING");
    await refused(call(health, "Check", { service: "nobody" }), grpc.status.NOT_FOUND);
  });
  await check("Watch says SERVING at once, and ends when it is cancelled", () => new Promise((resolve, reject) => {
    const watch = health.Watch({ service: "" });
    watch.on("data", (reply) => {
      assert.strictEqual(reply.status, "SERVING");
      watch.cancel();
    });
    watch.on("error", (error) => (error.code === grpc.status.CANCELLED ? resolve() : reject(error)));
  }));
}

async function streams(shadows) {
  await check("a stream answers each request in order", () => new Promise((resolve, reject) => {
    const sizes = [1, 3000, 7, 64, suite.count, 2];
    const got = [];
    const stream = shadows.QueryStream();
    stream.on("data", (reply) => got.push(reply.visibility));
    stream.on("error", reject);
    stream.on("end", () => {
      try {
        assert.deepStrictEqual(got.map((one) => one.length), sizes);
        got.forEach((one) => assert.ok(Buffer.compare(one, expected.subarray(0, one.length)) === 0));
        resolve();
      } catch (error) {
        reject(error);
      }
    });
    sizes.forEach((size) => stream.write({
      asset: "city", points: points.subarray(0, 12 * size), taps: suite.taps }));
    stream.end();
  }));
  await check("a bad request ends the stream with its status, after the reply before it", () => new Promise(
    (resolve, reject) => {
      let replies = 0;
      const stream = shadows.QueryStream();
      stream.on("data", () => replies++);
      stream.on("end", () => {});
      stream.on("error", (error) => {
        try {
          assert.strictEqual(error.code, grpc.status.NOT_FOUND);
          assert.strictEqual(replies, 1);
          resolve();
        } catch (wrong) {
          reject(wrong);
        }
      });
      stream.write({ asset: "city", points: points.subarray(0, 12) });
      stream.write({ asset: "nowhere", points: points.subarray(0, 12) });
    }));
}

async function main() {
  const plain = grpc.credentials.createInsecure();
  const secure = grpc.credentials.createSsl(fs.readFileSync(suite.ca));
  await eachTransport("TCP", suite.tcp, plain);
  await eachTransport("Unix socket", suite.unix, plain);
  await eachTransport("TLS", suite.tls, secure);
  const shadows = new api.umbrage.v1.Shadows(suite.tcp, plain);
  const health = new api.grpc.health.v1.Health(suite.tcp, plain);
  await errors(shadows);
  await others(shadows, health);
  await streams(shadows);
  await check("a call over TLS with an authority nobody knows is UNAVAILABLE", () => refused(
    ask(new api.umbrage.v1.Shadows(suite.tls, grpc.credentials.createSsl()), 1, {}, soon(5)),
    grpc.status.UNAVAILABLE));
  shadows.close();
  health.close();
  console.log(`${passed} checks passed, ${failed} failed (${path.basename(__filename)})`);
  process.exit(failed ? 1 : 0);
}

main();
