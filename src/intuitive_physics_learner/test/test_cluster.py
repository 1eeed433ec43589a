"""J evaluated by other processes: the same to the bit, and clear errors when they fail."""

import logging
import os
import shutil
import signal
import subprocess
import sys
import time

import distributed
import numpy as np
import psutil
import pytest

from intuitive_physics.errors import InvalidInputError, SimulationStoppedError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.simulation import make_simulator
from intuitive_physics.simulation.stop_flag import StopFlag
from intuitive_physics.trajectory import DISTANCES
from intuitive_physics_learner import (
    ConvergenceCriteria,
    LearningOptions,
    MissingDependencyError,
    TrajectoryCost,
    Trials,
    learn,
)
from intuitive_physics_learner.cost.cluster import CostMaker
from intuitive_physics_learner.errors import ClusterError


@pytest.fixture(scope="module")
def two_processes():
    with CostMaker("local:2") as made:
        yield made


def candidates(materials, count):
    generator = np.random.default_rng(0)
    return [
        StaticParameters.uniform(materials, restitution=e, static_friction=0.9, dynamic_friction=f)
        for e, f in generator.uniform(0.0, 0.9, (count, 2))
    ]


@pytest.mark.parametrize("distance", DISTANCES)
def test_cost_is_the_same_to_the_bit(two_processes, throws, distance):
    # Objects' counts and times differ, so observations are packed in several groups.
    observed = throws(9, 0, noise=0.003) + throws(4, 1, times=17)
    simulator = make_simulator("auto")
    here = TrajectoryCost(observed, simulator, distance=distance)
    there = two_processes(observed, simulator, distance=distance)
    some = candidates(here.materials, 40)
    assert (there.costs(some) == here.costs(some)).all()
    assert (there.distances(some) == here.distances(some)).all()
    trials = Trials.crossed(some[:3], len(observed))
    np.testing.assert_array_equal(there.trial_residuals(trials), here.trial_residuals(trials))


def test_work_is_spread_over_both(two_processes, throws):
    simulator = make_simulator("event_driven")
    cost = two_processes(throws(10, 0), simulator)
    cost.costs(candidates(cost.materials, 40))
    client = two_processes._client
    assert len(client.nthreads()) == 2
    done = client.run(lambda dask_worker: len(dask_worker.state.log))
    assert all(count > 0 for count in done.values())


def test_learning_is_the_same_with_and_without(two_processes, throws):
    observed = throws(6, 0, noise=0.003)
    simulator = make_simulator("event_driven")
    options = LearningOptions(criteria=ConvergenceCriteria(400), seed=2)
    here = learn(observed, simulator, options)
    there = learn(observed, simulator, options, make_cost=two_processes)
    assert there.learned.to_dict() == here.learned.to_dict()
    assert (there.search.history == here.search.history).all()


def test_ends_once_the_flag_of_its_simulator_is_set(two_processes, throws):
    flag = StopFlag()
    cost = two_processes(throws(2, 0), make_simulator("event_driven").stopped_by(flag))
    cost.costs(candidates(cost.materials, 2))
    flag.set()
    with pytest.raises(SimulationStoppedError):
        cost.costs(candidates(cost.materials, 2))


def listening_addresses():
    """TCP ports on which this process and its children listen."""
    this_process = psutil.Process()
    return {
        connection.laddr.ip
        for process in [this_process, *this_process.children(recursive=True)]
        for connection in process.net_connections("tcp")
        if connection.status == psutil.CONN_LISTEN
    }


def test_processes_of_this_machine_listen_on_the_loopback_only(two_processes, throws):
    two_processes(throws(1, 0), make_simulator("event_driven"))
    assert two_processes._client.cluster.dashboard_link.startswith("http://127.0.0.1:")
    assert listening_addresses() == {"127.0.0.1"}


@pytest.fixture(scope="module")
def certificates(tmp_path_factory):
    """A folder of certificates as the documentation makes them."""
    folder = tmp_path_factory.mktemp("certificates")
    new = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-sha256"]
    files = ["-subj", "/CN=robot", "-keyout", "key.pem", "-out", "certificate.pem"]
    subprocess.run([*new, *files], cwd=folder, check=True, capture_output=True)
    shutil.copy(folder / "certificate.pem", folder / "ca.pem")
    os.chmod(folder / "key.pem", 0o600)
    return folder


@pytest.mark.needs("openssl")
def test_a_cluster_can_speak_tls_and_nothing_else(certificates, throws, monkeypatch):
    observed, simulator = throws(3, 0), make_simulator("event_driven")
    with CostMaker("local:1", str(certificates)) as encrypted:
        cost = encrypted(observed, simulator)
        some = candidates(cost.materials, 5)
        assert (cost.costs(some) == TrajectoryCost(observed, simulator).costs(some)).all()
        address = encrypted._client.cluster.scheduler_address
        assert address.startswith("tls://")
        with CostMaker(address, str(certificates)) as other:
            assert (other(observed, simulator).costs(some) == cost.costs(some)).all()
            assert other.warning == ""
        monkeypatch.setattr("intuitive_physics_learner.cost.cluster.CONNECT_TIMEOUT", 2.0)
        with (
            CostMaker(address.replace("tls", "tcp")) as plain,
            pytest.raises(ClusterError, match="does not answer"),
        ):
            plain(observed, simulator)


@pytest.mark.needs("openssl")
def test_certificates_that_are_missing_or_would_not_be_used(certificates, tmp_path):
    with pytest.raises(InvalidInputError, match=r"no .*ca\.pem; expected a folder with ca\.pem"):
        CostMaker("local:1", str(tmp_path))
    for address in ("tcp://host:8786", "host:8786"):
        with pytest.raises(InvalidInputError, match="expected an address that begins with tls://"):
            CostMaker(address, str(certificates))


@pytest.mark.parametrize(
    ("where", "warned"),
    [
        ("", False),
        ("local:2", False),
        ("127.0.0.1:8786", False),
        ("tcp://localhost:8786", False),
        ("tls://192.168.1.2:8786", False),
        ("192.168.1.2:8786", True),
        ("tcp://robot.example:8786", True),
    ],
)
def test_plain_tcp_beyond_this_machine_is_warned_of(where, warned):
    assert ("without encryption" in CostMaker(where).warning) == warned


def last_holders(client, future):
    """Addresses of the workers that hold a result once Dask has dropped the surplus copies."""
    until = time.monotonic() + 20.0
    while time.monotonic() < until:
        client.amm.run_once()
        (holders,) = client.who_has([future]).values()
        if len(holders) == 1:
            break
        time.sleep(0.05)
    return holders


def test_scheduler_that_runs_elsewhere(throws):
    observed = throws(6, 0)
    simulator = make_simulator("event_driven")
    cluster = distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs="ERROR"
    )
    with cluster, CostMaker(cluster.scheduler_address) as elsewhere:
        cost = elsewhere(observed, simulator)
        some = candidates(cost.materials, 30)
        expected = TrajectoryCost(observed, simulator).costs(some)
        assert (cost.costs(some) == expected).all()
        # One that dies is no loss, even the only one that still holds the observations: after two
        # seconds Dask leaves one copy of what several workers hold.
        holders = last_holders(elsewhere._client, cost._there)
        assert len(holders) == 1
        workers = {worker.worker_address: worker for worker in cluster.workers.values()}
        cluster.sync(workers[holders[0]].kill)
        assert (cost.costs(some) == expected).all()
        elsewhere.close()
        # It was not ours to end.
        assert cluster.status.name == "running"


def test_scheduler_that_goes_away(throws, monkeypatch):
    monkeypatch.setattr("intuitive_physics_learner.cost.cluster.CONNECT_TIMEOUT", 2.0)
    cluster = distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address=":0", silence_logs="CRITICAL"
    )
    with CostMaker(cluster.scheduler_address) as elsewhere:
        cost = elsewhere(throws(2, 0), make_simulator("event_driven"))
        cluster.close()
        with pytest.raises(ClusterError, match="the cluster failed"):
            cost.costs(candidates(cost.materials, 1))


@pytest.mark.parametrize("given_up", [False, True])
def test_scheduler_that_comes_back_at_its_address(throws, monkeypatch, given_up):
    monkeypatch.setattr("intuitive_physics_learner.cost.cluster.CONNECT_TIMEOUT", 2.0)
    observed, simulator = throws(2, 0), make_simulator("event_driven")
    options = {"n_workers": 1, "threads_per_worker": 1, "dashboard_address": ":0"}
    cluster = distributed.LocalCluster(**options, silence_logs="CRITICAL")
    port = int(cluster.scheduler_address.rpartition(":")[2])
    with CostMaker(cluster.scheduler_address) as elsewhere:
        cost = elsewhere(observed, simulator)
        some = candidates(cost.materials, 1)
        expected = cost.costs(some)
        cluster.close()
        until = time.monotonic() + 20.0
        while given_up and elsewhere._client.status != "closed":
            assert time.monotonic() < until
            time.sleep(0.05)
        with distributed.LocalCluster(
            **options, scheduler_port=port, silence_logs="CRITICAL"
        ) as again:
            assert again.scheduler_address.endswith(f":{port}")
            assert (elsewhere(observed, simulator).costs(some) == expected).all()


def log_an_error():
    try:
        raise OSError("the stream is\nclosed")
    except OSError:
        logging.getLogger("distributed.worker").exception("failed during get data with %s", "b")
    return signal.getsignal(signal.SIGINT)


def test_dead_cluster_worker_is_restarted(throws, capfd):
    simulator = make_simulator("event_driven")
    with CostMaker("local:1") as made:
        cost = made(throws(2, 0), simulator)
        some = candidates(cost.materials, 1)
        expected = cost.costs(some)
        client = made._client
        for _ in range(2):
            assert list(client.run(log_an_error).values()) == [signal.SIG_IGN]
            (pid,) = client.run(os.getpid).values()
            os.kill(pid, signal.SIGKILL)
            assert (cost.costs(some) == expected).all()
    log = capfd.readouterr().err
    line = "ERROR - failed during get data with b (OSError: the stream is closed)\n"
    assert log.count(line) == 2
    assert "Traceback" not in log


def test_processes_that_do_not_start(throws, monkeypatch):
    def fail(*_, **__):
        raise RuntimeError("Nanny failed to start worker process")

    monkeypatch.setattr(distributed, "LocalCluster", fail)
    with CostMaker("local:2") as made, pytest.raises(ClusterError, match=r"did not start .*Nanny"):
        made(throws(1, 0), make_simulator("event_driven"))


def test_dask_does_not_log_a_lost_connection_itself(throws):
    # At the level of information it would, with a traceback.
    log = logging.getLogger("distributed")
    cluster = distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address=":0", silence_logs=False
    )
    with cluster, CostMaker(cluster.scheduler_address) as elsewhere:
        log.setLevel(logging.INFO)
        elsewhere(throws(2, 0), make_simulator("event_driven"))
        assert not logging.getLogger("distributed.batched").isEnabledFor(logging.INFO)


def test_scheduler_that_is_not_there(throws, monkeypatch):
    monkeypatch.setattr("intuitive_physics_learner.cost.cluster.CONNECT_TIMEOUT", 0.3)
    with (
        CostMaker("tcp://127.0.0.1:9") as nowhere,
        pytest.raises(ClusterError, match="does not answer"),
    ):
        nowhere(throws(1, 0), make_simulator("event_driven"))


@pytest.mark.parametrize("where", ["local", "local:0", "local:two", "host", "a b:80", "local:2:3"])
def test_nonsense(where):
    with pytest.raises(InvalidInputError, match="expected one of: empty: in this process"):
        CostMaker(where)


def test_without_dask(monkeypatch, throws):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingDependencyError, match="pip install distributed"):
        CostMaker("local:2")
    cost = CostMaker("")(throws(1, 0), make_simulator("event_driven"))
    assert isinstance(cost, TrajectoryCost)
