"""Certificates of recordings: the file of the laboratory, the analyses, what is written and shown of them.

Rules: a laboratory is stated once, in `laboratory.toml` of the settings' folder. The calibration that was in force
before, for "as found", is the newest accepted one of another recording, of the same kind of board.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import tomli_w

from analysis.certificates.laboratory import Laboratory
from analysis.progress import Progress, part_of
from boat_daq.engine.settings import UnitLibrary, home
from boat_daq.engine.stored_file import write_stored
from boat_daq.engine.toml_values import build, parse_toml, read_text
from boat_daq.workflows.calibration_in_force import calibration_before, chosen_curve, stated_contributions
from protocol.base.errors import RequestError, writing
from protocol.base.whole_file import write_whole

if TYPE_CHECKING:
    from analysis.certificates.certificate import Certificate, Request
    from analysis.data.recording import Recording
    from analysis.figures.pipeline import Analysis

LABORATORY_FILE = "laboratory.toml"


@dataclass(frozen=True, slots=True)
class CertificateOrder:
    """The recordings of a certificate, and what it states besides.

    `elongations`: a file of readings for each run, or one for all; none for the files beside the recordings.
    """

    runs: tuple[Path, ...]
    elongations: tuple[Path, ...] = ()
    curve: str = ""
    limits: Mapping[str, float] = field(default_factory=dict)
    values: Mapping[str, str] = field(default_factory=dict)  # metadata by key, in place of those of the recordings
    customer: str = ""
    items: tuple[str, ...] = ()
    number: str = ""
    laboratory: Path | None = None  # TOML file; None for the stored one


def load_laboratory(path: Path | None = None) -> Laboratory | None:
    """Return the laboratory of a file, or the stored one; None where none was stored."""
    stored = home() / LABORATORY_FILE
    if path is None and not stored.exists():
        return None
    where = path or stored
    found = build(Laboratory, parse_toml(read_text(where), str(where)), str(where))
    if not found.name.strip():
        raise RequestError(f"{where} has an empty 'name'", "Give the name of the laboratory.")
    return found


def store_laboratory(laboratory: Laboratory) -> None:
    """Store the laboratory for every certificate."""
    stated = {key: value for key, value in dataclasses.asdict(laboratory).items() if value}
    write_stored(home() / LABORATORY_FILE, tomli_w.dumps(stated))


def certificate_for(order: CertificateOrder, progress: Progress | None = None) -> Certificate:
    from analysis.certificates.certificate import certificate_of

    analyses, request = analyses_for(order, progress)
    return certificate_of(analyses, request)


def analyses_for(order: CertificateOrder, progress: Progress | None = None) -> tuple[list[Analysis], Request]:
    """Return the analyses of the recordings, and what the certificate states besides."""
    from analysis import Options, analyse, load_recording
    from analysis.certificates.certificate import Request
    from analysis.history.batch import readings_beside

    analyses, previous = [], []
    for number, run in enumerate(order.runs):
        recording = _with_values(load_recording(run), order.values)
        type_b = stated_contributions(recording)
        options = Options(chosen_curve(recording, order.curve), mcmc=False, type_b=type_b)
        given = order.elongations[number % len(order.elongations)] if order.elongations else readings_beside(run)
        part = part_of(progress, number, 1, len(order.runs))
        analyses.append(analyse(recording, given, options=options, progress=part))
        units = UnitLibrary(simulated=recording.simulated)
        previous.append(calibration_before(units, recording.unit, recording.identity))
    laboratory = load_laboratory(order.laboratory)
    request = Request(
        laboratory, order.customer, order.items, order.limits, number=order.number, previous=tuple(previous)
    )
    return analyses, request


def _with_values(recording: Recording, values: Mapping[str, str]) -> Recording:
    stated = asdict(recording.metadata.changed(values))
    return dataclasses.replace(recording, meta={**recording.meta, **stated})


def write_certificate(certificate: Certificate, path: str | Path) -> Path:
    """Write a certificate: PDF/A-3 with the Digital Calibration Certificate attached, or that alone as XML."""
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in (".pdf", ".xml"):
        raise RequestError(f"{path.name} ends in neither .pdf nor .xml", "Choose one of the two.")
    with writing(path):
        path.parent.stat()
        if kind == ".xml":
            from analysis.certificates.dcc import dcc_xml

            write_whole(path, dcc_xml(certificate))
        else:
            from analysis.certificates.document import certificate_document
            from analysis.reports.pdf import write_pdf

            write_pdf(certificate_document(certificate), path)
    return path


def write_certificates(order: CertificateOrder, targets: Sequence[Path], *, progress: Progress | None = None) -> str:
    """Write a certificate to files that end in .pdf or .xml; return its number."""
    certificate = certificate_for(order, progress)
    for target in targets:
        write_certificate(certificate, target)
    return certificate.number


def preview_certificate(order: CertificateOrder, *, progress: Progress | None = None) -> tuple[str, list[bytes]]:
    """Return the number of a certificate and its pages as PNG images."""
    from analysis.certificates.document import certificate_pages

    certificate = certificate_for(order, progress)
    return certificate.number, certificate_pages(certificate)
