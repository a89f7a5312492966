"""Recordings and tables of numbers: read, imported, written, exported."""

from importlib.util import find_spec
from pathlib import Path


def _require_own_protocol() -> None:
    """Refuse another `protocol` than the one beside this package, as `boat_daq.own_packages` does, by its place."""
    spec = find_spec("protocol")
    found = spec and Path(spec.origin or next(iter(spec.submodule_search_locations or [""])))
    if found and found.resolve() != Path(__file__).resolve().parents[2] / "protocol" / "__init__.py":
        cause = f"{found} would be imported in place of boat-daq's package 'protocol'."
        remedy = "Rename it, or move it to another folder; a package's: use an environment without that package."
        raise ImportError(f"{cause} {remedy}", name="protocol")


_require_own_protocol()
