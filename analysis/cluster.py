"""A Dask cluster for many tasks: on this computer, unless the user allows a remote one."""

from __future__ import annotations

import ipaddress
from importlib import import_module
from typing import Any
from urllib.parse import urlsplit

from protocol.base.errors import RequestError
from protocol.base.optional import optional

CONNECT_S = 10.0
_SILENT_S = 300  # a scheduler on a busy computer reads its first tasks for longer than Dask's 30 s


def check_scheduler(address: str, *, allow_remote: bool) -> None:
    """Refuse a Dask scheduler on another computer: traffic is unencrypted, and it can run programs here."""
    if allow_remote or address.startswith("inproc://"):
        return
    try:
        host = urlsplit(address if "://" in address else f"tcp://{address}").hostname or ""
        near = host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        near = False
    if not near:
        raise RequestError(
            f"the scheduler {address} is not on this computer, and the connection is neither encrypted nor protected",
            "Allow it if the network and the cluster are yours.",
            command="--allow-remote",
        )


def connect(address: str) -> Any:
    """Return a client of the Dask scheduler at an address. RequestError: Dask is missing, or no scheduler answers."""
    library = optional("distributed")
    try:
        with import_module("dask").config.set({"distributed.comm.timeouts.tcp": f"{_SILENT_S}s"}):
            return library.Client(address, timeout=CONNECT_S)
    except (OSError, TimeoutError, ValueError) as error:
        remedy = "start one with `dask scheduler` and give its address, as tcp://HOST:8786"
        raise RequestError(f"no Dask scheduler answers at {address}", remedy) from error
