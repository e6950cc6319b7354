#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Asks umbraged from Python: python3-grpcio and message classes generated from our .proto file.

    protoc -Iproto --python_out=. umbrage/v1/shadows.proto
    python3 docs/examples/query.py localhost:7420 city < points.txt

Reads "x y z" lines and writes one visibility (0 shadowed .. 1 lit) a line.
"""
import array
import os
import sys

import grpc

sys.path.insert(0, os.getcwd())  # where protoc wrote the classes
from umbrage.v1 import shadows_pb2 as api  # noqa: E402

address, asset = sys.argv[1:3]
points = array.array("f", [float(word) for line in sys.stdin for word in line.split()])

channel = grpc.insecure_channel(address)  # unix:/path works too; secure_channel for a tls: listener
query = channel.unary_unary("/umbrage.v1.Shadows/Query",
                            request_serializer=api.QueryRequest.SerializeToString,
                            response_deserializer=api.QueryReply.FromString)
# Points travel as little-endian floats: array.tobytes() here, ndarray.astype("<f4").tobytes() with numpy.
reply = query(api.QueryRequest(asset=asset, points=points.tobytes(), taps=9, format=api.ANSWER_F32), timeout=10,
              metadata=[("x-umbrage-asset", asset)])  # lets a balancer keep an asset on one replica
for visibility in array.array("f", reply.visibility):
    print(f"{visibility:.9g}")
