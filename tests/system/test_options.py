#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""
The options of all four programs, as their tables have them: hostile values end with exit code 2 and
one sentence that names the option; completions offer exactly the options and values of the tables.
"""
import os
import shutil
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "harness"))
import umbrage_test as ut  # noqa: E402

PROGRAMS = ("umbrage", "umbraged", "umbrage-bake", "umbrage-study")
NUMERIC = {"count", "odd", "power", "number", "numbers", "bytes", "time", "sides", "mode"}
# No number, size, time or word of a list, whatever the option.
HOSTILE = [b"", b"nan", b"-inf", b"1e999", b"0x10", b"9" * 400, b"1 ", b" 1", b"--", b"%s%n",
           b"\xff\xfe\x80", b"\xc2\x9b[2J", b"\x1b[2J", "\u202e1".encode(), b"1,,2", b"1.5.5x"]

test = ut.Test()
os.chdir(test.folder)


def rows_of(program):
    """The lines of a program's tables, each as nine columns."""
    lines = ut.run(program, "--print-options").stdout.decode().splitlines()
    return [line.split("\t") for line in lines]


ROWS = {program: rows_of(program) for program in PROGRAMS}
OPTIONS = [row for rows in ROWS.values() for row in rows
           if row[1].startswith("--") and row[1] != "--help"]


def words_of(command):
    """The program and words that start a command, with the arguments that it needs."""
    words = command.split()
    program = words[0]
    if program == "umbrage" and words[1] in ("render", "points", "aliasing", "techniques", "deep", "study"):
        program = "umbrage-study"
    if program == "umbraged":
        return [program, "--store", "x", "--check-config"]
    return [program] + words[1:]


def refuse(command, *words):
    """Runs a command that must end with 2 and one line of UTF-8; returns the line."""
    start = words_of(command)
    done = subprocess.run([ut.program(start[0])] + start[1:] + list(words), stdin=subprocess.DEVNULL,
                          capture_output=True, timeout=60, check=False)
    said = done.stderr.decode("utf-8")  # strict: whatever the argument was
    assert done.returncode == 2, (command, words, done.returncode, said)
    assert said.count("\n") == 1 and len(done.stderr) < 600 and not done.stdout, (words, said)
    assert all(c >= " " and c not in "\x7f\x9b" for c in said.rstrip("\n")), (words, said)
    return said


def kind_of(command, option):
    return next(row[4] for row in OPTIONS if row[0] == command and row[1] == option)


with test.check("the four programs have tables of options"):
    assert len(OPTIONS) > 250, len(OPTIONS)
    for row in OPTIONS:
        assert len(row) == 9 and row[8], row
    assert {row[0].split()[0] for row in OPTIONS} == {"umbrage", "umbraged", "umbrage-bake",
                                                      "umbrage-study"}

with test.check("a hostile value of a number or a choice ends with 2 and names the option"):
    for index, row in enumerate(OPTIONS):
        if row[4] not in NUMERIC | {"choice"}:
            continue
        # Five values for each option, so that all values are used in turn: test_options.c tests
        # each with every kind.
        for value in (HOSTILE * 2)[5 * index % len(HOSTILE):][:5]:
            said = refuse(row[0], row[1].encode() + b"=" + value)
            assert row[1] + ": '" in said and "; give " in said, said

with test.check("an empty text is refused where a text is needed"):
    for row in OPTIONS:
        if row[4] in ("text", "list") and row[1] != "--address":
            assert row[1] + ": '' is not valid; give " in refuse(row[0], row[1], "")

with test.check("other values are refused by their readers"):
    for row in OPTIONS:
        job = row[0] == "umbrage submit"  # the daemon reads these
        if row[4] == "read" and not job and row[1] not in ("--light", "--only", "--scene-buffer"):
            for value in (b"nan", b"\xff\xfe\x80", b"9" * 400, b"--"):
                files = row[1] in ("--output", "--report", "--export")
                if not files:
                    assert row[1] in refuse(row[0], row[1].encode() + b"=" + value), (row, value)

with test.check("a value that is missing, unwanted or repeated"):
    for row in OPTIONS:
        if row[3] or row[5]:
            assert f"{row[1]}: needs a value; give " in refuse(row[0], row[1])
        else:
            assert f"{row[1]}: takes no value" in refuse(row[0], row[1] + "=1")
    # The last value counts. A bad value before it must be refused as well; a good one is replaced.
    assert "'nan'" in refuse("umbrage jobs", "--limit", "5", "--limit", "nan")
    assert "'nan'" in refuse("umbrage jobs", "--limit", "nan", "--limit", "5")
    ut.run("umbraged", "--store", "x", "--workers", "2", "--workers", "3", "--check-config")

with test.check("unknown options and names that are not UTF-8"):
    for command in sorted({row[0] for row in OPTIONS}):
        for word in (b"--no-such", b"-\xff", b"--\xff\xfe=1", b"---", b"--=1", b"--" + b"x" * 4000):
            assert "is not known; see --help" in refuse(command, word)

with test.check("--help is on stdout and ends with 0, also behind nonsense"):
    for command in sorted({row[0] for row in OPTIONS}):
        start = words_of(command)
        for words in (["--help"], ["-h", "--nonsense"]):
            told = ut.run(*start, *words).stdout.decode()
            assert told.startswith("usage: "), told
            for row in OPTIONS:
                assert row[0] != command or row[1] in told, (command, row[1])

# --- completions ---

made = subprocess.run(["make", "--no-print-directory", "-s",
                       "BUILD=" + os.path.relpath(ut.BUILD, ut.ROOT), "completions"],
                      cwd=ut.ROOT, capture_output=True, text=True, check=False)
FOLDER = os.path.join(ut.BUILD, "completion")
with test.check("make completions"):
    assert made.returncode == 0, made.stderr

DRIVER = """
source "$1"
shift
while IFS= read -r line; do
    eval "COMP_WORDS=($line)"
    COMP_CWORD=$((${#COMP_WORDS[@]} - 1))
    COMPREPLY=()
    function=$(complete -p "${COMP_WORDS[0]##*/}" | sed 's/.*-F \\([^ ]*\\).*/\\1/')
    "$function" "${COMP_WORDS[0]}" "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD-1]}"
    echo "${COMPREPLY[*]}"
done
"""


def complete(*lines):
    """What bash offers for each line, as sets of words."""
    done = subprocess.run(["bash", "--norc", "-c", DRIVER, "driver", FOLDER + "/umbrage.bash"],
                          input="\n".join(lines) + "\n", capture_output=True, text=True,
                          timeout=300, check=True)
    offers = done.stdout.split("\n")[:-1]
    assert len(offers) == len(lines) and not done.stderr, (offers[:3], done.stderr[:500])
    return [set(offer.split()) for offer in offers]


def tables():
    """Options by the words that lead to them."""
    found = {}
    for row in OPTIONS + [row for rows in ROWS.values() for row in rows if row[1] == "--help"]:
        names = [row[0]]
        words = row[0].split()
        if words[0] == "umbrage" and words[1] in ("render", "points", "aliasing", "techniques", "deep", "study"):
            names.append("umbrage-study " + words[1])
        if row[0] == "umbrage-study verify":
            names.append("umbrage verify")
        if row[0] == "umbrage-bake":
            names += ["umbrage bake", "umbrage-bake tile", "umbrage-bake merge",
                      "umbrage-bake import"]
        if row[0] == "umbrage study":
            names.append("umbrage-study")
        for name in names:
            found.setdefault(name, {})[row[1]] = row
    return found


TABLES = tables()

if shutil.which("bash"):
    with test.check("bash offers exactly the options of each command"):
        names = sorted(TABLES)
        for name, offered in zip(names, complete(*[name + " --" for name in names])):
            assert offered == set(TABLES[name]), (name, offered ^ set(TABLES[name]))

    with test.check("bash offers exactly the words of a choice, in both forms"):
        choices = [(name, option, row[5]) for name, options in sorted(TABLES.items())
                   for option, row in sorted(options.items()) if row[5]]
        assert len(choices) > 30, choices
        for lines in ([f"{name} {option} ''" for name, option, _ in choices],
                      [f"{name} {option} =" for name, option, _ in choices]):
            for (name, option, words), offered in zip(choices, complete(*lines)):
                assert offered == set(words.split("|")) - {""}, (name, option, offered)

    with test.check("bash offers sub-commands, beginnings, files, and nothing for numbers"):
        for program in ("umbrage", "umbrage-bake", "umbrage-study"):
            named = {row[1] for row in ROWS[program] if row[4] in ("command", "program")}
            assert named <= complete(program + " ''")[0], named
        assert complete("umbrage qu", "umbrage query --filt", "umbrage query --filter p",
                        "umbrage query --taps ''", "/usr/bin/umbraged --log-l") == [
                            {"query"}, {"--filter"}, {"penumbra"}, set(), {"--log-level"}]
        open("a_file.umb", "w", encoding="utf-8").close()
        assert complete("umbrage info a_f", "umbrage query --points a_f",
                        "umbrage query -o a_f") == [{"a_file.umb"}] * 3

    with test.check("bash offers folders and the files that a command reads"):
        for name in ("b_asset.umb", "b_mapped.umbm", "b_scene.glb", "b_scene.obj", "b_notes.txt"):
            open(name, "w", encoding="utf-8").close()
        os.mkdir("b_folder")
        assets, scenes = {"b_asset.umb", "b_mapped.umbm", "b_folder"}, {"b_scene.glb", "b_scene.obj", "b_folder"}
        for command in ("query", "info", "verify", "view", "stream", "derive", "query x.umb --json"):
            assert complete(f"umbrage {command} b_") == [assets], command
        assert complete("umbrage render b_", "umbrage-bake b_", "umbrage bake b_", "umbrage view x.umb --scene b_",
                        "umbrage-study verify x.umb --scene b_") == [scenes] * 5
        assert complete("umbrage watch b_", "umbrage load b_", "umbraged b_") == [set()] * 3
        assert complete("umbrage query --points b_") == [assets | scenes | {"b_notes.txt"}]

else:
    ut.left_out("completions of bash", "bash is not installed")

for shell in ("bash", "zsh", "fish"):
    if shutil.which(shell):
        with test.check(f"{shell} reads the completions"):
            subprocess.run([shell, "-n", f"{FOLDER}/umbrage.{shell}"], check=True)
    else:
        ut.left_out(f"completions of {shell}", f"{shell} is not installed")

with test.check("zsh's and fish's completions have every option"):
    with open(FOLDER + "/umbrage.zsh", encoding="utf-8") as file:
        zsh = file.read()
    with open(FOLDER + "/umbrage.fish", encoding="utf-8") as file:
        fish = file.read().splitlines()
    for name, options in TABLES.items():
        line = next(line for line in zsh.splitlines() if line.startswith(f"'{name}') _arguments"))
        for option in options:
            assert f"'*{option}[" in line or f"'*{option}=[" in line, (name, option)
            assert any(f" -l {option[2:]} " in entry and entry.startswith(
                f"complete -c {name.split()[0]} ") for entry in fish), (name, option)

test.finish()
