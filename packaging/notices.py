"""The notices of third parties: THIRD-PARTY.txt of the repository and package, and the file of the bundle.

    python packaging/notices.py            # writes THIRD-PARTY.txt again: what is installed with the program, by name
    python packaging/notices.py FILE       # a bundle's notices: each library with its version and its whole licence

What is installed is found by following the requirements of the installed program. A library whose licence is not found
is an error. `packaging/boat-daq.spec` calls `bundle_notices`, with the shared libraries that it took from the system.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[1]
LIST = ROOT / "THIRD-PARTY.txt"
_TEXTS = ROOT / "packaging" / "licenses"
_QT = ("LGPL-3.0.txt", "GPL-3.0.txt")  # the first is written as additions to the second
ADDED = {"pyside6-essentials": _QT, "shiboken6": _QT, "pyserial": ("pyserial.txt",)}  # their wheels hold no text
_NAMES = {  # where a distribution states its licence in a sentence, or not
    "cobs": "MIT", "contourpy": "BSD-3-Clause", "cycler": "BSD-3-Clause", "kiwisolver": "BSD-3-Clause",
    "matplotlib": "Matplotlib (PSF)", "meshio": "MIT", "numba": "BSD-2-Clause", "numpy": "BSD-3-Clause and others",
    "pyserial": "BSD-3-Clause", "scipy": "BSD-3-Clause and others", "shellingham": "ISC",
    "pyside6-essentials": "LGPL-3.0-only", "shiboken6": "LGPL-3.0-only",  # of the three that are offered
}  # fmt: skip
_CLASSIFIERS = {"MIT License": "MIT", "BSD License": "BSD-3-Clause", "Python Software Foundation License": "PSF-2.0"}
COPYLEFT = {"secop": "frappy-core: GPL-2.0-or-later"}  # extras that put a program with them under the GPL

HEAD = """boat-daq is under the MIT licence (LICENSE). It is used with the libraries below, each under its own licence.

Qt and Qt for Python (PySide6, shiboken6), of The Qt Company Ltd., are used under the GNU LGPL version 3, as unchanged
shared libraries. They may be replaced by other builds of the same interface: in an installation by `pip`, in a bundle
by exchanging the files in `_internal/PySide6` and `_internal/shiboken6`. Their sources:
https://download.qt.io/official_releases/QtForPython/ and https://download.qt.io/official_releases/qt/. What Qt itself
contains of others: https://doc.qt.io/qt-6/licenses-used-in-qt.html

"""
EXTRAS = """
None of these puts a program that uses it under the GPL. The libraries of these extras do:

"""


def canonical(name: str) -> str:
    """Return a distribution's name as package indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def libraries() -> list[metadata.Distribution]:
    """Return what is installed with the program without extras, by name."""
    found: dict[str, metadata.Distribution] = {}
    waiting = ["boat-daq"]
    while waiting:
        distribution = metadata.distribution(waiting.pop())
        if canonical(distribution.name) in found:
            continue
        found[canonical(distribution.name)] = distribution
        for text in distribution.requires or ():
            requirement = Requirement(text)
            if requirement.marker is None or requirement.marker.evaluate({"extra": ""}):
                waiting.append(requirement.name)
    del found["boat-daq"]
    return [found[name] for name in sorted(found)]


def licence(distribution: metadata.Distribution) -> str:
    """Return the name of a licence; ValueError where a distribution states none."""
    known = _NAMES.get(canonical(distribution.name)) or distribution.metadata.get("License-Expression")
    if known:
        return known
    for classifier in distribution.metadata.get_all("Classifier") or ():
        if (name := _CLASSIFIERS.get(classifier.rpartition(" :: ")[2])) is not None:
            return name
    if len(stated := (distribution.metadata.get("License") or "").strip()) in range(1, 40):
        return stated
    raise ValueError(f"{distribution.name} states no licence: add it to _NAMES of packaging/notices.py")


def texts(distribution: metadata.Distribution) -> Iterator[str]:
    """Give the texts of a licence; ValueError where there is none."""
    names = re.compile(r"(licen[cs]e|copying|notice|authors)", re.I)
    files = [
        file for file in distribution.files or () if ".dist-info" in str(file) and names.search(Path(str(file)).name)
    ]
    for file in sorted(files):
        yield Path(str(distribution.locate_file(file))).read_text(encoding="utf-8", errors="replace")
    for name in ADDED.get(canonical(distribution.name), ()):
        yield (_TEXTS / name).read_text(encoding="utf-8")
    if not files and canonical(distribution.name) not in ADDED:
        raise ValueError(f"{distribution.name} holds no text of its licence: add it to packaging/licenses")


def name_list() -> str:
    """Return THIRD-PARTY.txt: what is installed, by name and licence, without versions."""
    rows = [f"{library.name:<22} {licence(library)}" for library in libraries()]
    marked = [f"boat-daq[{extra}]: {why}" for extra, why in (*COPYLEFT.items(), ("all", "holds it, too"))]
    return HEAD + "\n".join(rows) + "\n" + EXTRAS + "\n".join(marked) + "\n"


def bundle_notices(system: Iterable[Path] = ()) -> str:
    """Return the notices of a bundle, whose shared libraries from the system are `system`."""
    parts = [HEAD]
    for library in libraries():
        parts.append(f"{'=' * 78}\n{library.name} {library.version}: {licence(library)}\n{'=' * 78}\n")
        parts += texts(library)
    python = Path(os.__file__).with_name("LICENSE.txt")
    if python.is_file():
        parts.append(f"{'=' * 78}\nPython {sys.version.split()[0]}: PSF-2.0\n{'=' * 78}\n")
        parts.append(python.read_text(encoding="utf-8", errors="replace"))
    for package in sorted({name for path in system if (name := _package_of(path))}):
        copyright_file = Path("/usr/share/doc", package.partition(":")[0], "copyright")
        if copyright_file.is_file():
            parts.append(f"{'=' * 78}\nDebian package {package}\n{'=' * 78}\n")
            parts.append(copyright_file.read_text(encoding="utf-8", errors="replace"))
    return "\n".join(parts)


def _package_of(path: Path) -> str | None:
    """Return the Debian package that a file belongs to."""
    for each in (path, path.resolve()):
        done = subprocess.run(["dpkg-query", "-S", str(each)], capture_output=True, text=True, check=False)
        if done.returncode == 0:
            return done.stdout.rpartition(": ")[0].split(", ")[0]
    return None


if __name__ == "__main__":
    if len(sys.argv) > 1:
        Path(sys.argv[1]).write_text(bundle_notices(), encoding="utf-8")
    else:
        LIST.write_text(name_list(), encoding="utf-8")
