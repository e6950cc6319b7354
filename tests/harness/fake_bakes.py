# SPDX-License-Identifier: Apache-2.0
"""
A server of Bakes.Fetch and Submit by python3-grpcio, whose replies the test defines:

    server = fake_bakes.Server(messages)          # at server.address
    server.fetch = lambda request, context: ...   # yields FetchReply messages
    server.submit = lambda requests, context: ... # returns a SubmitReply
"""
import concurrent.futures
import threading

import umbrage_test as ut


class Server:
    def __init__(self, messages):
        grpc, _ = ut.need_grpc()
        self.M = messages.bakes
        self.fetch = self.submit = None
        self.released = threading.Event()  # ends calls that wait for ever, with the server
        self.server = grpc.server(concurrent.futures.ThreadPoolExecutor(8))
        outer = self

        class Handler(grpc.GenericRpcHandler):
            def service(self, details):
                if details.method == "/umbrage.v1.Bakes/Fetch":
                    return grpc.unary_stream_rpc_method_handler(
                        lambda *a: outer.fetch(*a), request_deserializer=outer.M.FetchRequest.FromString,
                        response_serializer=outer.M.FetchReply.SerializeToString)
                if details.method == "/umbrage.v1.Bakes/Submit":
                    return grpc.stream_unary_rpc_method_handler(
                        lambda *a: outer.submit(*a), request_deserializer=outer.M.SubmitRequest.FromString,
                        response_serializer=outer.M.SubmitReply.SerializeToString)
                return None

        self.server.add_generic_rpc_handlers((Handler(),))
        self.address = f"tcp:127.0.0.1:{self.server.add_insecure_port('127.0.0.1:0')}"
        self.server.start()

    def file(self, data, size=None, piece=65536):
        """Replies of a fetch with these bytes, which claim the length `size`."""
        def fetch(request, _context):
            for at in range(request.offset, max(len(data), request.offset + 1), piece):
                yield self.M.FetchReply(offset=at, size=len(data) if size is None else size,
                                        data=data[at:at + piece])
        return fetch

    def wait(self):
        """For calls that get no reply until the server ends."""
        self.released.wait(120)

    def close(self):
        self.released.set()
        self.server.stop(None)
