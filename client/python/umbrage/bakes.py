# SPDX-License-Identifier: Apache-2.0
"""
Bakes by the program umbrage-bake.
"""
from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import threading
from dataclasses import dataclass
from numbers import Real
from typing import Any, Callable, Iterator, Mapping, Optional

from ._library import OWN, path_text
from .errors import CancelledError, Error, FileError, SceneError

# Exit codes of umbrage-bake that have an exception of their own.
_CLASSES = {65: (SceneError, "E_BAD_SCENE"), 66: (FileError, "E_NO_INPUT"), 73: (FileError, "E_CANNOT_CREATE"),
            74: (FileError, "E_IO"), 130: (CancelledError, "E_CANCELLED"), 143: (CancelledError, "E_CANCELLED")}


def _own_program() -> str:
    """The program that the wheel carries; else the name, which PATH resolves."""
    own = os.path.join(OWN, "bin", "umbrage-bake")
    return own if os.path.exists(own) else "umbrage-bake"


@dataclass(frozen=True)
class Progress:
    """
    Progress of a bake.

    phase        "import", "analysis", "bake", "write", "verify"
    done, total  units of the phase; total 0: not known
    unit         "texel", "point", ...
    """

    phase: str
    done: int = 0
    total: int = 0
    unit: str = ""


def _is_numbers(value: Any) -> bool:
    return isinstance(value, (list, tuple)) and len(value) > 1 and all(
        isinstance(one, Real) and not isinstance(one, bool) for one in value)


def _text_of(value: Any) -> str:
    return ",".join(map(str, value)) if _is_numbers(value) else str(value)


def pairs_of(options: Mapping[str, Any]) -> Iterator[tuple[str, Optional[str]]]:
    """
    Names and values of options: True is an option without a value, False and None are left out. Several numbers are one
    value, as sun=(135, 40); any other list repeats the option.
    """
    for name, value in options.items():
        for one in value if isinstance(value, (list, tuple)) and not _is_numbers(value) else (value,):
            if one is not False and one is not None:
                yield str(name).rstrip("_").replace("_", "-"), None if one is True else _text_of(one)


def words_of(options: Mapping[str, Any]) -> list[str]:
    """Command line words of options."""
    return [word for name, value in pairs_of(options) for word in (["--" + name] + ([] if value is None else [value]))]


def _read_progress(lines: Any, progress: Callable[[Progress], Any], plan: list[str], problems: list[Any]) -> None:
    phase = ""
    for line in lines:
        words = line.split()
        try:
            if words[:1] == ["phase"]:
                phase = words[1]
                progress(Progress(phase))
            elif words[:1] == ["progress"]:
                progress(Progress(phase, int(words[1]), int(words[2]), words[3]))
            elif words[:1] == ["plan"]:
                plan.append(line[5:].strip())
        except BaseException as problem:  # the callback's: ends the bake
            problems.append(problem)
            return


def bake(scene: Any, output: Any, *, progress: Optional[Callable[[Progress], Any]] = None,
         program: Optional[str] = None, **options: Any) -> dict[str, Any]:
    """
    Bakes a scene file into an asset file, and returns umbrage-bake's report as a dict.

    options   umbrage-bake's: bake("city.glb", "city.umb", sun=(135, 45), resolution=16384, closed="off"); a list gives an option
              several times: sun=[(135, 45), (200, 30)]
    progress  called with Progress on a thread of its own; an exception in it ends the bake
    program   path of umbrage-bake; None: the one that the wheel carries, else the first on PATH

    The output appears whole or not at all. Ctrl-C ends the bake and leaves nothing. Raises SceneError, FileError, and
    Error with the sentence of umbrage-bake.
    """
    if progress is not None and not callable(progress):
        raise TypeError(f"progress: must be callable, not {type(progress).__name__}")
    names = [path_text(value, name) for value, name in ((_own_program() if program is None else program, "program"),
                                                        (scene, "scene"), (output, "output"))]
    given = words_of(options)
    if any("\0" in word for word in given):
        raise ValueError("options: have a NUL character")
    reader, writer = os.pipe()
    words = [*names[:2], "-o", names[2], "--json", "--progress-fd", str(writer), *given]
    plan: list[str] = []
    problems: list[Any] = []
    try:
        process = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                                   pass_fds=(writer,), text=True, errors="replace")
    except OSError as problem:
        os.close(reader)
        advice = "" if program is not None else ": install the package umbrage-bake, or give its path as program"
        raise FileError(f"{names[0]}: {problem.strerror}{advice}", "E_NO_INPUT", problem.errno or 0) from None
    finally:
        os.close(writer)

    def follow() -> None:
        with os.fdopen(reader, errors="replace") as lines:
            _read_progress(lines, progress or (lambda told: None), plan, problems)
        if problems:
            process.send_signal(signal.SIGTERM)

    thread = threading.Thread(target=follow, daemon=True)
    thread.start()
    try:
        told, said = process.communicate()
    except BaseException:
        process.send_signal(signal.SIGTERM)
        process.wait()
        for pipe in (process.stdout, process.stderr):
            if pipe is not None:
                pipe.close()
        raise
    thread.join()
    if problems:
        raise problems[0]
    if process.returncode != 0:
        lines = [line for line in said.splitlines() if line.strip()]
        sentence = lines[-1].removeprefix("umbrage-bake: ") if lines else f"exit code {process.returncode}"
        kind, status = _CLASSES.get(process.returncode, (Error, "E_INTERNAL"))
        raise kind(f"{sentence} ({shlex.join(words[:2])} ...)", status)
    try:
        report: dict[str, Any] = json.loads(told)
    except ValueError:
        raise Error(f"{names[0]}: prints no report: is it umbrage-bake?", "E_PROTOCOL") from None
    report["plan"] = plan
    return report
