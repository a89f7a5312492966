"""Coverage-guided fuzzing of every decoder: `make fuzz SECONDS=3600`, or `python -m tests.faults.fuzz 60 csv mesh`.

Each decoder has its share of the time, in a process of its own, from the seeds of `seeds.py` and what earlier runs
have found to be new (stored in FOLDER). A finding ends its process; the input stays in FOLDER and is printed.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import platformdirs

FOLDER = Path(os.environ.get("BOAT_FUZZ") or platformdirs.user_cache_path("boat-daq", appauthor=False) / "fuzz")
INPUT_MAX = {"recording": 150_000, "sweep": 40_000, "mesh": 60_000, "shadow table": 20_000}
COMPILED = [  # numba cannot compile what is instrumented
    ".".join(file.with_suffix("").parts)
    for file in sorted(Path("analysis").rglob("*.py"))
    if re.search(r"^@(compiled|inner)", file.read_text(encoding="utf-8"), re.MULTILINE)
]
SECONDS_FOR_ONE_INPUT = 20


def fuzz(name: str, seconds: int) -> None:
    """Fuzz one decoder in this process; libFuzzer ends the process."""
    import atheris

    with atheris.instrument_imports(include=["protocol", "analysis", "boat_daq"], exclude=COMPILED):
        from tests.faults.decoders import DECODERS
    from tests.faults.seeds import seeds

    corpus = FOLDER / name.replace(" ", "_")
    corpus.mkdir(parents=True, exist_ok=True)
    for number, seed in enumerate(seeds(name)):
        (corpus / f"seed{number}").write_bytes(seed)
    arguments = [
        sys.argv[0], f"-max_total_time={seconds}", f"-max_len={INPUT_MAX.get(name, 4096)}", "-rss_limit_mb=2500",
        f"-timeout={SECONDS_FOR_ONE_INPUT}", f"-artifact_prefix={FOLDER}/finding_{name.replace(' ', '_')}_",
        "-print_final_stats=1", "-verbosity=1", str(corpus),
    ]  # fmt: skip
    atheris.Setup(arguments, DECODERS[name])
    atheris.Fuzz()


def main(seconds: int, names: list[str]) -> int:
    """Fuzz decoders one after the other; return 1 if something was found."""
    from tests.faults.decoders import DECODERS

    names = names or list(DECODERS)
    FOLDER.mkdir(parents=True, exist_ok=True)
    found = []
    for name in names:
        log = FOLDER / f"{name.replace(' ', '_')}.log"
        share = max(1, seconds // len(names))
        with log.open("w") as file:
            command = [sys.executable, "-m", "tests.faults.fuzz", "--one", name, str(share)]
            code = subprocess.run(command, stdout=file, stderr=subprocess.STDOUT).returncode
        lines = log.read_text(errors="replace").splitlines()
        runs = next((line.split()[-1] for line in lines if "number_of_executed_units" in line), "?")
        print(f"{name}: {share} s, {runs} inputs, {'nothing found' if code == 0 else f'FOUND, see {log}'}", flush=True)
        found += [name] if code else []
    return 1 if found else 0


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        fuzz(sys.argv[2], int(sys.argv[3]))
    else:
        sys.exit(main(int(sys.argv[1]), sys.argv[2:]))
