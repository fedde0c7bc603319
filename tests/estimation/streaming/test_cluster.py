"""A fleet's logs on a Dask cluster of processes, one of which is lost."""

from __future__ import annotations

import os
import signal
import threading
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from elid_cli.estimation.streaming.fleet import Job, reduce_jobs
from elid_cli.estimation.streaming.merge import identify_reduced
from elid_cli.robot.files import read_robot
from elid_cli.robot.text import text_of
from elid_cli.signals.options import SignalOptions

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
