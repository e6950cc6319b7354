#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
A client with a known id, and servers with a false page: every checksum is right, but the page is not
the asset's. A web server, a daemon's Regions and its Fetch serve such files.
"""
import concurrent.futures
import os
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import forged_pages  # noqa: E402
import link  # noqa: E402
import umbrage_test as ut  # noqa: E402

grpc, _ = ut.need_grpc()
umbrage, _ = ut.need_module()
test = ut.Test()
umbrage.__path__.append(test.path("generated", "umbrage"))  # message classes are umbrage.v1
city = test.path("city.umb")
baked = test.bake(test.scene("city", 8), city, "--resolution", 2048, "--verify", 0)
with open(city, "rb") as file:
    whole = file.read()
pages = forged_pages.page_count(whole)
os.mkdir(test.path("lies"))
M, B = test.messages.regions, test.messages.bakes
served = {"data": whole}


def serve_region(request, context):
    """Serves like a daemon, but with the false file."""
    data = b"".join(served["data"][at:at + size] for at, size in zip(request.offsets, request.lengths))
    yield M.RegionReply(asset_id=bytes.fromhex(baked["asset"]), file_bytes=len(served["data"]), data=data)


def serve_fetch(request, context):
    data = served["data"]
    for at in range(request.offset, len(data), 1 << 18):
        yield B.FetchReply(offset=at, size=len(data), data=data[at:at + (1 << 18)])


class Liar(grpc.GenericRpcHandler):
    def service(self, details):
        if details.method == "/umbrage.v1.Bakes/Fetch":
            return grpc.unary_stream_rpc_method_handler(
                serve_fetch, request_deserializer=B.FetchRequest.FromString,
                response_serializer=B.FetchReply.SerializeToString)
        if details.method != "/umbrage.v1.Regions/Stream":
            return None
        return grpc.unary_stream_rpc_method_handler(
            serve_region, request_deserializer=M.RegionRequest.FromString,
            response_serializer=M.RegionReply.SerializeToString)


def forged():
    """Files with a lie in one page: the first, which comes with the first read, and later ones."""
    for page in sorted({0, 1, pages // 2, pages - 2, pages - 1}):
        lie = forged_pages.forge(whole, page)
        if lie is not None:
            yield page, lie


LIES = list(forged())
assert len(LIES) >= 3 and LIES[0][0] == 0, [page for page, _ in LIES]
web = link.RangeServer(test.path("lies"))
liar = grpc.server(concurrent.futures.ThreadPoolExecutor(4))
liar.add_generic_rpc_handlers((Liar(),))
port = liar.add_insecure_port("127.0.0.1:0")
liar.start()
SOURCES = {"web server": ["--from-url", f"http://127.0.0.1:{web.port}/city.umb"],
           "daemon": ["city", "--address", f"tcp:127.0.0.1:{port}"]}


def publish(data):
    served["data"] = data
    with open(test.path("lies", "city.umb"), "wb") as out:
        out.write(data)


for name, source in SOURCES.items():
    with test.check(f"{name}: the true file comes whole, so that the lies below are all that is wrong"):
        publish(whole)
        ut.run("umbrage", "stream", *source, "--id", baked["asset"], "--quiet", "-o", test.path("true.part"))

    with test.check(f"{name}: a page with right checks and a wrong SHA-256 is refused by number"):
        for page, lie in LIES:
            publish(lie)
            for words in (["--id", baked["asset"]], []):
                said = ut.run("umbrage", "stream", *source, *words, "--quiet", code=65).stderr.decode()
                assert f"page {page} of the file: not what its hash says" in said, said

with test.check("Python's fetch proves every byte against the id, and leaves no file of a lie"):
    with umbrage.connect(f"tcp:127.0.0.1:{port}") as there:
        publish(whole)
        there.fetch(baked["asset"], test.path("fetched.umb"))
        with open(test.path("fetched.umb"), "rb") as file:
            assert file.read() == whole
        before = sorted(os.listdir(test.folder))
        for data in [lie for _, lie in LIES] + [whole[:-1], whole + b"x", b"no asset" * 100]:
            publish(data)
            try:
                there.fetch(baked["asset"], test.path("lie.umb"))
                raise AssertionError("not refused")
            except umbrage.FormatError as error:
                assert str(error), error
        assert sorted(os.listdir(test.folder)) == before

liar.stop(None)
web.close()
test.finish()
