"""The reference of a calibration: contributions to its uncertainty that the file of a unit or of a rig states.

Rules: a rig's file has the same tables as a unit's, [type_b.scale] and so on, and counts before the unit's.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from boat_daq.engine.settings import UnitLibrary
from boat_daq.engine.toml_values import BadValue, parse_toml, read_text

if TYPE_CHECKING:
    from analysis.calibration.type_b import TypeBContribution


def stated_contributions(unit: str, rig: Path | None = None) -> tuple[TypeBContribution, ...]:
    """Return the type B contributions that a rig's file states, or else the unit's; none where neither states any.

    Parameters
    ----------
    unit : its name; empty for none.
    rig : file of the rig; None for none.

    Raises
    ------
    OperatorError : a file is refused. AnalysisError : a contribution is refused, by name and key.
    """
    from analysis.calibration.type_b import contributions

    if rig is not None:
        table = parse_toml(read_text(rig), str(rig)).get("type_b")
        if not isinstance(table, dict):
            raise BadValue(str(rig), "type_b", "is missing", "write [type_b.scale] and its keys below it")
        return contributions(table)
    library = UnitLibrary()
    return contributions(library.load(unit).type_b) if unit in library.names() else ()
