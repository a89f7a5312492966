"""Where the workers of a cluster may be: on this computer, unless the user allows a remote one."""

from __future__ import annotations

import ipaddress
from urllib.parse import urlsplit

from analysis.errors import RequestError


def check_scheduler(address: str, *, allow_remote: bool) -> None:
    """Refuse the address of a Dask scheduler that is not on this computer, unless it is allowed.

    Tasks and results travel unencrypted, and the scheduler can run programs here.

    Raises
    ------
    RequestError : the address is on another computer.
    """
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
            "Add --allow-remote if the network and the cluster are yours.",
        )
