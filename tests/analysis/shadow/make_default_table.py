"""Make the table of the default actuator: `python -m tests.analysis.shadow.make_default_table`.

It takes about ten seconds. `test_table.py` compares a part of it with new solutions.
"""

from __future__ import annotations

import numpy as np

from analysis.shadow.fem.parameters import ActuatorParameters
from analysis.shadow.model.frames import Shadow
from analysis.shadow.model.held import unstable_places, vacuum_steps
from analysis.shadow.model.reduced import TableSettings
from analysis.shadow.model.table import DEFAULT_TABLE, build_table, table_arrays, table_digest, write_arrays


def main() -> None:
    """Build the table and its unstable held states, and write both."""
    table = build_table()
    unstable = unstable_places(shadow := Shadow(table=table), vacuum_steps(shadow))
    digest = table_digest(ActuatorParameters(), TableSettings())
    arrays = table_arrays(table) | {"unstable": np.array(sorted(unstable)), "digest": np.array(digest)}
    write_arrays(DEFAULT_TABLE, arrays)


if __name__ == "__main__":
    main()
