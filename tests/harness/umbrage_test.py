# SPDX-License-Identifier: Apache-2.0
"""
What the system, agreement and interop tests share: programs of one build, a folder that is removed
at the end, daemons that are always stopped, and checks that name what they prove.

    import umbrage_test as ut
    test = ut.Test()                        # its own temporary folder: test.folder
    asset = test.bake_generated("city", ...)
    daemon = test.daemon()                  # on test.folder/store, ready when this returns
    with test.check("an unknown asset is NOT_FOUND"):
        ...asserts...
    test.finish()                           # stops daemons, prints a summary, exits 0 or 1

A check that fails is printed and the next one runs; an error outside of a check ends the test.
BUILD names the build folder (default build/release). Exit code 77 with a last line is a skip.
"""
import array
import atexit
import contextlib
import hashlib
import importlib.util
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import traceback
import urllib.request

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
BUILD = os.path.join(ROOT, os.environ.get("BUILD", "build/release"))
SANITIZER = re.compile(rb"AddressSanitizer|LeakSanitizer|ThreadSanitizer|runtime error:")


def program(name):
    """Path of a program of the build under test."""
    path = os.path.join(BUILD, name)
    if not os.access(path, os.X_OK):
        raise SystemExit(f"{name} is not built in {BUILD}")
    return path


def skip(reason):
    """Ends the test as skipped."""
    print(f"skipped: {reason}")
    raise SystemExit(77)


def left_out(name, reason):
    """Reports that a part of a test does not run here: run.sh counts and lists it as skipped."""
    print(f"SKIPPED: {name}: {reason}", flush=True)


def is_sanitized():
    """True if the programs are built with a sanitizer: slower, and time bounds are wider."""
    with open(program("umbraged"), "rb") as file:
        data = file.read()
    return b"__tsan_init" in data or b"__asan_init" in data


def run(*words, code=0, stdin=None, timeout=300, env=None):
    """Runs a program of the build and checks its exit code (None: any)."""
    command = [program(words[0])] + [str(word) for word in words[1:]]
    done = subprocess.run(command, input=stdin, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          timeout=timeout, env={**os.environ, **(env or {})}, check=False)
    if SANITIZER.search(done.stderr):
        raise AssertionError(f"{command}: sanitizer report\n{done.stderr.decode(errors='replace')}")
    if code is not None and done.returncode != code:
        raise AssertionError(f"{command}: exit code {done.returncode}, expected {code}\n"
                             f"{done.stderr.decode(errors='replace')[-2000:]}")
    return done


def floats(values, kind="f"):
    """Little-endian bytes of numbers."""
    data = array.array(kind, values)
    if sys.byteorder == "big":
        data.byteswap()
    return data.tobytes()


def from_floats(data, kind="f"):
    values = array.array(kind)
    values.frombytes(data)
    if sys.byteorder == "big":
        values.byteswap()
    return values


def random_points(bounds_min, bounds_max, count, seed):
    """Coordinates x y z ... within a box that is a tenth larger than the given one."""
    rng = random.Random(seed)
    values = []
    spans = [(low - 0.05 * (high - low), high + 0.05 * (high - low))
             for low, high in zip(bounds_min, bounds_max)]
    for _ in range(count):
        for low, high in spans:
            values.append(rng.uniform(low, high))
    return values


def random_normals(count, seed):
    rng = random.Random(seed)
    values = []
    while len(values) < 3 * count:
        vector = [rng.uniform(-1, 1) for _ in range(3)]
        length = sum(v * v for v in vector) ** 0.5
        if 0.1 < length <= 1:
            values.extend(v / length for v in vector)
    return values


def interleave(points, normals):
    """x y z nx ny nz ... as `umbrage query --normals` reads them."""
    values = []
    for i in range(0, len(points), 3):
        values.extend(points[i:i + 3])
        values.extend(normals[i:i + 3])
    return values


class Messages:
    """Message classes of our .proto files, generated into a folder."""

    def __init__(self, folder):
        if shutil.which("protoc") is None:
            skip("protoc is not installed")
        out = os.path.join(folder, "generated")
        os.makedirs(out, exist_ok=True)
        subprocess.run(["protoc", "-I" + os.path.join(ROOT, "proto"), "--python_out=" + out,
                        "umbrage/v1/shadows.proto", "umbrage/v1/bakes.proto",
                        "umbrage/v1/regions.proto", "umbrage/v1/questions.proto",
                        "grpc/health/v1/health.proto",
                        "grpc/reflection/v1/reflection.proto"], check=True)
        # Our grpc/ folder must not hide the installed grpc package: load its file by its path.
        sys.path.insert(0, out)
        self.shadows = importlib.import_module("umbrage.v1.shadows_pb2")
        self.bakes = importlib.import_module("umbrage.v1.bakes_pb2")
        self.questions = importlib.import_module("umbrage.v1.questions_pb2")
        self.regions = importlib.import_module("umbrage.v1.regions_pb2")
        sys.path.pop(0)
        self.health = self._load(out, "health")
        self.reflection = self._load(out, "reflection")

    @staticmethod
    def _load(out, name):
        path = os.path.join(out, "grpc", name, "v1", f"{name}_pb2.py")
        spec = importlib.util.spec_from_file_location(f"umbrage_{name}_pb2", path)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module


class Client:
    """A channel of python3-grpcio with our methods."""

    def __init__(self, target, messages, options=(), credentials=None):
        import grpc
        self.grpc = grpc
        self.shadows = messages.shadows
        options = [("grpc.max_receive_message_length", 256 << 20),
                   ("grpc.use_local_subchannel_pool", 1)] + list(options)
        self.channel = (grpc.secure_channel(target, credentials, options=options) if credentials
                        else grpc.insecure_channel(target, options=options))
        s, h = messages.shadows, messages.health
        self.query = self.unary("/umbrage.v1.Shadows/Query", s.QueryReply)
        self.describe = self.unary("/umbrage.v1.Shadows/Describe", s.DescribeReply)
        self.list = self.unary("/umbrage.v1.Shadows/List", s.ListReply)
        self.limits = self.unary("/umbrage.v1.Shadows/Limits", s.LimitsReply)
        self.stream = self.bidi("/umbrage.v1.Shadows/QueryStream", s.QueryReply)
        self.reflect = [self.bidi(f"/grpc.reflection.{version}.ServerReflection/ServerReflectionInfo",
                                  messages.reflection.ServerReflectionResponse)
                        for version in ("v1", "v1alpha")]
        b = self.bakes = messages.bakes
        pack = {"request_serializer": lambda m: m.SerializeToString()}
        self.raw_submit = self.channel.stream_unary(
            "/umbrage.v1.Bakes/Submit", response_deserializer=b.SubmitReply.FromString, **pack)
        self.watch_job = self.channel.unary_stream(
            "/umbrage.v1.Bakes/Watch", response_deserializer=b.JobStatus.FromString, **pack)
        self.fetch = self.channel.unary_stream(
            "/umbrage.v1.Bakes/Fetch", response_deserializer=b.FetchReply.FromString, **pack)
        self.cancel_job = self.unary("/umbrage.v1.Bakes/Cancel", b.JobStatus)
        self.list_jobs = self.unary("/umbrage.v1.Bakes/List", b.ListJobsReply)
        self.delete_asset = self.unary("/umbrage.v1.Bakes/Delete", b.DeleteReply)
        self.check = self.unary("/grpc.health.v1.Health/Check", h.HealthCheckResponse)
        self.watch = self.channel.unary_stream(
            "/grpc.health.v1.Health/Watch", request_serializer=lambda m: m.SerializeToString(),
            response_deserializer=h.HealthCheckResponse.FromString)
        self.raw_query = self.channel.unary_unary("/umbrage.v1.Shadows/Query",
                                                  response_deserializer=s.QueryReply.FromString)

    def bidi(self, path, reply):
        return self.channel.stream_stream(path, request_serializer=lambda m: m.SerializeToString(),
                                          response_deserializer=reply.FromString)

    def unary(self, path, reply):
        return self.channel.unary_unary(path, request_serializer=lambda m: m.SerializeToString(),
                                        response_deserializer=reply.FromString)

    def ask(self, asset, points=b"", timeout=60, **fields):
        """Query as a message; returns the reply."""
        return self.query(self.shadows.QueryRequest(asset=asset, points=points, **fields),
                          timeout=timeout)

    def manifest(self, files, scene, **settings):
        """Manifest of files {path: bytes}; settings with _ for -, a list repeats."""
        manifest = self.bakes.Manifest(scene=scene)
        for path, data in files.items():
            manifest.files.add(path=path, size=len(data), sha256=hashlib.sha256(data).digest())
        for name, values in settings.items():
            for value in values if isinstance(values, list) else [values]:
                manifest.settings.add(name=name.replace("_", "-"), value=str(value))
        return manifest

    def submit(self, files, scene, metadata=None, timeout=60, **settings):
        """Submits a bundle; the reply."""
        def messages():
            yield self.bakes.SubmitRequest(manifest=self.manifest(files, scene, **settings))
            for data in files.values():
                for at in range(0, len(data), 1 << 18):
                    yield self.bakes.SubmitRequest(data=data[at:at + (1 << 18)])
        return self.raw_submit(messages(), timeout=timeout, metadata=metadata)

    def finished_job(self, job, metadata=None, timeout=60):
        """Watches a job to its end; its last status."""
        status = None
        for status in self.watch_job(self.bakes.WatchRequest(job=job), timeout=timeout,
                                     metadata=metadata):
            pass
        return status

    def refused(self, call, code, *words):
        """Runs call(), which must fail with that code, or one of several, and a message with those
        words."""
        try:
            call()
        except self.grpc.RpcError as error:
            assert error.code() == code or isinstance(code, tuple) and error.code() in code, \
                f"{error.code()}: {error.details()}, expected {code}"
            for word in words:
                assert word in error.details(), f"'{word}' is not in '{error.details()}'"
            return error
        raise AssertionError(f"the call was answered, expected {code}")

    def close(self):
        self.channel.close()


class Daemon:
    """One umbraged on a store; ready when the constructor returns."""

    def __init__(self, folder, store, *options, ready_s=60):
        self.folder = folder
        self.store = store
        os.makedirs(store, exist_ok=True)
        stem = tempfile.mktemp(prefix="d", dir=folder)
        self.address_file = stem + ".addresses"
        self.log_path = stem + ".log"
        self.socket_path = stem + ".sock"
        words = [program("umbraged"), "--store", store, "--listen", "tcp:127.0.0.1:0", "--listen",
                 "unix:" + self.socket_path, "--admin", "127.0.0.1:0", "--address-file",
                 self.address_file, "--drain-delay", "0"]
        with open(self.log_path, "wb") as log:
            self.process = subprocess.Popen(words + [str(word) for word in options], stderr=log,
                                            stdout=log)
        deadline = time.monotonic() + ready_s
        while not os.path.exists(self.address_file):
            if self.process.poll() is not None or time.monotonic() > deadline:
                self.kill()
                raise RuntimeError("the daemon did not start:\n" + self.log())
            time.sleep(0.02)
        self.addresses = {}
        with open(self.address_file, encoding="utf-8") as file:
            for line in file.read().split():
                kind, _, rest = line.partition(":")
                self.addresses[kind] = rest
        self.port = int(self.addresses["tcp"].rpartition(":")[2])
        self.tcp = "tcp:" + self.addresses["tcp"]    # as our programs write it
        self.grpc_tcp = self.addresses["tcp"]        # as gRPC does
        self.grpc_unix = "unix:" + self.addresses["unix"]
        while self.admin("/readyz", None)[0] != 200:
            if time.monotonic() > deadline:
                raise RuntimeError("the daemon is never ready:\n" + self.log())
            time.sleep(0.05)

    def log(self):
        with open(self.log_path, encoding="utf-8", errors="replace") as file:
            return file.read()

    def admin(self, path, default=""):
        """Status and text of a page of the admin port."""
        try:
            with urllib.request.urlopen(f"http://{self.addresses['http']}{path}", timeout=10) as r:
                return r.status, r.read().decode()
        except urllib.error.HTTPError as error:
            return error.code, error.read().decode()
        except OSError:
            if default is None:
                return 0, ""
            raise

    def metric(self, name):
        """Sum of a metric over its labels."""
        total = 0.0
        found = False
        for line in self.admin("/metrics")[1].splitlines():
            if re.match(re.escape(name) + r"(\{| )", line):
                total += float(line.rpartition(" ")[2])
                found = True
        assert found, f"no metric {name}"
        return total

    def resident_bytes(self):
        with open(f"/proc/{self.process.pid}/status", encoding="ascii") as file:
            return int(re.search(r"VmRSS:\s+(\d+) kB", file.read()).group(1)) * 1024

    def signal(self, number):
        self.process.send_signal(number)

    def wait(self, timeout=60):
        return self.process.wait(timeout)

    def stop(self, timeout=90):
        """SIGTERM; demands exit code 0 and no sanitizer report."""
        if self.process.poll() is None:
            self.signal(signal.SIGTERM)
        self.exited(timeout)

    def exited(self, timeout=90):
        """Waits for the end; demands exit code 0 and no sanitizer report."""
        code = self.wait(timeout)
        log = self.log()
        assert not SANITIZER.search(log.encode()), "sanitizer report:\n" + log[-6000:]
        assert code == 0, f"the daemon's exit code is {code}:\n{log[-3000:]}"

    def kill(self):
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()


class Test:
    """One test program: folder, checks, daemons."""

    def __init__(self, limit_s=560):
        self.folder = tempfile.mkdtemp(prefix="umbt")  # short: Unix socket names have 107 bytes
        self.failed = []
        self.passed = 0
        self.daemons = []
        self._messages = None
        atexit.register(self._clean)
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: sys.exit(1))
        # A test that hangs says where, and cleans up.
        self._alarm = threading.Timer(limit_s, self._timed_out)
        self._alarm.daemon = True
        self._alarm.start()

    def _timed_out(self):
        import faulthandler
        print("the test takes too long", flush=True)
        faulthandler.dump_traceback(file=sys.stdout, all_threads=True)
        sys.stdout.flush()
        self._clean()
        os._exit(1)

    def _clean(self):
        for daemon in self.daemons:
            daemon.kill()
        shutil.rmtree(self.folder, ignore_errors=True)

    def path(self, *names):
        return os.path.join(self.folder, *names)

    @property
    def messages(self):
        if self._messages is None:
            self._messages = Messages(self.folder)
        return self._messages

    @contextlib.contextmanager
    def check(self, sentence):
        begin = time.monotonic()
        try:
            yield
        except Exception as error:
            self.failed.append(sentence)
            print(f"FAILED {sentence}: {type(error).__name__}: {error}", flush=True)
            traceback.print_exc(file=sys.stdout)
        else:
            self.passed += 1
            print(f"ok {sentence} ({time.monotonic() - begin:.1f} s)", flush=True)

    def scene(self, kind, size, seed=1, form="glb"):
        path = self.path(f"{kind}{size}-{seed}.{form}")
        if not os.path.exists(path):
            run("scenegen", kind, "--size", size, "--seed", seed, "-o", path)
        return path

    def bake(self, scene, out, *options):
        """Bakes; returns what --json says."""
        done = run("umbrage-bake", scene, "-o", out, "--json", "--quiet", *options)
        return json.loads(done.stdout)

    def daemon(self, *options, store=None):
        daemon = Daemon(self.folder, store or self.path("store"), *options)
        self.daemons.append(daemon)
        return daemon

    def held_bakes(self):
        """
        Makes a --bake-program, and returns its path with that of a file. While the file is there, bakes take
        minutes on any machine. A test waits for what must happen in the middle of a bake and removes the
        file; the next try of the same job then takes its usual time. A bake that no test ends stops by a
        limit of CPU time.
        """
        program_path, gate = self.path("held-bake"), self.path("held")
        with open(os.open(program_path, os.O_WRONLY | os.O_CREAT, 0o755), "w",
                  encoding="ascii") as file:
            file.write("#!/bin/sh\n"
                       f"if [ -e '{gate}' ]; then ulimit -t 120; set -- \"$@\" --verify={ENDLESS}; fi\n"
                       f"exec '{program('umbrage-bake')}' \"$@\"\n")
        return program_path, gate

    def client(self, target, options=(), credentials=None):
        return Client(target, self.messages, options, credentials)

    def query_file(self, asset, data, *options, form="f32", encoding="f32"):
        """Answers of `umbrage query` for raw points."""
        done = run("umbrage", "query", asset, "--points", "-", "--format", form, "--encoding",
                   encoding, "--quiet", *options, stdin=data)
        return done.stdout

    def finish(self):
        for daemon in self.daemons:
            if daemon.process.poll() is None:
                with self.check("the daemon drains, exits with 0, and no sanitizer complains"):
                    daemon.stop()
        print(f"{self.passed} checks passed, {len(self.failed)} failed")
        self._alarm.cancel()
        raise SystemExit(1 if self.failed else 0)


def need_grpc():
    """Skips the test where python3-grpcio is not installed."""
    try:
        import grpc
        import google.protobuf
        return grpc, google.protobuf
    except ImportError as error:
        return skip(f"python3-grpcio is not installed ({error})")


def need_module():
    """The Python module of this build; skips the test where its packages are not installed."""
    try:
        import cffi  # noqa: F401
        import numpy
    except ImportError as error:
        return skip(f"python3-numpy or python3-cffi is not installed ({error})")
    if os.environ.get("LD_LIBRARY_PATH", "").split(":")[0] != BUILD:  # read when a program starts, not later
        os.environ["LD_LIBRARY_PATH"] = ":".join(filter(None, [BUILD, os.environ.get("LD_LIBRARY_PATH")]))
        os.execv(sys.executable, [sys.executable, *sys.argv])
    sys.path.insert(0, os.path.join(BUILD, "python"))
    import umbrage
    return umbrage, numpy


ENDLESS = 10 ** 9  # points to verify: minutes on any machine
PATIENCE = 4  # a machine may be so many times slower than a quiet one


def wait_until(condition, seconds, what):
    """Polls until condition() is true, and returns its value; fails after PATIENCE times `seconds`."""
    deadline = time.monotonic() + PATIENCE * seconds
    while True:
        value = condition()
        if value:
            return value
        if time.monotonic() > deadline:
            raise AssertionError(f"not within {seconds} s: {what}")
        time.sleep(0.05)
