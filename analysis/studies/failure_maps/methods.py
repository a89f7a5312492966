"""The studies of the atlas, by name."""

from __future__ import annotations

from collections.abc import Iterable

from analysis.studies.failure_maps import alarms, figures, fit, sessions, shadow, tracer
from analysis.studies.failure_maps.sweep import Study
from analysis.studies.harness import chosen

_STUDIES = (
    fit.FIT_STUDIES,
    sessions.SESSION_STUDIES,
    figures.FIGURE_STUDIES,
    tracer.TRACER_STUDIES,
    shadow.SHADOW_STUDIES,
    alarms.ALARM_STUDIES,
)
STUDIES: dict[str, Study] = {study.name: study for studies in _STUDIES for study in studies}


def chosen_studies(names: Iterable[str]) -> list[Study]:
    """Return the studies of methods or maps by name, each once, in the atlas' order; all for no names."""
    return chosen(list(STUDIES.values()), names, lambda study: (study.method, study.name))
