"""A fleet's logs on a Dask cluster of processes, one of which is lost; certificates, and schedulers without workers."""

from __future__ import annotations

import os
import re
import signal
import socket
import threading
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from elid_cli.estimation.streaming import fleet
from elid_cli.estimation.streaming.fleet import Job, reduce_jobs
from elid_cli.estimation.streaming.merge import identify_reduced
from elid_cli.robot.files import read_robot
from elid_cli.robot.text import text_of
from elid_cli.signals.options import SignalOptions
from tests.system.hostile.hostile import Done, elid, one_message

distributed = pytest.importorskip("distributed")
pytestmark = pytest.mark.filterwarnings("ignore")

LOGS = Path(__file__).parents[3] / "sample_logs"


def test_a_cluster_gives_the_same_answer_though_a_worker_is_killed() -> None:
    robot = read_robot("planar2")
    names = ["planar2.h5", "planar2.csv", "planar2.mcap"] * 2
    jobs = [Job(str(LOGS / name), text_of(robot), robot.name, conditioning=asdict(SignalOptions())) for name in names]
    here, _ = identify_reduced(robot, reduce_jobs(jobs))
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        whole, _ = identify_reduced(robot, reduce_jobs(jobs, scheduler=cluster.scheduler_address))
        victim = next(iter(client.run(os.getpid).values()))
        timer = threading.Timer(0.1, os.kill, (victim, signal.SIGKILL))
        timer.start()
        reduced = reduce_jobs(jobs, scheduler=cluster.scheduler_address)
        timer.join()
    without, _ = identify_reduced(robot, reduced)
    for found in (whole, without):
        assert np.array_equal(found.estimate, here.estimate, equal_nan=True)
        assert np.array_equal(found.std_error, here.std_error, equal_nan=True)


def reduced(folder: Path, scheduler: str) -> Done:
    return elid("reduce", LOGS / "planar2.h5", "--robot", "planar2", "-o", folder / "x.npz", "--scheduler", scheduler)


def test_a_scheduler_without_workers_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fleet, "PATIENCE", 1.0)
    with distributed.LocalCluster(n_workers=0, dashboard_address=None, silence_logs=50) as cluster:
        done = reduced(tmp_path, cluster.scheduler_address)
    assert done.code == 2
    one_message(done, "has had no worker for 1 s", "0 of 1 logs were reduced", "dask worker tcp://")
    assert not list(tmp_path.iterdir())


def test_a_port_where_nobody_listens_is_one_message(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fleet, "CONNECT", 1.0)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        done = reduced(tmp_path, f"tcp://127.0.0.1:{free.getsockname()[1]}")
    assert done.code == 2
    one_message(done, "no Dask scheduler at", "dask scheduler")


def test_an_encrypted_connection_needs_certificates(tmp_path: Path) -> None:
    from dask import config

    done = reduced(tmp_path, "tls://127.0.0.1:1")
    assert done.code == 2
    one_message(done, "needs certificates", "TLS__CA_FILE")
    none = str(tmp_path / "none.pem")
    with config.set({f"distributed.comm.tls.{key}": none for key in ("ca-file", "client.cert", "client.key")}):
        done = reduced(tmp_path, "tls://127.0.0.1:1")
    assert done.code == 2
    one_message(done, "cannot be used", "TLS__CA_FILE")


def test_the_options_for_certificates_are_those_of_dask() -> None:
    from dask import config

    page = (LOGS.parent / "docs" / "how-to" / "cluster.md").read_text("utf-8")
    assert "must be trusted with" in page
    named = re.findall(r"DASK_(DISTRIBUTED__COMM__TLS__\w+)", page)
    assert len(named) == 3
    for name in named:
        assert f"DASK_{name}" in fleet.CERTIFICATES
        assert config.get(name.lower().replace("__", ".").replace("_", "-")) is None  # known, and not set
