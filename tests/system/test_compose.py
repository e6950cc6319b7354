#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
deploy/compose: every option, path, port and name in it exists; each service is shut in; the commands as they stand serve
a query through HAProxy (as processes in a network namespace; in containers where docker or podman runs).
"""
import json
import os
import re
import shutil
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

try:
    import yaml
except ImportError:
    ut.skip("python3-yaml is not installed")
test = ut.Test()
FOLDER = os.path.join(ut.ROOT, "deploy", "compose")
FILE = os.path.join(FOLDER, "compose.yml")
with open(FILE, encoding="utf-8") as text:
    compose = yaml.safe_load(text)
services = compose["services"]
replicas = {name: one for name, one in services.items() if name.startswith("umbraged")}


def options_of(program):
    """Long options of a program of ours."""
    lines = ut.run(program, "--print-options").stdout.decode().splitlines()
    return {line.split("\t")[1] for line in lines}


def option(words, name):
    return words[words.index(name) + 1]


def mounts(service):
    """{path in the container: (source, mode)} of a service."""
    parts = [re.match(r"((?:\$\{[^}]*\})|[^:]*):([^:]*)(?::(.*))?$", one).groups() for one in service.get("volumes", [])]
    return {place: (source, mode) for source, place, mode in parts}


with test.check("every service is shut in: read-only root, no capabilities, no gain of rights, a user, limits"):
    for name, service in services.items():
        assert service["read_only"] is True and service["cap_drop"] == ["ALL"], name
        assert service["security_opt"] == ["no-new-privileges:true"], name
        assert re.fullmatch(r"[1-9]\d*:[1-9]\d*", service["user"]), name
        assert service["mem_limit"] and service["pids_limit"], name
        assert "privileged" not in service and "devices" not in service, name

with test.check("images of others are pinned by digests; one port is published, on loopback"):
    for name, service in services.items():
        assert service["image"] == "${UMBRAGE_IMAGE:-umbrage}" or re.search(
            r"@\$\{[A-Z]+_DIGEST:(\?|-sha256:[0-9a-f]{64}\}$)", service["image"]), name
    assert [service["ports"] for service in services.values() if "ports" in service] == [["127.0.0.1:${UMBRAGE_PORT:-7420}:7420"]]
    assert all(one["network_mode"] in ("service:haproxy", "none") for name, one in services.items() if name != "haproxy")

with test.check("every option exists, tokens are asked for, and umbraged takes the commands"):
    known = options_of("umbraged")
    for name, service in replicas.items():
        words = service["entrypoint"]
        assert words[0] == "umbraged" and {word for word in words if word.startswith("--")} <= known, (name, words)
        assert option(words, "--token-file") == "/run/secrets/" + service["secrets"][0], name
        ut.run("umbraged", "--check-config", *words[1:])
        assert option(words, "--store") in mounts(service) and mounts(service)["/var/lib/umbrage"][1] == "ro", name
        assert any(one.startswith(option(words, "--cache") + ":") for one in service["tmpfs"]), name
        health = service["healthcheck"]["test"]
        assert health[0] == "CMD" and health[-1] == f"http://{option(words, '--admin')}/livez", name
    bake = services["bake"]
    assert bake["entrypoint"] == ["umbrage-bake"] and bake["network_mode"] == "none" and bake["profiles"] == ["bake"]
    assert set(services["umbraged-1"]["secrets"]) == set(compose["secrets"])

with test.check("mounted files exist; HAProxy gets every address that its file asks for, Prometheus every admin port"):
    for name, service in services.items():
        for place, (source, mode) in mounts(service).items():
            if source.startswith("."):
                assert os.path.isfile(os.path.join(FOLDER, source)) and mode == "ro", (name, source)
            else:
                assert source.startswith("${") or source in compose["volumes"], (name, source)
    environment = services["haproxy"]["environment"]
    with open(os.path.join(ut.ROOT, "deploy", "haproxy", "haproxy.cfg"), encoding="utf-8") as text:
        assert set(re.findall(r"\$\{(\w+)\}", text.read())) == set(environment)
    assert sorted(value for key, value in environment.items() if key != "UMBRAGE_FRONTEND") == sorted(
        option(one["entrypoint"], "--listen").removeprefix("tcp:") for one in replicas.values())
    with open(os.path.join(FOLDER, "prometheus.yml"), encoding="utf-8") as text:
        scrape = yaml.safe_load(text)
    assert sorted(scrape["scrape_configs"][0]["static_configs"][0]["targets"]) == sorted(
        option(one["entrypoint"], "--admin") for one in replicas.values())
    assert {os.path.basename(place) for place in mounts(services["prometheus"])} >= set(scrape["rule_files"])

if shutil.which("promtool"):
    with test.check("promtool takes the file of Prometheus"):
        for name in (os.path.join(FOLDER, "prometheus.yml"), os.path.join(ut.ROOT, "deploy", "prometheus", "umbrage-alerts.yml")):
            shutil.copy(name, test.folder)
        subprocess.run(["promtool", "check", "config", test.path("prometheus.yml")], check=True, stdout=subprocess.DEVNULL)
else:
    ut.left_out("Prometheus in compose", "promtool is not installed")

# The services as processes, with the container's paths in the test's folder, in a network namespace of their own.
SCRIPT = '''
import json, os, subprocess, sys, time
subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
services, umbrage, points = json.loads(sys.argv[1]), sys.argv[2], sys.argv[3]
running = [subprocess.Popen(words, env={**os.environ, **environment}, stderr=open(log, "wb")) for words, environment, log in services]
try:
    place = ["--address", "tcp:127.0.0.1:7420", "--token-file", sys.argv[4]]
    for _ in range(300):
        if subprocess.run([umbrage, "list", *place], capture_output=True).returncode == 0:
            break
        time.sleep(0.2)
    done = subprocess.run([umbrage, "query", "city", "--points", points, "--quiet", *place], capture_output=True, text=True)
    refused = subprocess.run([umbrage, "list", "--address", "tcp:127.0.0.1:7420"], capture_output=True, text=True)
    health = [subprocess.run(words).returncode for words in json.loads(sys.argv[5])]
    print(json.dumps([done.stdout, done.stderr, refused.returncode, refused.stderr, health]))
finally:
    for one in running:
        one.terminate()
    for one in running:
        one.wait()
'''
can_unshare = subprocess.run(["unshare", "--net", "ip", "link"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                             check=False).returncode == 0 if shutil.which("unshare") and shutil.which("ip") else False
if not can_unshare or not shutil.which("haproxy") or not shutil.which("curl"):
    ut.left_out("compose's commands as processes", "network namespaces, haproxy or curl are missing here")
else:
    with test.check("the commands as they stand answer through HAProxy with a token and refuse without; health checks pass"):
        os.makedirs(test.path("store"))
        test.bake(test.scene("city", 2), test.path("store", "city.umb"), "--resolution", 256, "--verify", 0)
        with os.fdopen(os.open(test.path("tokens"), os.O_WRONLY | os.O_CREAT, 0o600), "w", encoding="ascii") as out:
            out.write("studio query 0123456789abcdef0123456789abcdef\n")
        with os.fdopen(os.open(test.path("token"), os.O_WRONLY | os.O_CREAT, 0o600), "w", encoding="ascii") as out:
            out.write("0123456789abcdef0123456789abcdef\n")
        with open(test.path("points.txt"), "w", encoding="ascii") as out:
            out.write("10 2 10\n-40 0.5 12\n")
        commands = [(["haproxy", "-db", "-f", os.path.join(ut.ROOT, "deploy/haproxy/haproxy.cfg")], environment, test.path("haproxy.log"))]
        for name, service in replicas.items():
            places = {"/var/lib/umbrage": test.path("store"), "/var/cache/umbrage": test.path("cache-" + name),
                      "/run/secrets/umbrage-tokens": test.path("tokens")}
            commands.append(([ut.program("umbraged")] + [places.get(word, word) for word in service["entrypoint"][1:]], {},
                             test.path(name + ".log")))
        health = [one["healthcheck"]["test"][1:] for one in replicas.values()]
        done = subprocess.run(["unshare", "--net", sys.executable, "-c", SCRIPT, json.dumps(commands), ut.program("umbrage"),
                               test.path("points.txt"), test.path("token"), json.dumps(health)], stdout=subprocess.PIPE,
                              check=True, text=True, timeout=200)
        answers, said, code, refusal, passed = json.loads(done.stdout)
        wanted = ut.run("umbrage", "query", test.path("store", "city.umb"), "--points", test.path("points.txt"), "--quiet")
        assert answers == wanted.stdout.decode(), (answers, said)
        assert code != 0 and "token" in refusal, (code, refusal)
        assert passed == [0, 0, 0], passed

engine = next((name for name in ("docker", "podman") if shutil.which(name) and subprocess.run(
    [name, "info"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False).returncode == 0), None)
if engine is None:
    ut.left_out("compose in containers", "neither docker nor podman runs here")
else:
    with test.check(f"{engine} compose takes the file"):
        subprocess.run([engine, "compose", "-f", FILE, "config", "--quiet"], check=True, env={
            **os.environ, "UMBRAGE_STORE": test.folder, "UMBRAGE_TOKENS": FILE, "HAPROXY_DIGEST": "sha256:" + "0" * 64,
            "PROMETHEUS_DIGEST": "sha256:" + "0" * 64})

test.finish()
