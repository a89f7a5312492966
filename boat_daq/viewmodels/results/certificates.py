"""The panel of the certificate: what is missing, its pages, its files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

from analysis.certificates.laboratory import Laboratory
from boat_daq.viewmodels.common.services import Services
from boat_daq.viewmodels.results.metadata import FIELDS, MetadataModel
from boat_daq.workflows.certificate import (
    CertificateOrder,
    load_laboratory,
    preview_certificate,
    store_laboratory,
    write_certificates,
)
from boat_daq.workflows.jobs import Job, JobRunner, JobState

LABORATORY_FIELDS = (
    ("name", "Laboratory"),
    ("street", "Street"),
    ("post_code", "Post code"),
    ("city", "City"),
    ("country_code", "Country (DE)"),
    ("accreditation", "Accreditation"),
    ("procedure", "Procedure"),
    ("signatory", "Authorised by"),
)
"""Key and label of what is requested of the laboratory, once."""


class CertificateModel:
    """State of the certificate's panel: what is missing, its pages, the files."""

    def __init__(self, metadata: MetadataModel, path: Path, curve: str, jobs: JobRunner, services: Services) -> None:
        self.metadata, self.path = metadata, path
        self._order = CertificateOrder((path,), curve=curve)
        self._jobs, self._notices = jobs, services.notices
        self.number = ""
        self.pages: list[bytes] = []
        self.failure = ""
        self.revision = 0

    @property
    def working(self) -> bool:
        return self._jobs.get("certificate") is not None

    def missing(self) -> tuple[tuple[str, str], ...]:
        """Return key and label of what the recording does not state; a note is never missing."""
        stated = asdict(self.metadata.stated())
        return tuple((key, label) for key, label in FIELDS if key != "note" and stated[key] in ("", None))

    def missing_laboratory(self) -> tuple[tuple[str, str], ...]:
        """Return key and label of what is requested of the laboratory: nothing once it is stored."""
        return () if load_laboratory() is not None else LABORATORY_FIELDS

    def state(self, metadata: Mapping[str, str], laboratory: Mapping[str, str]) -> None:
        """Store the texts that are not empty, by key, and make the pages."""
        stated = {key: text.strip() for key, text in laboratory.items() if text.strip()}
        if stated.get("name"):
            store_laboratory(Laboratory(**stated))
        given = {key: text for key, text in metadata.items() if text.strip()}
        if given:
            self.metadata.state(given)
        self.show()

    def show(self) -> None:
        self.failure = ""
        job = Job("Making the certificate", preview_certificate, self._order)
        self._jobs.start("certificate", job, self._shown)
        self.revision += 1

    def _shown(self, job: Job) -> None:
        if job.state is JobState.DONE:
            self.number, self.pages = job.result
        elif job.failure is not None:
            self.pages, self.failure = [], f"{job.failure.cause}. {job.failure.remedy}".strip()
        self.revision += 1

    def write(self, target: Path) -> None:
        """Write PDF and XML in the background, beside each other."""
        targets = (target.with_suffix(".pdf"), target.with_suffix(".xml"))
        job = Job("Writing the certificate", write_certificates, self._order, targets)
        job.target = targets[0]
        saved = self._notices.ended(lambda _: self._notices.inform_saved(targets[0]))
        self._jobs.start(f"certificate {targets[0]}", job, saved)
