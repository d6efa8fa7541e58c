"""Runs many cases in a few plain processes, each with limits of time and memory, so that a hang or a crash is a finding and not the end.

A *task* is ``"module:function"``; the function gets what ``context`` holds and the number of the case, and returns one word for the
outcome, such as ``"value"`` or the name of a typed error. Whatever it raises is a finding. A worker that dies or is late is a finding
too; another one takes its place. Of an input only its number goes to the worker: whoever has the seed and the number has the case.

>>> summary = run_cases("cases:run_case", {"kind": "objects", "seed": 1, "folder": "/tmp/seeds"}, range(1000))  # doctest: +SKIP
>>> summary.outcomes, summary.findings  # doctest: +SKIP
"""

from __future__ import annotations

import faulthandler
import importlib
import json
import os
import queue
import resource
import select
import subprocess
import sys
import tempfile
import threading
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

LATE = 20.0
"""A case that takes longer than this many seconds hangs."""
START = 120.0
"""A worker may take so long to import what it needs, s: a busy machine is no finding."""
MEMORY = 4 * 2**30
"""Address space of a worker, bytes. The libraries themselves take half of one."""


@dataclass(frozen=True)
class Finding:
    """A case that did not end as it should: ``kind`` is ``untyped``, ``hang`` or ``crash``."""

    number: int
    kind: str
    text: str

    @property
    def place(self) -> str:
        """Where in the code, as far as that is known: equal for findings of the same fault."""
        lines = [line.strip() for line in self.text.splitlines() if line.strip()]
        files = [line for line in lines if line.startswith("File ")]
        return f"{self.kind}: {files[-1] if files else ''} {lines[-1][:160] if lines and self.kind == 'untyped' else ''}".strip()


@dataclass
class Summary:
    """What came of all cases."""

    outcomes: Counter[str] = field(default_factory=Counter)
    """How many cases ended with each word."""
    findings: list[Finding] = field(default_factory=list)
    slowest: tuple[float, int] = (0.0, -1)
    """Time (s) and number of the slowest case."""
    cpu: float = 0.0
    """Processor time of all workers, s, with their start."""

    def __str__(self) -> str:
        counts = ", ".join(f"{count} {word}" for word, count in self.outcomes.most_common())
        lines = [
            f"{sum(self.outcomes.values())} cases: {counts}; "
            f"slowest {self.slowest[0]:.2f} s (case {self.slowest[1]}); {self.cpu:.0f} s of CPU"
        ]
        places: dict[str, list[int]] = {}
        for finding in sorted(self.findings, key=lambda f: f.number):
            places.setdefault(finding.place, []).append(finding.number)
        for place, numbers in sorted(places.items(), key=lambda item: -len(item[1])):
            lines.append(f"  {len(numbers)} x {place}; cases {', '.join(map(str, numbers[:5]))}")
        return "\n".join(lines)


def run_cases(
    task: str, context: dict[str, Any], numbers: Iterable[int], *, workers: int | None = None, late: float = LATE, memory: int = MEMORY
) -> Summary:
    """Run the cases with these numbers, in any order; ``workers`` processes, by default as many as the machine has processors."""
    waiting: queue.SimpleQueue[int] = queue.SimpleQueue()
    for number in numbers:
        waiting.put(number)
    summary, lock = Summary(), threading.Lock()
    count = min(workers or os.cpu_count() or 1, max(1, waiting.qsize()))
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    failures: list[BaseException] = []

    def serve() -> None:
        try:
            while not failures and not waiting.empty():
                with tempfile.TemporaryFile() as log:
                    _serve(_started(task, context, memory, late, log), log, waiting, summary, lock, late)
        except BaseException as error:
            failures.append(error)

    threads = [threading.Thread(target=serve) for _ in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    if failures:
        raise failures[0]
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    summary.cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return summary


def _started(task: str, context: dict[str, Any], memory: int, late: float, log: IO[bytes]) -> subprocess.Popen[bytes]:
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "RAYON_NUM_THREADS": "1", "MPLBACKEND": "agg"}
    line = [sys.executable, __file__, task, json.dumps(context), str(memory), str(late)]
    # A session of its own: what a case starts goes with it.
    return subprocess.Popen(line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=log, env=environment, start_new_session=True)


def _serve(
    process: subprocess.Popen[bytes],
    log: IO[bytes],
    waiting: queue.SimpleQueue[int],
    summary: Summary,
    lock: threading.Lock,
    late: float,
) -> None:
    """Feed one worker until there is nothing left to do, or until it is lost."""
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        if _answer(process, START) is None:
            process.kill()
            raise RuntimeError(f"a worker did not start: {_tail(log)}")
        while True:
            try:
                number = waiting.get_nowait()
            except queue.Empty:
                return
            began = time.monotonic()
            process.stdin.write(b"%d\n" % number)
            process.stdin.flush()
            answer = _answer(process, late)
            took = time.monotonic() - began
            if answer is None:
                hung = process.poll() is None and took >= late
                process.kill()
                code = process.wait()
                answer = {"outcome": "hang" if hung else "crash", "text": f"exit code {code}\n{_tail(log)}"}
            with lock:
                word = answer["outcome"]
                summary.outcomes[word] += 1
                summary.slowest = max(summary.slowest, (took, number))
                if "text" in answer:
                    summary.findings.append(Finding(number, word, answer["text"]))
            if process.poll() is not None:
                return
    finally:
        process.stdin.close()
        try:
            process.wait(5)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        process.stdout.close()


def _answer(process: subprocess.Popen[bytes], limit: float) -> Any:
    """The next line of a worker as JSON; None if it does not come in time, or never will."""
    assert process.stdout is not None
    pieces, end = b"", time.monotonic() + limit
    while not pieces.endswith(b"\n"):
        if not select.select([process.stdout], [], [], max(0.0, end - time.monotonic()))[0]:
            return None
        piece = os.read(process.stdout.fileno(), 65536)
        if not piece:
            process.wait(10)
            return None
        pieces += piece
    return json.loads(pieces)


def _tail(log: IO[bytes]) -> str:
    """The last words of a worker: stacks of a hang or a crash."""
    log.seek(0, os.SEEK_END)
    log.seek(max(0, log.tell() - 4000))
    text = log.read().decode(errors="replace")
    # The most recent call comes first in these stacks, and last in those of exceptions.
    stack = [line for line in text.splitlines() if line.strip().startswith(("File", "Fatal", "thread", "memory", "terminate", "corrupt"))]
    return "\n".join(reversed(stack)) or text


def _work(task: str, context: dict[str, Any], memory: int, late: float) -> None:
    """The worker: numbers in on standard input, a line of JSON out for each."""
    answers = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # what a reader prints is no answer
    faulthandler.enable()
    warnings.simplefilter("ignore")
    module, _, name = task.partition(":")
    sys.path.insert(0, str(Path(__file__).parent))
    function = getattr(importlib.import_module(module), name)
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    print(json.dumps({"ready": True}), file=answers)
    for line in sys.stdin:
        faulthandler.dump_traceback_later(0.9 * late)
        try:
            answer = {"outcome": function(context, int(line))}
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # SystemExit and panics of Rust too
            answer = {"outcome": "untyped", "text": "".join(traceback.format_exception(error))[-4000:]}
        faulthandler.cancel_dump_traceback_later()
        print(json.dumps(answer), file=answers)


if __name__ == "__main__":
    _work(sys.argv[1], json.loads(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4]))
