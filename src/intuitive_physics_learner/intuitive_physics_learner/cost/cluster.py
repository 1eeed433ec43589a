"""Evaluating J in many processes or on many machines, through dask.distributed.

Dask and not joblib, because J is evaluated thousands of times over the same observations: Dask
holds them, packed once, in the memory of its workers and sends candidates only, while joblib's
pools forget everything between two calls. And one engine serves both: processes of this machine
and the workers of a scheduler elsewhere.

A trial's outcome depends on the trial only, so any worker can simulate it: the
result is the same to the bit as without a cluster, as long as the machines are alike.

Whoever can reach a Dask scheduler or a worker can run code there, and what they send back is run
here: across a network they should speak TLS, with certificates of one's own. What is started here
listens on the loopback interface only.
"""

from __future__ import annotations

import logging
import re
import signal
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.observation import Observation
from intuitive_physics.simulation import Simulator
from intuitive_physics.trajectory import MEAN_DISTANCE
from intuitive_physics_learner.cost.cost_function import Cost, TrajectoryCost
from intuitive_physics_learner.cost.trials import Trials
from intuitive_physics_learner.errors import ClusterError, MissingDependencyError

SMALLEST_SHARE = 50
"""Trials that are worth the milliseconds of a message to a worker and back."""

CONNECT_TIMEOUT = 10.0
"""s until a scheduler, or the processes of this machine, must have answered."""

WHERE_GUIDE = (
    "empty: in this process; local:N: in N processes of this machine; ADDRESS:PORT: by the "
    "workers of that Dask scheduler, such as tls://192.168.1.2:8786"
)
"""Forms of the place where J is evaluated, for users."""

CERTIFICATE_FILES = ("ca.pem", "certificate.pem", "key.pem")
"""In a folder of certificates: of the authority that all trust, of this process, and its key."""

CERTIFICATES_GUIDE = (
    f"folder with {', '.join(CERTIFICATE_FILES)} for TLS with a cluster; empty: what Dask's own "
    "configuration says"
)
"""Forms of certificates, for users."""

LOOPBACK = "127.0.0.1"
"""Address on which processes of this machine listen."""


class CostMaker:
    """Makes the J of observations, evaluated here or on a cluster; ends the processes it started.

    Parameters
    ----------
    where : empty for this process, `local:N` for N processes of this machine, or the address of a
        Dask scheduler, such as `tls://192.168.1.2:8786`
    certificates : folder with `CERTIFICATE_FILES`, with which processes of this machine, too,
        speak TLS; empty for what Dask's own configuration says

    Raises
    ------
    InvalidInputError
        When `where` is none of those, or a certificate is missing or would not be used.
    MissingDependencyError
        When it needs the package distributed, which is not installed.
    """

    def __init__(self, where: str = "", certificates: str = "") -> None:
        local = re.fullmatch(r"local:([1-9]\d{0,3})", where)
        elsewhere = re.fullmatch(r"([a-z]+://)?(?!local:)[^\s:]+:\d+", where)
        if where and not local and not elsewhere:
            raise InvalidInputError(f"cluster is {where!r}; expected one of: {WHERE_GUIDE}")
        if where:
            _distributed()
        if certificates and elsewhere and not where.startswith("tls://"):
            raise InvalidInputError(
                f"cluster is {where!r} and certificates are given; expected an address that begins "
                "with tls://, else they are not used"
            )
        self._where = where
        self._tls_files = _certificate_files(certificates) if certificates else {}
        self._processes = int(local[1]) if local else 0
        self._client: Any = None

    @property
    def warning(self) -> str:
        """Warning about the way to the cluster, for users; empty where there is none."""
        if not self._where or self._processes or self._where.startswith("tls://"):
            return ""
        host = self._where.rpartition("://")[2].rpartition(":")[0].strip("[]")
        if host == "localhost" or host.startswith("127.") or host == "::1":
            return ""
        return (
            f"the cluster at {self._where} is reached without encryption: whoever can reach it or "
            "listens on the way can read observations and run programs on all its machines; use "
            "tls://… and certificates outside a network of your own"
        )

    def __enter__(self) -> CostMaker:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __call__(
        self,
        observations: Sequence[Observation],
        simulator: Simulator,
        materials: Sequence[str] | None = None,
        distance: str = MEAN_DISTANCE,
    ) -> Cost:
        """Return J of observations, as `TrajectoryCost` takes them.

        The simulator should use one thread: the cluster knows how many a worker has. Raises
        `ClusterError` when the scheduler does not answer or has no workers.
        """
        if not self._where:
            return TrajectoryCost(observations, simulator, materials, distance)
        if self._client is not None and self._client.status != "running":
            # Dask gives a scheduler up that is away for longer than a connection may take.
            self.close()
        if self._client is None:
            self._client = self._connect()
        return ClusterCost(self._client, observations, simulator, materials, distance)

    def close(self) -> None:
        """End the processes that were started here, disconnect from a cluster that was not."""
        client, self._client = self._client, None
        if client is not None:
            client.close()
            if self._processes:
                client.cluster.close()

    def _connect(self) -> Any:
        distributed = _distributed()
        logging.getLogger("distributed").setLevel(logging.ERROR)
        _log_in_lines()
        security = None
        if self._tls_files:
            security = distributed.Security(require_encryption=True, **self._tls_files)
        if self._processes:
            return self._start_processes(security)
        try:
            client = distributed.Client(self._where, timeout=CONNECT_TIMEOUT, security=security)
            client.wait_for_workers(1, timeout=CONNECT_TIMEOUT)
        except (OSError, TimeoutError, ValueError) as error:
            raise ClusterError(
                f"cluster {self._where} does not answer ({error}); expected a Dask scheduler with "
                "at least one worker: start them with `dask scheduler` and `dask worker ADDRESS`"
            ) from None
        return client

    def _start_processes(self, security: Any) -> Any:
        distributed = _distributed()
        cluster = None
        try:
            cluster = distributed.LocalCluster(
                n_workers=self._processes,
                threads_per_worker=1,
                host=LOOPBACK,
                dashboard_address=f"{LOOPBACK}:0",
                worker_dashboard_address=f"{LOOPBACK}:0",
                protocol="tls://" if security else "tcp://",
                security=security,
                silence_logs="ERROR",
                preload=__name__,
            )
            return distributed.Client(cluster, timeout=CONNECT_TIMEOUT)
        except (OSError, TimeoutError, ValueError, RuntimeError) as error:
            if cluster is not None:
                cluster.close()
            raise ClusterError(
                f"cluster {self._where} did not start ({error}); {self._processes} processes of "
                "this machine were expected: look whether its memory is full, and learn again"
            ) from None


class ClusterCost(Cost):
    """J evaluated by the workers of a Dask cluster, each of which holds all observations.

    They are the result of a task, which Dask repeats where the workers that held it have died.

    Parameters
    ----------
    client : `distributed.Client` of the cluster
    observations, simulator, materials, distance : as `TrajectoryCost` takes them
    """

    def __init__(
        self,
        client: Any,
        observations: Sequence[Observation],
        simulator: Simulator,
        materials: Sequence[str] | None,
        distance: str,
    ) -> None:
        super().__init__(observations, materials)
        self._client = client
        self._stop_flag = simulator.stop_flag
        self._threads = max(1, sum(self._guarded(client.nthreads).values()))
        local = TrajectoryCost(self.observations, simulator, self.materials, distance)
        self._there = self._guarded(lambda: self._sent(local))

    def trial_distances(self, trials: Trials) -> NDArray[np.float64]:
        return self._spread(TrajectoryCost.trial_distances, trials)

    def trial_residuals(self, trials: Trials) -> NDArray[np.float64]:
        return self._spread(TrajectoryCost.trial_residuals, trials)

    def _spread(
        self, method: Callable[[TrajectoryCost, Trials], NDArray[np.float64]], trials: Trials
    ) -> NDArray[np.float64]:
        # The simulators of workers are copies, which do not see that it was set.
        self._stop_flag.check()
        count = max(1, min(self._threads, trials.size // SMALLEST_SHARE))
        shares = [trials.taken(part) for part in np.array_split(np.arange(trials.size), count)]

        def answers() -> list[NDArray[np.float64]]:
            futures = [
                self._client.submit(method, self._there, share, pure=False) for share in shares
            ]
            gathered: list[NDArray[np.float64]] = self._client.gather(futures)
            return gathered

        return np.concatenate(self._guarded(answers))

    def _sent(self, cost: TrajectoryCost) -> Any:
        """The observations on all workers."""
        self._client.wait_for_workers(1, timeout=CONNECT_TIMEOUT)
        there = self._client.submit(_same, cost, pure=False)
        # Raised by the scheduler where a worker dies that it was about to copy them to.
        with suppress(KeyError):
            self._client.replicate(there)
        return there

    def _guarded(self, call: Callable[[], Any]) -> Any:
        distributed = _distributed()
        try:
            return call()
        except ImportError as error:
            raise ClusterError(
                f"a worker of the cluster lacks a package ({error}); install "
                "intuitive_physics_learner in the same version on all its machines"
            ) from None
        except (
            distributed.KilledWorker,
            CancelledError,
            distributed.comm.CommClosedError,
            OSError,
            TimeoutError,
        ) as error:
            raise ClusterError(
                f"the cluster failed ({type(error).__name__}: {error}); start its scheduler and "
                "workers again and learn again: the search continues from its last checkpoint"
            ) from None


def _same(cost: TrajectoryCost) -> TrajectoryCost:
    return cost


def _certificate_files(folder: str) -> dict[str, str]:
    """Return the files of a folder of certificates by the names of Dask's options."""
    authority, certificate, key = (Path(folder).expanduser() / name for name in CERTIFICATE_FILES)
    for file in (authority, certificate, key):
        if not file.is_file():
            raise InvalidInputError(
                f"there is no {file}; expected a folder with {', '.join(CERTIFICATE_FILES)}"
            )
    return {
        "tls_ca_file": str(authority),
        **{f"tls_{role}_cert": str(certificate) for role in ("client", "scheduler", "worker")},
        **{f"tls_{role}_key": str(key) for role in ("client", "scheduler", "worker")},
    }


def dask_setup(_worker: Any) -> None:
    """Prepare the process of a worker: Dask calls this by its name, after a restart as well.

    Ctrl-C, which reaches all processes of a terminal, is ignored: the parent ends this one.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _log_in_lines()


def _in_one_line(record: logging.LogRecord) -> bool:
    """Have a log record say its exception in the one line of its message, without a traceback."""
    words = record.getMessage().split()
    if record.exc_info and (error := record.exc_info[1]) is not None:
        words += f"({type(error).__name__}: {error})".split()
    record.msg, record.args = " ".join(words), ()
    record.exc_info = record.exc_text = None
    return True


def _log_in_lines() -> None:
    """Make Dask and its libraries log single lines; a lost connection is a traceback otherwise.

    What a failure means for the search is said by `ClusterError`.
    """
    for name in ("distributed", "tornado", "tornado.application"):
        for handler in logging.getLogger(name).handlers:
            handler.addFilter(_in_one_line)
    logging.getLogger("asyncio").addFilter(_in_one_line)


def _distributed() -> Any:
    try:
        import distributed
    except ImportError:
        raise MissingDependencyError(
            "evaluating J on a cluster needs the package distributed, which is not installed; "
            "install it with: pip install distributed"
        ) from None
    return distributed
