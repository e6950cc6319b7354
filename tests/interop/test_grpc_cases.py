#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
Runs the gRPC project's interop cases on BUILD/interop/umbraged, by python3-grpcio over TCP
and a Unix socket; by the official client too if UMBRAGE_GRPC_INTEROP names it (its options are those of the
C++ and Go clients); and h2spec, if UMBRAGE_H2SPEC names it.
Source: grpc/doc/interop-test-descriptions.md, the cases as named there.
"""
import os
import re
import subprocess
import sys
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

grpc, _ = ut.need_grpc()
Code = grpc.StatusCode
OFFICIAL = ["empty_unary", "large_unary", "client_streaming", "server_streaming", "ping_pong", "empty_stream",
            "timeout_on_sleeping_server", "cancel_after_begin", "cancel_after_first_response",
            "status_code_and_message", "special_status_message", "custom_metadata", "unimplemented_method",
            "unimplemented_service"]
SPECIAL = "\t\ntest with whitespace\r\nand Unicode BMP \u263a and non-BMP \U0001f608\t\n"
SERVICE = os.path.join(ut.ROOT, "tests", "interop", "service")
shipped_build = ut.BUILD
ut.BUILD = os.path.join(shipped_build, "interop")
test = ut.Test()
subprocess.run(["protoc", "-I" + SERVICE, "--python_out=" + test.folder, "interop_test.proto"], check=True)
sys.path.insert(0, test.folder)
import interop_test_pb2 as T  # noqa: E402
daemon = test.daemon()


class Client:
    """Stubs of the service by hand, since grpcio-tools is no Debian package."""

    def __init__(self, target):
        self.channel = grpc.insecure_channel(target)
        path = "/grpc.testing.TestService/"
        ours = {"request_serializer": lambda m: m.SerializeToString()}
        self.empty = self.channel.unary_unary(path + "EmptyCall", response_deserializer=T.Empty.FromString, **ours)
        self.unary = self.channel.unary_unary(path + "UnaryCall", response_deserializer=T.SimpleResponse.FromString,
                                              **ours)
        self.input = self.channel.stream_unary(path + "StreamingInputCall", response_deserializer=(
            T.StreamingInputCallResponse.FromString), **ours)
        self.output = self.channel.unary_stream(path + "StreamingOutputCall", response_deserializer=(
            T.StreamingOutputCallResponse.FromString), **ours)
        self.duplex = self.channel.stream_stream(path + "FullDuplexCall", response_deserializer=(
            T.StreamingOutputCallResponse.FromString), **ours)
        self.missing = self.channel.unary_unary(path + "UnimplementedCall", response_deserializer=(
            T.Empty.FromString), **ours)
        self.nobody = self.channel.unary_unary("/grpc.testing.UnimplementedService/UnimplementedCall",
                                               response_deserializer=T.Empty.FromString, **ours)


def payload(size):
    return T.Payload(body=bytes(size))


def output_request(*sizes, **more):
    return T.StreamingOutputCallRequest(response_parameters=[T.ResponseParameters(size=s) for s in sizes], **more)


def code_of(call):
    try:
        call()
    except grpc.RpcError as error:
        return error.code(), error.details()
    raise AssertionError("no error")


def turns(requests):
    """A request iterator that waits until the answer to the last one came, and the call's answers."""
    import queue
    gate = queue.Queue()

    def feed():
        for request in requests:
            yield request
            gate.get()
    return feed(), gate


class Cases:
    def __init__(self, client):
        self.c = client

    def empty_unary(self):
        assert self.c.empty(T.Empty(), timeout=20) == T.Empty()

    def large_unary(self):
        reply = self.c.unary(T.SimpleRequest(response_size=314159, payload=payload(271828)), timeout=20)
        assert reply.payload.body == bytes(314159)

    def client_streaming(self):
        sent = [T.StreamingInputCallRequest(payload=payload(s)) for s in (27182, 8, 1828, 45904)]
        assert self.c.input(iter(sent), timeout=20).aggregated_payload_size == 74922

    def server_streaming(self):
        sizes = (31415, 9, 2653, 58979)
        got = [len(r.payload.body) for r in self.c.output(output_request(*sizes), timeout=20)]
        assert got == list(sizes), got

    def ping_pong(self):
        pairs = ((31415, 27182), (9, 8), (2653, 1828), (58979, 45904))
        feed, gate = turns([output_request(back, payload=payload(there)) for back, there in pairs])
        replies = self.c.duplex(feed, timeout=20)
        for back, _ in pairs:
            assert len(next(replies).payload.body) == back
            gate.put(1)
        assert not list(replies)

    def empty_stream(self):
        assert not list(self.c.duplex(iter([]), timeout=20))

    def timeout_on_sleeping_server(self):
        feed, _ = turns([T.StreamingOutputCallRequest(payload=payload(27182))])
        assert code_of(lambda: list(self.c.duplex(feed, timeout=0.001)))[0] == Code.DEADLINE_EXCEEDED

    def cancel_after_begin(self):
        feed, _ = turns([])

        def endless():
            yield from feed
            time.sleep(3)
        call = self.c.input.future(endless())
        call.cancel()
        assert call.code() == Code.CANCELLED

    def cancel_after_first_response(self):
        feed, _ = turns([output_request(31415, payload=payload(27182))])
        replies = self.c.duplex(feed, timeout=20)
        assert len(next(replies).payload.body) == 31415
        replies.cancel()
        assert code_of(lambda: next(replies))[0] == Code.CANCELLED

    def status_code_and_message(self):
        wanted = T.EchoStatus(code=2, message="test status message")
        assert code_of(lambda: self.c.unary(T.SimpleRequest(response_status=wanted), timeout=20)) == (
            Code.UNKNOWN, "test status message")
        assert code_of(lambda: list(self.c.duplex(iter([output_request(response_status=wanted)]), timeout=20))) == (
            Code.UNKNOWN, "test status message")

    def special_status_message(self):
        wanted = T.EchoStatus(code=2, message=SPECIAL)
        got = code_of(lambda: self.c.unary(T.SimpleRequest(response_status=wanted), timeout=20))
        assert got == (Code.UNKNOWN, SPECIAL), got

    def custom_metadata(self):
        first, last = "test_initial_metadata_value", b"\xab\xab\xab"
        sent = (("x-grpc-test-echo-initial", first), ("x-grpc-test-echo-trailing-bin", last))

        def told(call):
            assert dict(call.initial_metadata())["x-grpc-test-echo-initial"] == first
            assert dict(call.trailing_metadata())["x-grpc-test-echo-trailing-bin"] == last
        _, call = self.c.unary.with_call(T.SimpleRequest(response_size=314159, payload=payload(271828)),
                                         metadata=sent, timeout=20)
        told(call)
        stream = self.c.duplex(iter([output_request(314159, payload=payload(271828))]), metadata=sent, timeout=20)
        assert len(list(stream)) == 1
        told(stream)

    def unimplemented_method(self):
        assert code_of(lambda: self.c.missing(T.Empty(), timeout=20))[0] == Code.UNIMPLEMENTED

    def unimplemented_service(self):
        assert code_of(lambda: self.c.nobody(T.Empty(), timeout=20))[0] == Code.UNIMPLEMENTED


for name, target in (("TCP", daemon.grpc_tcp), ("a Unix socket", daemon.grpc_unix)):
    cases = Cases(Client(target))
    for case in OFFICIAL:
        with test.check(f"{case} over {name}"):
            getattr(cases, case)()

official = os.environ.get("UMBRAGE_GRPC_INTEROP")
if official:
    for case in OFFICIAL:
        with test.check(f"{case} by the official client"):
            subprocess.run([official, "--server_host=127.0.0.1", f"--server_port={daemon.port}", "--use_tls=false",
                            f"--test_case={case}"], check=True, timeout=60)
else:
    ut.left_out("the gRPC project's own client", "UMBRAGE_GRPC_INTEROP names none")

h2spec = os.environ.get("UMBRAGE_H2SPEC")
if h2spec:
    with test.check("h2spec --strict: 145 of 147 pass or more"):
        done = subprocess.run([h2spec, "--strict", "-h", "127.0.0.1", "-p", str(daemon.port)], timeout=200,
                              stdout=subprocess.PIPE, check=False)
        text = done.stdout.decode(errors="replace")
        print("   ", text.strip().splitlines()[-1])
        assert int(re.search(r"(\d+) passed", text).group(1)) >= 145, text[-3000:]
else:
    ut.left_out("h2spec", "UMBRAGE_H2SPEC names none")
with test.check("the shipped daemon knows nothing of the service"):
    ut.BUILD = shipped_build
    shipped = Client(test.daemon().grpc_tcp)
    assert code_of(lambda: shipped.empty(T.Empty(), timeout=20))[0] == Code.UNIMPLEMENTED
test.finish()
