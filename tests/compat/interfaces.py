# SPDX-License-Identifier: Apache-2.0
"""
What scripts and clients hold on to, as sorted lines of text: a version keeps the lines of every earlier one. Keys of --json
with their types, metrics with their labels, the Python module's names and parameters, methods and fields of the wire.
"""
import inspect
import json
import os
import re
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

JSON_TYPES = {bool: "bool", int: "number", float: "number", str: "text"}
FIELD_TYPES = "double float int64 uint64 int32 fixed64 fixed32 bool string group message bytes uint32 enum".split()


def json_lines(prefix, value):
    """Lines "KEY.KEY type" of a JSON value. The keys of an object may be numbers, as those of levels: such a key is N."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield from json_lines(f"{prefix}.{'N' if key.isdigit() else key}", item)
    elif isinstance(value, list):
        for item in value:
            yield from json_lines(prefix + "[]", item)
    elif value is not None:
        yield f"{prefix} {JSON_TYPES[type(value)]}"


def json_now(test, folder, daemon):
    """Lines "command KEY.KEY type" of what programs print with --json."""
    scene, asset = os.path.join(folder, "scene.obj"), os.path.join(folder, "assets", "front.umb")
    points, out = os.path.join(folder, "points.f32"), test.path("json.out")
    at = ("--address", daemon.grpc_unix)
    # A job that the daemon has not seen: a job of an earlier daemon has no figures of its tiles.
    job = ("--sun", f"180,{time.time_ns() % 10**6 / 10**6 + 45}", "--up", "z", "--resolution", "256", "--verify", "0")
    bake = (scene, "--sun", "180,45", "--resolution", "256", "--up", "z", "--closed", "off", "--json")
    few = ("--points", points, "--format", "f32", "--taps", "9", "--json")
    calls = {"info": ("info", asset, "--json"), "query": ("query", asset, *few), "query-explain": ("query", asset, *few, "--explain"),
             "list": ("list", *at, "--json"), "jobs": ("jobs", *at, "--json"),
             "submit": ("submit", scene, *job, "--wait", "--json", *at), "sample": ("sample", asset, "--count", "5", "--json", "-o", out),
             "verify": ("verify", asset, "--json"), "verify-scene": ("verify", asset, "--scene", scene, "--points", "1000", "--json"),
             "derive": ("derive", asset, "--size", "16", "--json", "-o", out), "unpack": ("unpack", asset, "--json", "-o", out),
             "stream": ("stream", "front", *at, "--box", "-1,-1,0,1,1,1", "--json", "-o", out),
             "points": ("points", scene, "--count", "5", "--json", "-o", out), "version": ("version", "--json"),
             "bake": ("bake", *bake, "--quiet", "--verify", "1000", "-o", test.path("json.umb")), "bake-plan": ("bake", *bake, "--plan")}
    lines = set()
    for name, words in calls.items():
        told = ut.run("umbrage", *words).stdout
        lines.update(json_lines(f"{name} ", json.loads(told)))
    return sorted(lines)


def metrics_now(daemon):
    """Lines "name type" and "name has LABEL" of the metrics that are served."""
    text = daemon.admin("/metrics")[1]
    labels = {f"{name} has {label}" for name, row in re.findall(r"^([a-z_:]+)\{(.*)\} ", text, re.M)
              for label in re.findall(r'(\w+)="', row)}
    return sorted(labels | set(re.findall(r"^# TYPE (\S+ \S+)$", text, re.M)))


def parameters(name, function):
    """Lines "name(PARAMETER) place kind need" of a function."""
    try:
        shown = list(inspect.signature(function).parameters.values())
    except (TypeError, ValueError):
        return
    for place, one in enumerate(one for one in shown if one.name != "self"):
        where = f"place {place}" if one.kind is one.POSITIONAL_OR_KEYWORD else one.kind.name.lower()
        yield f"{name}({one.name}) {where}, {'required' if one.default is one.empty and 'VAR' not in one.kind.name else 'optional'}"


def python_now():
    """The lines of python_lines(), of a process of its own: messages that protoc made are a package umbrage too."""
    done = subprocess.run([sys.executable, __file__], stdout=subprocess.PIPE, check=True, text=True)
    return done.stdout.splitlines()


def python_lines(umbrage):
    """Lines of the module: names, members, parameters, and what an exception is."""
    lines = set()
    for name in umbrage.__all__:
        thing = getattr(umbrage, name)
        lines.update([f"{name} is there", *parameters(name, thing)])
        if isinstance(thing, type):
            lines.update(f"{name} is a {base.__name__}" for base in thing.__mro__[1:-1])
            for member in {*dir(thing), *(key for kind in thing.__mro__ for key in getattr(kind, "__annotations__", {}))}:
                if not member.startswith("_") and not hasattr(BaseException, member):
                    body = inspect.getattr_static(thing, member, None)
                    lines.update([f"{name}.{member} is there", *(parameters(f"{name}.{member}", body) if callable(body) else ())])
    return sorted(lines)


def new_needs(before, now):
    """Parameters that an earlier module did not have and that this one requires, in functions that it had."""
    known = {line.split("(")[0] for line in before if "(" in line} | {line.split(" ")[0] for line in before}
    return [line for line in now if line.endswith(", required") and line.split("(")[0] in known and line not in before]


def message_lines(prefix, message):
    for field in message.field:
        kind = field.type_name or FIELD_TYPES[field.type - 1]
        yield f"{prefix}.{message.name}.{field.name} = {field.number}: {'many ' if field.label == 3 else ''}{kind}"
    for one in message.enum_type:
        yield from (f"{prefix}.{message.name}.{one.name}.{value.name} = {value.number}" for value in one.value)
    for one in message.nested_type:
        yield from message_lines(f"{prefix}.{message.name}", one)


def proto_lines(folder):
    """Lines of the methods, fields and values of the .proto files below a folder."""
    from google.protobuf import descriptor_pb2
    names = [os.path.relpath(os.path.join(place, name), folder) for place, _, files in os.walk(folder) for name in files
             if name.endswith(".proto")]
    with tempfile.NamedTemporaryFile() as file:
        subprocess.run(["protoc", "-I" + folder, "--descriptor_set_out=" + file.name, *sorted(names)], check=True)
        found = descriptor_pb2.FileDescriptorSet.FromString(file.read())
    lines = []
    for one in found.file:
        for message in one.message_type:
            lines += message_lines(one.package, message)
        for kind in one.enum_type:
            lines += [f"{one.package}.{kind.name}.{value.name} = {value.number}" for value in kind.value]
        for service in one.service:
            lines += [f"/{one.package}.{service.name}/{way.name} {way.input_type} {way.client_streaming} {way.output_type} "
                      f"{way.server_streaming}" for way in service.method]
    return sorted(lines)


if __name__ == "__main__":
    print("\n".join(python_lines(ut.need_module()[0])))
