"""A stand-in for ROS 2's client library: it ends the program after five values of each topic."""

from __future__ import annotations

import math
from typing import Any


def init() -> None:
    """Do nothing."""


def create_node(_name: str) -> Node:
    """Return a node."""
    return Node()


class Node:
    """Counts what its publishers get."""

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}

    def create_publisher(self, _kind: type, topic: str, _depth: int) -> Publisher:
        """Return a publisher of a topic."""
        self.counts[topic] = 0
        return Publisher(self, topic)


class Publisher:
    """Accepts finite values."""

    def __init__(self, node: Node, topic: str) -> None:
        self.node, self.topic = node, topic

    def publish(self, message: Any) -> None:
        """Count a message; leave with exit code 0 when all topics have five."""
        if not math.isfinite(message.data):
            raise ValueError(self.topic)
        self.node.counts[self.topic] += 1
        if min(self.node.counts.values()) >= 5:
            raise SystemExit
