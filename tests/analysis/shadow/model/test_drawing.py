"""Figures of the shadow."""

from __future__ import annotations

import pytest

from analysis.shadow.model.drawing import headline, shadow_figure
from analysis.shadow.model.frames import Shadow
from analysis.shadow.model.reduced import ReducedModel


@pytest.fixture(scope="module")
def shadow(table: ReducedModel) -> Shadow:
    """The paper's actuator with its table."""
    return Shadow(table=table)


@pytest.mark.parametrize("colour", ["displacement", "strain"])
def test_the_figure_shows_the_frame(shadow: Shadow, colour: str) -> None:
    """Title with pressure, elongation, deviation and model; a labelled colour scale; both guides in the legend."""
    state = shadow.state(elongation_mm=3.5, pressure_kpa=50.0)
    figure = shadow_figure(state, shadow.topology, colour)  # type: ignore[arg-type]
    assert "deviation -0.30 mm" in headline(state)
    assert colour in figure.axes[1].get_ylabel()
    assert {"guide 1", "guide 2"} <= {t.get_text() for t in figure.legends[0].get_texts()}
