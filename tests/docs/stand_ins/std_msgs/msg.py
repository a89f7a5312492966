"""The one message that a page uses."""

from dataclasses import dataclass


@dataclass
class Float64:
    """A number."""

    data: float
