"""The option --fidelity."""

from __future__ import annotations

import pytest


@pytest.mark.parametrize(
    ("typed", "level", "released"),
    [
        ((None, None), None, (250, 100)),
        ((None, None), "reference", (1_000, 400)),
        ((600, None), "reference", (600, 240)),
        ((600, None), None, (600, 100)),
        ((600, 7), "draft", (600, 7)),
    ],
)
def test_what_is_typed_goes_before_the_level_and_the_level_before_the_paper(
    typed: tuple[int | None, int | None], level: str | None, released: tuple[int, int]
) -> None:
    """Rays and secondaries of `optics trace`, with and without --fidelity: the surface's 250 and 100 stay."""
    from boat_daq.commands.optics import Released

    found = Released.chosen(*typed, level, lambda chosen: chosen.rays)
    assert (found.rays, found.secondary) == released


def test_an_unknown_fidelity_is_a_usage_error() -> None:
    """Exit code 2, with the levels."""
    from typer.testing import CliRunner

    from boat_daq.cli import app

    result = CliRunner().invoke(app, ["optics", "trace", "--fidelity", "finest"])
    assert result.exit_code == 2
    assert "draft, normal, reference" in " ".join(result.output.split())
