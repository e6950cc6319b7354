#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
What a released version promised to later ones, as a folder of files, and the comparison of a build with it.

    compat.py record FOLDER   writes the folder of this build and checks it: `make compat-record`, once, at the release
    compat.py check FOLDER    prints what this build does otherwise, one finding a line

    scene.obj, assets/*.umb   a scene, and its bakes with the options of BAKES
    ids.json                  the bakes' options and ids
    answers/*.f32             answers to points.f32 with the settings of QUERIES
    messages/*.request|reply  bytes of calls over gRPC; proto/ has the .proto files by which they are read
    jobs/, jobs.json          a daemon's jobs folder with a finished job, and what `umbrage jobs --json` says of it
    umbraged.conf             the configuration file of the package
    options.tsv, metrics.txt  options of the programs, and names of metrics with their types and labels
    json.txt, python.txt      keys that --json prints, names and parameters of the Python module
    abi.txt                   functions, structs and enums of the C libraries (tests/abi/record.txt)
"""
import json
import os
import re
import shutil
import struct
import subprocess
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, "..", "harness"))
import interfaces  # noqa: E402
import umbrage_test as ut  # noqa: E402

COMMON = ("--resolution", "256", "--verify", "0", "--up", "z", "--closed", "off", "--quiet", "--json")
BAKES = {"sun": ("--sun", "180,45"), "suns": ("--sun", "135,40", "--sun", "220,60"), "lamp": ("--point", "1,-4,5"),
         "spot": ("--spot", "0,-5,6,0,7,-6,40"), "front": ("--sun", "180,45", "--effect", "front=on")}
QUERIES = {"taps1": (), "taps9": ("--taps", "9"), "tent": ("--taps", "5", "--filter", "tent"), "level": ("--level", "3"),
           "unbiased": ("--bias", "none")}
PROGRAMS = ("umbrage", "umbraged", "umbrage-bake", "umbrage-study")
# Fields of replies that differ from run to run or with the version, by their names in protoc's text.
VOLATILE = re.compile(r"^\s*(nanoseconds|version|memory_bytes|packed_bytes|expected_ns|lines|nodes|bricks|encodings): ")
FILES = {name: f"umbrage/v1/{name}.proto" for name in ("shadows", "questions", "regions", "bakes")}
STREAMS = ("/umbrage.v1.Regions/Stream",)  # methods that reply by a stream: here of one message
JOB = ("--sun", "180,45", "--up", "z", "--resolution", "256", "--verify", "0")
JOBS = (os.path.join("jobs", "jobs.db"), os.path.join("jobs", "assets"))  # what stays of a finished job


def calls(messages):
    """{name: (path, request, reply's type, its .proto file)}"""
    shadows, questions, regions, bakes = messages.shadows, messages.questions, messages.regions, messages.bakes
    points = struct.pack("<9f", 0, 2, 0, 0, -2, 0, 3, 3, 0.5)
    query = "/umbrage.v1.Shadows/Query"
    return {
        "query": (query, shadows.QueryRequest(asset="sun", taps=9, points=points), "QueryReply", "shadows"),
        "dial": (query, shadows.QueryRequest(asset="sun", max_error_m=2.0, points=points, want_stats=True), "QueryReply", "shadows"),
        "packed": (query, shadows.QueryRequest(asset="suns", taps=5, light=1, points=points_of(), pack=True), "QueryReply", "shadows"),
        "bits": (query, shadows.QueryRequest(asset="lamp", taps=9, points=points, format=shadows.ANSWER_BIT), "QueryReply", "shadows"),
        "region": (STREAMS[0], regions.RegionRequest(asset="spot", offsets=[0, 64], lengths=[16, 4096]), "RegionReply", "regions"),
        "jobs": ("/umbrage.v1.Bakes/List", bakes.ListJobsRequest(limit=10), "ListJobsReply", "bakes"),
        "describe": ("/umbrage.v1.Shadows/Describe", shadows.DescribeRequest(asset="suns", want_curves=True), "DescribeReply", "shadows"),
        "list": ("/umbrage.v1.Shadows/List", shadows.ListRequest(), "ListReply", "shadows"),
        "limits": ("/umbrage.v1.Shadows/Limits", shadows.LimitsRequest(), "LimitsReply", "shadows"),
        "segments": ("/umbrage.v1.Questions/Segments", questions.SegmentsRequest(
            asset="sun", max_stretches=4, segments=struct.pack("<6f", 0, -5, 1, 0, 5, 1)), "SegmentsReply", "questions"),
        "columns": ("/umbrage.v1.Questions/Columns", questions.ColumnsRequest(asset="lamp", points=points), "ColumnsReply", "questions"),
        "boxes": ("/umbrage.v1.Questions/Boxes", questions.BoxesRequest(
            asset="sun", boxes=struct.pack("<6f", -4, 0, 0, 4, 4, 2)), "BoxesReply", "questions"),
    }


def read(*names):
    with open(os.path.join(*names), "rb") as file:
        return file.read()


def write(data, *names):
    os.makedirs(os.path.dirname(os.path.join(*names)), exist_ok=True)
    with open(os.path.join(*names), "wb") as file:
        file.write(data if isinstance(data, bytes) else data.encode())


def bake(folder, name, out, options):
    told = ut.run("umbrage-bake", os.path.join(folder, "scene.obj"), "-o", out, *COMMON, *options)
    return json.loads(told.stdout)["asset"]


def answers(folder, asset, options):
    return ut.run("umbrage", "query", asset, "--points", os.path.join(folder, "points.f32"), "--format", "f32", "--encoding",
                  "f32", "--quiet", *options).stdout


def options_now():
    """Lines "program option kind" of all programs."""
    rows = [line.split("\t") for name in PROGRAMS for line in ut.run(name, "--print-options").stdout.decode().splitlines()]
    return sorted({" ".join((row[0], row[1], row[4])) for row in rows})


def lists_now(folder, test, daemon):
    """{file: lines}: what scripts hold on to, each line of which stays."""
    return {"options.tsv": options_now(), "metrics.txt": interfaces.metrics_now(daemon),
            "json.txt": interfaces.json_now(test, folder, daemon), "python.txt": interfaces.python_now()}


def ask(test, daemon, requests):
    """{name: bytes of the reply} to {name: (path, bytes of the request)}."""
    import grpc
    with grpc.insecure_channel(daemon.grpc_unix) as channel:
        return {name: b"".join(channel.unary_stream(path)(data, timeout=60)) if path in STREAMS else
                channel.unary_unary(path)(data, timeout=60) for name, (path, data) in requests.items()}


def decoded(folder, kind, file, data):
    """Lines of a message in protoc's text form, by the .proto files of the folder."""
    done = subprocess.run(["protoc", "-I" + os.path.join(folder, "proto"), f"--decode=umbrage.v1.{kind}", FILES[file]], input=data,
                          stdout=subprocess.PIPE, check=True)
    return [line for line in done.stdout.decode("latin-1").splitlines() if not VOLATILE.match(line)]


def points_of():
    """Points on and above the floor of the scene, x y z as float32."""
    grid = [(x / 4, y / 4, z / 2) for x in range(-16, 17, 2) for y in range(-16, 17, 2) for z in range(3)]
    return b"".join(struct.pack("<3f", *point) for point in grid)


def jobs_now(daemon):
    """What `umbrage jobs --json` says."""
    return ut.run("umbrage", "jobs", "--json", "--address", daemon.grpc_unix).stdout


def record(folder, test):
    write(read(ut.ROOT, "docs", "examples", "wall.obj"), folder, "scene.obj")
    write(points_of(), folder, "points.f32")
    os.makedirs(os.path.join(folder, "assets"))
    ids = {name: {"options": options, "id": bake(folder, name, os.path.join(folder, "assets", name + ".umb"), options)}
           for name, options in BAKES.items()}
    write(json.dumps(ids, indent=1), folder, "ids.json")
    for name in BAKES:
        for setting, options in QUERIES.items():
            write(answers(folder, os.path.join(folder, "assets", name + ".umb"), options), folder, "answers", f"{name}-{setting}.f32")
    daemon = test.daemon("--cache", test.path("cache-record"), "--jobs", test.path("jobs-record"), store=os.path.join(folder, "assets"))
    ut.run("umbrage", "submit", os.path.join(folder, "scene.obj"), *JOB, "--wait", "--quiet", "--address", daemon.grpc_unix)
    write(jobs_now(daemon), folder, "jobs.json")
    requests = {name: (path, message.SerializeToString()) for name, (path, message, _, _) in calls(test.messages).items()}
    for name, reply in ask(test, daemon, requests).items():
        write(requests[name][1], folder, "messages", name + ".request")
        write(reply, folder, "messages", name + ".reply")
    shutil.copytree(os.path.join(ut.ROOT, "proto", "umbrage"), os.path.join(folder, "proto", "umbrage"))
    for name, lines in lists_now(folder, test, daemon).items():
        write("\n".join(lines) + "\n", folder, name)
    shutil.copy(os.path.join(ut.ROOT, "tests", "abi", "record.txt"), os.path.join(folder, "abi.txt"))
    shutil.copy(os.path.join(ut.ROOT, "deploy", "umbraged.conf"), folder)
    daemon.stop()
    os.mkdir(os.path.join(folder, "jobs"))
    for part in JOBS:
        source = os.path.join(test.folder, part.replace("jobs", "jobs-record", 1))
        if os.path.isdir(source):
            shutil.copytree(source, os.path.join(folder, part), ignore=lambda _, names: [one for one in names if one.startswith(".")])
        else:
            shutil.copy(source, os.path.join(folder, part))


def file_problems(folder, test, _daemon):
    """Formats and ids: files are read, answers are the same bits, the same bake gives the same id."""
    for name, told in json.loads(read(folder, "ids.json")).items():
        asset = os.path.join(folder, "assets", name + ".umb")
        done = ut.run("umbrage", "info", asset, "--json", code=None)
        if done.returncode != 0 or told["id"].encode() not in done.stdout:
            yield f"format: assets/{name}.umb is not read as {told['id']}: {done.stderr.decode().strip()}"
            continue
        for setting, options in QUERIES.items():
            if answers(folder, asset, options) != read(folder, "answers", f"{name}-{setting}.f32"):
                yield f"answers: assets/{name}.umb has other answers with {setting}"
        again = bake(folder, name, test.path("again.umb"), told["options"])
        if again != told["id"]:
            yield f"ids: the bake of {name} has the id {again}, not {told['id']}"


def wire_problems(folder, test, daemon):
    """Wire: recorded requests are answered with at least the recorded fields."""
    table = calls(test.messages)
    served = interfaces.proto_lines(os.path.join(ut.ROOT, "proto"))
    for line in interfaces.proto_lines(os.path.join(folder, "proto")):
        if line not in served:
            yield f"wire: {line} is gone or another"
    names = sorted(name.removesuffix(".request") for name in os.listdir(os.path.join(folder, "messages")) if name.endswith(".request"))
    for name in names:
        path, _, kind, file = table[name]
        try:
            reply = ask(test, daemon, {name: (path, read(folder, "messages", name + ".request"))})[name]
        except Exception as error:  # grpc.RpcError: any code is a finding
            yield f"wire: {name} is refused: {error}"
            continue
        found, wanted = decoded(folder, kind, file, reply), decoded(folder, kind, file, read(folder, "messages", name + ".reply"))
        for line in wanted:
            if line in found:
                found.remove(line)
            else:
                yield f"wire: the reply to {name} lacks {line.strip()[:100]}"


def state_problems(folder, _test, daemon):
    """What an installation keeps: the table of jobs with their assets, and the configuration."""
    now = {job["job"]: job for job in json.loads(jobs_now(daemon))["jobs"]}
    for before in json.loads(read(folder, "jobs.json"))["jobs"]:
        found = now.get(before["job"], {})
        for key in before:
            if found.get(key) != before[key]:
                yield f"jobs: {before['job']} has {key} {found.get(key)}, not {before[key]}"
        done = ut.run("umbrage", "query", before["asset"], "--points", "-", "--address", daemon.grpc_unix, stdin=b"0 2 0\n", code=None)
        if done.stdout.strip() != b"0":
            yield f"jobs: the asset of {before['job']} is not served: {done.stderr.decode().strip()[:200]}"
    done = ut.run("umbraged", "--config", os.path.join(folder, "umbraged.conf"), "--check-config", code=None)
    if done.returncode != 0:
        yield f"configuration: umbraged.conf is refused: {done.stderr.decode().strip()[:200]}"


def list_problems(folder, test, daemon):
    """CLI, metrics, Python, API: what was there is there with the same kind."""
    for file, now in lists_now(folder, test, daemon).items():
        before = read(folder, file).decode().splitlines()
        for line in before:
            if line not in now:
                yield f"{file.split('.')[0]}: {line} is gone or of another kind"
        for line in interfaces.new_needs(before, now) if file == "python.txt" else ():
            yield f"python: {line} is new"
    done = subprocess.run([os.path.join(ut.ROOT, "tests", "abi", "abi.py"), "keeps", os.path.join(folder, "abi.txt")],
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    if done.returncode != 0:
        yield f"API: {done.stdout.strip()[-500:]}"


PARTS = (file_problems, wire_problems, state_problems, list_problems)


def problems(folder, test, parts=PARTS):
    """What this build does otherwise than the version of a folder, a sentence each."""
    jobs = test.path("jobs-check")
    shutil.rmtree(jobs, ignore_errors=True)
    shutil.copytree(os.path.join(folder, "jobs"), jobs)
    for place in (jobs, os.path.join(jobs, "assets")):
        os.chmod(place, 0o700)
    daemon = test.daemon("--cache", test.path("cache-check"), "--jobs", jobs, store=os.path.join(folder, "assets"))
    try:
        for part in parts:
            yield from part(folder, test, daemon)
    finally:
        daemon.stop()


def main(what, folder):
    run = ut.Test()
    if what == "record":
        if os.path.exists(folder):
            sys.exit(f"compat: {folder} is there already: what a release promised stays; remove it if it is not released")
        record(run.path("record"), run)
        shutil.copytree(run.path("record"), folder)
        print(f"{folder}: {sum(len(names) for _, _, names in os.walk(folder))} files")
    found = list(problems(folder, run))
    print("\n".join(found) or "everything that it promised is kept")
    return 1 if found else 0


if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[1] not in ("record", "check"):
        sys.exit(__doc__)
    ut.need_grpc()
    sys.exit(main(*sys.argv[1:]))
