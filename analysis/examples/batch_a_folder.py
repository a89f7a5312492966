"""A folder of runs into one table.

python -m analysis.examples.batch_a_folder recordings table.csv
"""

from __future__ import annotations

import sys

from analysis.history.batch import batch, write_table


def main(folder: str, table: str, workers: int | None = None) -> int:
    """Write the table; return its number of rows. `workers` None takes one process for each core."""
    rows = batch(folder, workers=workers)
    write_table(rows, table)
    print(rows[[c for c in ("run", "sensor", "cycles", "snr_db", "error") if c in rows]].to_string(index=False))
    return len(rows)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
