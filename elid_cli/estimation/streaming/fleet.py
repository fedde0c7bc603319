"""Many logs reduced at once: in this process, in several, or on a Dask cluster.

A log is a job of plain values; what comes back is the bytes of a triangle file, so that nothing of elid's own crosses
between processes. A job whose worker is lost is done again here.
"""

from __future__ import annotations

import contextlib
import io
import time
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from elid_cli import errors
from elid_cli.errors import ElidError, UsageError, check_kind
from elid_cli.estimation.request import LogRequest
from elid_cli.estimation.smooth_commands import as_told
from elid_cli.estimation.streaming.interrupts import interrupts_held
from elid_cli.estimation.streaming.reduce import asked_of, reduce_log
from elid_cli.estimation.streaming.reduced_log import ReducedLog, without_positions
from elid_cli.logs import read_recording
from elid_cli.robot.robot import Robot
from elid_cli.signals.options import SignalOptions
from elid_cli.signals.signals import prepare

Progress: TypeAlias = Callable[[float], None]
Answer: TypeAlias = bytes | tuple[str, str, str, str]
"""A triangle file, or an error: class, message, detail, hint."""

STANDARD_INPUT = "-"
READING = 0.6
"""Share of the work on a log that is reading it, for progress."""
CONNECT = 10.0
"""s to wait for a scheduler."""
PATIENCE, POLL = 60.0, 1.0
"""s without any worker after which a cluster is given up, and s between looks at it."""
SCHEMES = ("tcp", "tls", "ws", "wss")
"""Of a scheduler's address; tcp where it names none."""
ENCRYPTED = ("tls", "wss")
CERTIFICATES = "set " + ", ".join(
    f"DASK_DISTRIBUTED__COMM__TLS__{name}" for name in ("CA_FILE", "CLIENT__CERT", "CLIENT__KEY")
)


@dataclass(frozen=True)
class Job:
    """A log to reduce, as plain values that any process understands."""

    log: str
    """As the user typed it."""
    robot: str
    """Text of the robot file."""
    name: str
    """Name of the robot."""
    mapping: Mapping[str, Any] | None = None
    strict: bool = False
    time_source: str = "auto"
    conditioning: Mapping[str, Any] = field(default_factory=dict)
    """Options of `SignalOptions` that the user may give, None: chosen from the log."""
    path: str = ""
    """Where the log is, where the worker runs in another folder."""


def reduce_job(job: Job, progress: Progress | None = None) -> ReducedLog:
    """Read and reduce one log in this process."""
    robot = _machine(job.robot, job.name)
    recording = read_recording(
        [job.path or job.log],
        robot,
        job.mapping,
        strict=job.strict,
        rate=job.conditioning.get("rate"),
        time_source=job.time_source,
        progress=None if progress is None else lambda share: progress(READING * share),
    )
    signals = as_told(robot, prepare(recording, robot, SignalOptions(**job.conditioning).of_log(recording.rate)))
    recording = without_positions(signals.recording or recording)
    signals = replace(signals, recording=recording)
    told = None if progress is None else lambda share: progress(READING + (1 - READING) * share)
    reduced = reduce_log(robot, signals, recording, job.conditioning, told)
    if job.path and job.path != job.log:
        reduced = replace(reduced, recording=replace(reduced.recording, files=(job.log,)))
    return reduced


def reduce_jobs(
    jobs: Sequence[Job], workers: int = 1, scheduler: str | None = None, progress: Progress | None = None
) -> list[ReducedLog]:
    """Reduce logs, in their order.

    Parameters
    ----------
    jobs
        One per log.
    workers
        Processes on this machine.
    scheduler
        Address of a Dask scheduler, used instead.
    progress
        Told the share of all logs that is done.

    Raises
    ------
    ElidError
        Of the first log that cannot be used.
    UsageError
        The scheduler does not answer, or Dask is not installed.
    """
    here = [job for job in jobs if job.log == STANDARD_INPUT]
    away = [job for job in jobs if job.log != STANDARD_INPUT]
    if scheduler is not None and away:
        answers = _on_cluster(away, scheduler)
    elif workers > 1 and len(away) > 1:
        answers = _on_processes(away, min(workers, len(away)))
    else:
        here, answers = list(jobs), _collected([])
    done: dict[int, ReducedLog] = {}

    def tell(share: float) -> None:
        if progress is not None:
            progress((len(done) + share) / len(jobs))

    with contextlib.closing(answers):  # workers are let go also where a log is refused
        for job, answer in zip(away, answers, strict=False):
            done[id(job)] = reduce_job(job) if answer is None else _understood(answer)
            tell(0.0)
    for job in here:
        done[id(job)] = reduce_job(job, tell)
    return [done[id(job)] for job in jobs]


def reduced_logs(request: LogRequest) -> list[ReducedLog]:
    """Return the logs of a request reduced, those of triangle files as they are.

    Raises
    ------
    LogError
        A log that cannot be used.
    UsageError
        A triangle file that was made with other options than those of the request, or parts to leave out of several
        logs.
    """
    from elid_cli.estimation.streaming.files import read_triangles
    from elid_cli.estimation.streaming.stored import is_triangle_file
    from elid_cli.logs.mapping.left_out import left_out_of
    from elid_cli.robot.text import text_of

    check_kind("request", request, LogRequest, "LogRequest([LOG], robot)")
    spans = left_out_of(request.mapping, len(request.logs))
    wish, text = asked_of(request.signals), text_of(request.robot)
    stored = {log: read_triangles(log) for log in request.logs if is_triangle_file(log)}
    if stored and spans:
        name = next(iter(stored))
        raise UsageError(
            f"{name}: nothing can be left out of a reduced log", hint="elid reduce the log with --leave-out"
        )
    jobs = [
        Job(log, text, request.robot.name, request.mapping, request.strict, request.time, wish)
        for log in request.logs
        if log not in stored
    ]
    progress = request.progress
    tell = None if progress is None else lambda share: progress("reducing", share)
    made = iter(reduce_jobs(jobs, request.jobs, request.scheduler, tell))
    found: list[ReducedLog] = []
    for log in request.logs:
        found += stored[log] if log in stored else [next(made)]
    for log_ in found:
        _check_options(log_, wish)
    if request.on_read is not None:
        read = [log.recording for log in found if not all(file in stored for file in log.recording.files)]
        request.on_read(read, [log.recording for log in found])
    return found


def _check_options(log: ReducedLog, wish: Mapping[str, object]) -> None:
    """Refuse what is asked now and stored triangles were not made with (UsageError)."""
    usual = asked_of(SignalOptions())
    for key, value in wish.items():
        made = log.options.get(key) or ("held" if key == "commands" else None)
        if value not in (usual[key], made):
            raise UsageError(
                f"{log.name}: reduced with {'other' if key.endswith('s') else 'another'} {key.replace('_', '-')}",
                detail=f"{'chosen from the log' if made is None else made} when it was reduced, {value} now",
                hint="reduce the log again, or leave the option out",
            )


def answer_job(job: Job) -> Answer:
    """Reduce one log in a worker: bytes of a triangle file, or the error in plain words."""
    from elid_cli.estimation.streaming.files import packed
    from elid_cli.memory import keep_freed_memory

    keep_freed_memory()
    try:
        reduced = reduce_job(job)
    except ElidError as error:
        return (type(error).__name__, error.message, error.detail, error.hint)
    stream = io.BytesIO()
    np.savez(stream, **packed([reduced]))
    return stream.getvalue()


def _understood(answer: Answer) -> ReducedLog:
    from elid_cli.estimation.streaming.files import read_stream

    if isinstance(answer, bytes):
        return read_stream(io.BytesIO(answer), "worker")[0]
    kind, message, detail, hint = answer
    raise getattr(errors, kind, ElidError)(message, detail=detail, hint=hint)


def _collected(futures: Sequence[Future[Answer]]) -> Generator[Answer | None, None, None]:
    """Yield the workers' answers in order, None for a job that was lost with its worker."""
    for future in futures:
        try:
            yield future.result()
        except Exception:  # whatever a worker died of, the log is reduced again where the fault can be told
            yield None


def _on_processes(jobs: Sequence[Job], workers: int) -> Generator[Answer | None, None, None]:
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor

    # a fresh interpreter each: a fork would copy threads and locks in whatever state they are
    before = set(multiprocessing.active_children())
    pool: Executor = ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"))
    finished = False
    try:
        with interrupts_held():  # workers inherit that: Ctrl-C, which reaches all processes, is for this one to answer
            futures = _submitted(pool, jobs)
        yield from _collected(futures)
        finished = True
    finally:
        for worker in () if finished else set(multiprocessing.active_children()) - before:
            worker.terminate()
        pool.shutdown(wait=True, cancel_futures=True)


def _submitted(pool: Executor, jobs: Sequence[Job]) -> list[Future[Answer]]:
    futures: list[Future[Answer]] = []
    for job in jobs:
        try:
            futures.append(pool.submit(answer_job, job))
        except RuntimeError as broken:  # the pool has lost a worker already
            lost: Future[Answer] = Future()
            lost.set_exception(broken)
            futures.append(lost)
    return futures


def _on_cluster(jobs: Sequence[Job], scheduler: str) -> Generator[Answer | None, None, None]:
    import logging

    scheme = scheduler.partition("://")[0] if "://" in scheduler else "tcp"
    if scheme not in SCHEMES:  # distributed would say so too, and print a traceback when the program ends
        known = ", ".join(f"{one}://" for one in SCHEMES)
        raise UsageError(f"--scheduler: no Dask scheduler at {scheduler}", hint=f"addresses begin with {known}")
    try:
        from distributed import Client
    except ImportError:
        raise UsageError(
            "--scheduler needs dask.distributed, which is not installed", hint="pip install 'elid[dask]'"
        ) from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    if scheme in ENCRYPTED:
        _check_certificates(scheduler)
    try:
        client: Any = Client(scheduler, timeout=CONNECT, set_as_default=False)  # type: ignore[no-untyped-call,unused-ignore]
    except (OSError, TimeoutError, ValueError) as error:
        raise UsageError(
            f"--scheduler: no Dask scheduler at {scheduler}",
            detail=str(error).split("\n")[0][:160],
            hint="start one with: dask scheduler",
        ) from error
    try:
        placed = [_placed(job) for job in jobs]
        yield from _awaited(client, client.map(answer_job, placed, pure=False), scheduler)
    finally:
        client.close(timeout=CONNECT)


def _check_certificates(scheduler: str) -> None:
    """Refuse an encrypted connection without certificates, or with such as cannot be read (UsageError)."""
    from distributed.security import Security

    try:
        context = Security().get_connection_args("client").get("ssl_context")  # type: ignore[no-untyped-call,unused-ignore]
    except OSError as error:
        raise UsageError(
            f"--scheduler: the certificates for {scheduler} cannot be used", detail=str(error)[:160], hint=CERTIFICATES
        ) from error
    if context is None:
        raise UsageError(f"--scheduler: {scheduler} needs certificates, and none are given", hint=CERTIFICATES)


def _awaited(client: Any, futures: Sequence[Any], scheduler: str) -> Generator[Answer | None, None, None]:
    """Yield the workers' answers in order, None for a job that was lost with its worker.

    Raises
    ------
    UsageError
        For `PATIENCE` s the scheduler has had no worker, as when the last one has died.
    """
    alive = time.monotonic()
    for number, future in enumerate(futures):
        while True:
            try:
                yield future.result(timeout=POLL)
            except TimeoutError:
                if client.scheduler_info()["workers"]:
                    alive = time.monotonic()
                elif time.monotonic() - alive > PATIENCE:
                    raise UsageError(
                        f"--scheduler: {scheduler} has had no worker for {PATIENCE:g} s",
                        detail=f"{number} of {len(futures)} logs were reduced",
                        hint=f"dask worker {scheduler}, or reduce them here: --jobs 2",
                    ) from None
                continue
            except Exception:  # whatever a worker died of, the log is reduced again where the fault can be told
                yield None
            alive = time.monotonic()
            break


def _placed(job: Job) -> Job:
    """Return the job with the log's full path, since a worker may run in another folder."""
    return replace(job, path=str(Path(job.log).absolute()))


@lru_cache(maxsize=2)
def _machine(text: str, name: str) -> Robot:
    from elid_cli.robot.files import robot_from_text

    return robot_from_text(text, name)
