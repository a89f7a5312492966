"""Where `write_report` used to stand; `from analysis import write_report` is the name to use."""

from analysis.reports.writing import write_report

__all__ = ["write_report"]
