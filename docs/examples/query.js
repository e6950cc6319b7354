// SPDX-License-Identifier: Apache-2.0
/*
 * Asks umbraged from Node: @grpc/grpc-js and @grpc/proto-loader, which read our .proto file themselves.
 *
 *     npm install @grpc/grpc-js @grpc/proto-loader
 *     node docs/examples/query.js localhost:7420 city < points.txt
 *
 * Reads "x y z" lines and writes one visibility (0 shadowed .. 1 lit) a line.
 */
"use strict";
const fs = require("fs");
const path = require("path");
const grpc = require("@grpc/grpc-js");
const loader = require("@grpc/proto-loader");

const [address, asset] = process.argv.slice(2);
const proto = path.join(__dirname, "..", "..", "proto");
const api = grpc.loadPackageDefinition(loader.loadSync("umbrage/v1/shadows.proto", {
  includeDirs: [proto], defaults: true })).umbrage.v1;

// Points travel as little-endian floats, as a Float32Array lies in memory.
const points = Float32Array.from(fs.readFileSync(0, "utf8").split(/\s+/).filter(Boolean), Number);
const metadata = new grpc.Metadata();
metadata.set("x-umbrage-asset", asset); // lets a balancer keep an asset on one replica

const client = new api.Shadows(address, grpc.credentials.createInsecure());
client.Query({ asset, points: Buffer.from(points.buffer), taps: 9, format: "ANSWER_F32" }, metadata,
  { deadline: Date.now() + 10000 }, (error, reply) => {
    if (error) {
      console.error(error.message);
      process.exitCode = 1;
    } else {
      const bytes = Uint8Array.from(reply.visibility); // at an address that floats may have
      new Float32Array(bytes.buffer).forEach((visibility) => console.log(String(visibility)));
    }
    client.close();
  });
