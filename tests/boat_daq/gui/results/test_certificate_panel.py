"""The panels of a certificate and of metadata, on a copy of the example recording."""

from __future__ import annotations

import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QLineEdit

from boat_daq.engine.recording.metadata_entry import read_metadata
from boat_daq.engine.settings import HOME_VARIABLE, UnitLibrary
from boat_daq.gui.results.certificate_panel import CertificatePanel
from boat_daq.gui.results.metadata_form import MetadataForm
from boat_daq.viewmodels.results import certificates
from boat_daq.viewmodels.results.certificates import CertificateModel
from boat_daq.viewmodels.results.metadata import MetadataModel
from boat_daq.workflows.certificate import load_laboratory
from boat_daq.workflows.jobs import JobState

EXAMPLE = Path(__file__).parents[4] / "recordings" / "simulated_SA1_two_cycles.boat"
PIXEL = bytes.fromhex(
    "89504e470d0a1a0a0000000d4948445200000001000000010802000000907753de0000000c49444154789c63f8ffff3f0005fe02fe0def46b8"
    "0000000049454e44ae426082"
)


class Jobs:
    """Runs nothing: takes a job, and ends it when it is told to."""

    def __init__(self) -> None:
        self.started = []

    def get(self, name):
        return self.started[-1][1] if self.started and self.started[-1][0] == name else None

    def start(self, name, job, then):
        self.started.append((name, job, then))

    def end(self, result):
        _, job, then = self.started.pop()
        job.state, job.result, job.failure = JobState.DONE, result, None
        then(job)


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.setenv(HOME_VARIABLE, str(tmp_path / "home"))
    monkeypatch.setattr(certificates, "Job", lambda *args: SimpleNamespace(args=args))
    return Path(shutil.copy(EXAMPLE, tmp_path / "run.boat"))


def test_certificate_requests_what_is_missing_once_and_shows_its_pages(live, run):
    """Laboratory and metadata are stored with recording and unit; a wrong country is refused; then nothing is asked."""
    units, services, jobs = UnitLibrary(simulated=True), live.model.services, Jobs()

    def panel() -> CertificatePanel:
        stated = MetadataModel.of_recording(run, units, "SA1", services.undo)
        shown = CertificatePanel(live, CertificateModel(stated, run, "", jobs, services), services)
        shown.show()
        return shown

    first = panel()
    assert "operator" not in first.metadata  # the recording states it
    assert not first.write.isEnabled()
    jobs.end(("K-7", [PIXEL, PIXEL]))
    first._follow()
    assert first.outcome.text() == "No. K-7"
    least = sum(first.stack.itemAt(i).widget().height() for i in range(2))
    assert first.pages.height() >= least  # at once: else the pages lie over each other for a while
    QTest.qWait(0)
    pages = [first.stack.itemAt(i).widget() for i in range(first.stack.count())]
    assert len(pages) == 2
    assert all(page.height() >= page.pixmap().deviceIndependentSize().height() for page in pages)  # whole, none cut
    assert first.write.isEnabled()
    assert first.focusWidget() is first.laboratory["name"]
    first.laboratory["name"].setText("Lab")
    first.laboratory["country_code"].setText("de")
    first.update_button.click()
    assert load_laboratory() is None
    assert not jobs.started
    first.laboratory["country_code"].setText("DE")
    typed = {"customer": "A & B", "item": "Rod", "serial_number": "7", "ambient_temperature_c": "21,5"}
    for key, text in {**typed, "ambient_humidity_percent": "40"}.items():
        first.metadata[key].setText(text)
    first.update_button.click()
    jobs.end(("K-8", [PIXEL]))
    assert read_metadata(run).ambient_temperature_c == 21.5
    assert units.load("SA1").metadata == {
        "operator": "demo", "customer": "A & B", "item": "Rod", "serial_number": "7"
    }  # fmt: skip
    first.model.write(run.with_name("c.pdf"))
    assert [path.name for path in jobs.started[-1][1].args[3]] == ["c.pdf", "c.xml"]
    jobs.started.clear()
    first.close()
    second = panel()
    assert not second.metadata
    assert not second.laboratory
    second.close()
    services.undo.undo()
    assert read_metadata(run).customer == ""


def test_metadata_are_stated_and_refused_at_a_wrong_number(live, run):
    services = live.model.services
    model = MetadataModel.of_recording(run, UnitLibrary(simulated=True), "SA1", services.undo)
    form = MetadataForm(live, model, services)
    form.show()
    form.fields["customer"].setText("A")
    form.free.setPlainText("rig = 2\nline without a sign")
    form.fields["ambient_humidity_percent"].setText("wet")
    form._save()
    assert form.isVisible()
    assert read_metadata(run).customer == ""
    form.fields["ambient_humidity_percent"].setText("40")
    form._save()
    QApplication.processEvents()
    assert read_metadata(run).fields == {"rig": "2"}
    assert read_metadata(run).ambient_humidity_percent == 40.0


@pytest.mark.parametrize("kind", ["metadata", "certificate"])
def test_escape_does_not_lose_what_is_typed(live, run, kind):
    """Fifteen fields were gone at one Esc; a second one, with nothing typed between, discards them."""
    services = live.model.services
    stated = MetadataModel.of_recording(run, UnitLibrary(simulated=True), "SA1", services.undo)
    for texts, open_after in (
        (("Institute", ""), [True, False]),
        (("A", "B", ""), [True, True, False]),
        (("",), [False]),
    ):
        panel = MetadataForm(live, stated, services)
        if kind == "certificate":
            panel = CertificatePanel(live, CertificateModel(stated, run, "", Jobs(), services), services)
        panel.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose, False)
        panel.show()
        field = panel.findChildren(QLineEdit)[0]
        seen = []
        for text in texts:
            QTest.keyClicks(field, text)
            QTest.keyClick(panel, Qt.Key.Key_Escape)
            seen.append(panel.isVisible())
        assert seen == open_after
