"""Where environments are stepped: by workers of this machine, each at its own pace, or on a Ray cluster."""

from __future__ import annotations

import importlib.util
import os
import socket
import subprocess
import sys
from dataclasses import dataclass
from typing import Any

from rcare_marl.errors import ClusterError, ConfigError, MissingPackageError

ASYNC = "async://"
SCHEME = "ray://"
LOCAL = "local"
FORM = (
    "'async://N' for N processes that do not wait for each other, 'ray://HOST:PORT' of a cluster that "
    "runs, or 'ray://local:N' for N processes of this machine through Ray"
)
REACH_TIME = 10.0  # to reach the head of a cluster [s], our own choice
ANSWER_TIME = 45.0  # until it must have answered what it is [s]: most is Python and Ray starting
STORE_SIZE = 256 * 2**20  # of batches and weights that a local Ray holds [B]
# Prints how many cores are free.
ASK = """
import sys, ray
ray.init(address=sys.argv[1], log_to_driver=False, logging_level="error")
print(ray.available_resources().get("CPU", 0))
"""


def async_count(text: str, envs: int) -> int | None:
    """Return the number of workers in a text such as `async://4`; None if it is of another form.

    Raises:
        ConfigError: If there is none, or so many environments do not divide among them.
    """
    if not text.startswith(ASYNC):
        return None
    number = text.removeprefix(ASYNC)
    if not number.isdecimal() or int(number) < 1:
        raise ConfigError(f"workers is a number or {FORM}, got {text!r}")
    _check_share(envs, int(number))
    return int(number)


@dataclass(frozen=True)
class Cluster:
    """A Ray cluster, from text such as `ray://10.0.0.5:6379` or `ray://local:4`.

    The port is the one that `ray start --head` prints, 6379 if not chosen otherwise; not that of Ray
    Client (10001).

    Attributes:
        host: The head of the cluster; `local` for one that is started here and ends with the training.
        port: Its port; for a local one the number of workers.
    """

    host: str
    port: int

    @classmethod
    def parse(cls, text: str) -> Cluster:
        """Return the cluster that a text means.

        Raises:
            ConfigError: If the text is of another form.
        """
        host, colon, number = text.removeprefix(SCHEME).rpartition(":")
        is_good = text.startswith(SCHEME) and host and colon and number.isdecimal()
        if not is_good or not 1 <= int(number) <= 65535:
            raise ConfigError(f"workers is a number or {FORM}, got {text!r}")
        return cls(host, int(number))

    @property
    def is_local(self) -> bool:
        """Whether it is started here."""
        return self.host == LOCAL

    @property
    def address(self) -> str:
        """Host and port, as Ray wants them."""
        return f"{self.host}:{self.port}"

    def init_options(self) -> dict[str, Any]:
        """Return what `ray.init` is told."""
        if not self.is_local:
            return {"address": self.address, "log_to_driver": False, "logging_level": "error"}
        return {
            "address": "local",  # a new one, even where a cluster runs already
            "num_cpus": self.port,
            "num_gpus": 0,
            "include_dashboard": False,
            "object_store_memory": STORE_SIZE,
            "log_to_driver": False,
            "logging_level": "error",
            "_node_ip_address": "127.0.0.1",  # closed to other machines
        }

    def worker_count(self, envs: int) -> int:
        """Return over how many workers so many environments are spread evenly.

        Of a cluster that runs: at most one for each free core.

        Raises:
            MissingPackageError: If Ray is not installed.
            ConfigError: If the environments do not divide among the workers of a local cluster.
            ClusterError: If no cluster answers in time, or it has no free core.
        """
        if importlib.util.find_spec("ray") is None:
            raise MissingPackageError(f"workers {SCHEME}{self.address}", "dist")
        if not self.is_local:
            cores = self._free_cores()
            return max(count for count in range(1, min(cores, envs) + 1) if envs % count == 0)
        _check_share(envs, self.port)
        return self.port

    def _free_cores(self) -> int:
        """Return how many cores nobody has asked for, and make sure that a cluster is there.

        In another process, as `ray.init` waits for minutes for a cluster that does not answer.
        """
        try:
            socket.create_connection((self.host, self.port), timeout=REACH_TIME).close()
        except OSError as error:
            raise ClusterError(
                f"no Ray cluster can be reached at {self.address} ({error}): is it started, with "
                "'ray start --head --port=6379', and is the port open?"
            ) from error
        command = [sys.executable, "-c", ASK, self.address]
        try:
            # From a folder without files called ray.py.
            answer = subprocess.run(
                command, check=True, capture_output=True, text=True, timeout=ANSWER_TIME, cwd=os.sep
            )
        except subprocess.TimeoutExpired:
            raise ClusterError(
                f"what listens at {self.address} did not answer as a Ray cluster within "
                f"{ANSWER_TIME:.0f} s: the port is the one that 'ray start --head' prints, "
                "and 10001 (Ray Client) or 8265 (dashboard) are not it"
            ) from None
        except subprocess.CalledProcessError as error:
            lines = error.stderr.strip().splitlines() or ["no reason given"]
            raise ClusterError(
                f"Ray cannot use the cluster at {self.address}: {lines[-1]}"
            ) from error
        cores = int(float(answer.stdout.split()[-1]))
        if cores < 1:
            raise ClusterError(f"the Ray cluster at {self.address} has no free core")
        return cores


def _check_share(envs: int, workers: int) -> None:
    if envs % workers:
        raise ConfigError(
            f"{envs} environments do not divide among {workers} workers: "
            f"choose {_multiples(workers, envs)}"
        )


def _multiples(count: int, near: int) -> str:
    below = near // count * count
    return f"{below} or {below + count}" if below else str(count)
