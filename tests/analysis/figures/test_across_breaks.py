"""Before and after a break: t and F against scipy's and against nested models, the false-alarm rate, whole runs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats

from analysis import Options, analyse
from analysis.data.recording import Recording
from analysis.figures import across_breaks as break_comparison
from analysis.figures.across_breaks import ALPHA, Break, compare_breaks, parts_of
from analysis.reports.build import build_report
from analysis.segmentation.cycles import Cycle, Cycles
from analysis.segmentation.loops import Loops
from protocol.base.errors import RecordingError
from tests.analysis.boat_builder import Plant, triangle

LEVELS = np.array([-40.0, 0.0, 50.0])


def resumption(first_segment: int, **other: Any) -> dict[str, Any]:
    """An entry as the recorder writes it."""
    keys = ("host_ns", "first_chunk", "first_step", "first_cycle", "complete_cycles", "last_result")
    entry = {"utc": "2026-01-01T00:00:10+00:00", "cause": "interrupted", "break_s": 10.0}
    return {**entry, **dict.fromkeys(keys, 1), "first_segment": first_segment, **other}


def compared(before: np.ndarray, after: np.ndarray) -> Break:
    """Compare cycles whose levels are these values, mV, and whose sensitivities are 1 mV/kPa plus a like scatter."""
    y = np.concatenate([before, after])
    n = y.size
    centred = LEVELS - LEVELS.mean()
    signal = y[:, None] + centred * (1.0 + 1e-3 * y[::-1, None])
    loops = Loops(
        LEVELS, np.broadcast_to(LEVELS, (2, n, 3)), None, np.broadcast_to(signal, (1, 2, n, 3)),
        np.ones((2, n, 3), bool), tuple(range(1, n + 1)), (), (-40.0, 50.0), True,
    )  # fmt: skip
    segments = np.repeat([1, 2], [before.size, after.size])
    recording = Recording.from_arrays(
        np.arange(n, dtype=float), np.zeros(n), np.zeros(n), segment=segments, meta={"resumptions": [resumption(2)]}
    )
    cycles = Cycles(tuple(Cycle(k + 1, k, k, k, True) for k in range(n)), (), (), np.zeros(n), 0.0, 90.0)
    (found,) = compare_breaks(recording, cycles, loops)
    return found


@pytest.mark.parametrize("sizes", [(3, 5), (2, 2), (1, 4), (3, 40)])
def test_few_cycles_are_compared_as_scipy_does(sizes: tuple[int, int]) -> None:
    """Student's t and the ratio of variances, with fewer than four cycles on a side."""
    rng = np.random.default_rng(1)
    before, after = 1600.0 + rng.standard_normal(sizes[0]), 1600.5 + 2.0 * rng.standard_normal(sizes[1])
    level = compared(before, after).comparisons[0]
    expected = stats.ttest_ind(after, before)
    assert (level.t, level.t_p, level.t_df) == pytest.approx((expected.statistic, expected.pvalue, expected.df))
    interval = expected.confidence_interval(0.95)
    assert (level.difference_low, level.difference_high) == pytest.approx((interval.low, interval.high))
    if min(sizes) > 1:
        ratio = after.var(ddof=1) / before.var(ddof=1)
        tail = stats.f(sizes[1] - 1, sizes[0] - 1).cdf(ratio)
        assert (level.f, level.f_p) == pytest.approx((ratio, 2 * min(tail, 1 - tail)))
    else:
        assert np.isnan(level.f)


def test_a_step_is_distinguished_from_a_drift_as_nested_models_do() -> None:
    """t squared is the F of the model with a step against the one without; df as its n - 3; the drift is common."""
    rng = np.random.default_rng(2)
    at = np.arange(30.0)
    y = 1600.0 + 0.3 * at + 0.8 * (at >= 12) + 0.2 * rng.standard_normal(30)
    level = compared(y[:12], y[12:]).comparisons[0]

    def rss(*columns: np.ndarray) -> float:
        model = np.stack(columns, axis=1)
        return float(((y - model @ np.linalg.pinv(model) @ y) ** 2).sum())

    without, with_step = rss(np.ones(30), at), rss(np.ones(30), at, at >= 12)
    assert level.t**2 == pytest.approx((without - with_step) / (with_step / 27))
    assert level.t_df == 27
    residuals = [
        part - np.polyval(np.polyfit(np.arange(part.size), part, 1), np.arange(part.size)) for part in (y[:12], y[12:])
    ]
    variances = [float(r @ r / (r.size - 2)) for r in residuals]
    assert level.f == pytest.approx(variances[1] / variances[0])


def test_a_drift_alone_is_no_difference_and_a_step_beside_it_is() -> None:
    """1 mV a cycle over 20 cycles, scatter 0.1 mV: nothing is found; with a step of 1 mV it is."""
    rng = np.random.default_rng(3)
    y = 1600.0 + np.arange(20.0) + 0.1 * rng.standard_normal(20)
    assert compared(y[:10], y[10:]).verdict == "same"
    stepped = compared(y[:10], y[10:] + 1.0)
    assert stepped.verdict == "differs"
    assert "t" in stepped.comparisons[0].significant


def test_a_scatter_that_grew_is_a_difference() -> None:
    """Ten times the scatter behind the break is found by F, whatever the means."""
    rng = np.random.default_rng(4)
    found = compared(1600 + 0.1 * rng.standard_normal(30), 1600 + 1.0 * rng.standard_normal(30))
    assert found.verdict == "differs"
    assert "F" in found.comparisons[0].significant


def test_false_alarms_come_at_the_stated_rate() -> None:
    """Of 80 breaks that change nothing, no more are flagged than ALPHA allows (binomial, 0.1 % tail)."""
    rng = np.random.default_rng(5)
    alarms = sum(
        compared(1600 + rng.standard_normal(n), 1600 + rng.standard_normal(9)).verdict == "differs"
        for n in rng.integers(3, 15, 80)
    )
    assert alarms <= stats.binom.ppf(0.999, 80, ALPHA)


@pytest.mark.parametrize("sizes", [(1, 1), (0, 5), (5, 0)])
def test_too_few_cycles_are_reported_as_untested(sizes: tuple[int, int]) -> None:
    """No test, no verdict, and the sentence reports it; the cycles are one part."""
    found = compared(np.full(sizes[0], 1600.0), np.full(sizes[1], 1601.0))
    assert found.verdict == "untested"
    assert "untested" in found.sentence
    assert (
        f"interrupted after cycle {sizes[0]} (" if sizes[0] else "interrupted before its first complete cycle"
    ) in found.sentence
    assert len(parts_of([found])) == 1


def test_a_break_with_nothing_behind_it_hides_no_other() -> None:
    """Resumed, broken again before a cycle was whole, resumed once more: the parts on both sides are compared."""
    run = broken_run(5.0)
    twice = {"resumptions": [resumption(2), resumption(3)]}
    segment = np.where(run.segment == 2, 3, 1)
    recording = Recording.from_arrays(run.time_s, run.pressure_kpa, run.signal_mv, segment=segment, meta=twice)
    (found,) = analyse(recording, options=Options(mcmc=False)).breaks
    assert found.verdict == "differs"
    assert len(found.before) > 1
    assert len(found.after) > 1


def test_values_without_any_scatter_are_compared_too() -> None:
    """A step between constants is a difference; none is none."""
    flat = np.full(5, 1600.0)
    assert compared(flat, flat + 1.0).verdict == "differs"
    assert compared(flat, flat).verdict == "same"


def broken_run(offset_mv: float, cycles: tuple[int, int] = (6, 9)) -> Recording:
    """Two runs of continuous cycles in one recording; the second one's sensors read `offset_mv` more."""
    parts = [Plant(seed=k).run(*triangle(n, 4.0)) for k, n in enumerate(cycles)]
    first, second = parts
    time_s = np.concatenate([first.time_s, second.time_s + first.time_s[-1] + 10.0])
    return Recording.from_arrays(
        time_s,
        np.concatenate([first.pressure_kpa, second.pressure_kpa]),
        np.concatenate([first.signal_mv, second.signal_mv + offset_mv]),
        segment=np.repeat([1, 2], [first.n, second.n]),
        meta={"resumptions": [resumption(2)]},
    )


def test_a_run_that_did_not_change_is_pooled_and_reported() -> None:
    """All complete cycles enter the figures, and the warning names the comparison."""
    analysis = analyse(broken_run(0.0), options=Options(mcmc=False))
    output = analysis.to_json()
    assert output["breaks"][0]["pooled"]
    assert output["parts"] == []
    assert analysis.loops.n_cycles == analysis.cycles.as_json()["complete"]
    (flag,) = [flag["text"] for flag in output["flags"] if flag["code"] == "break"]
    assert "pooled" in flag


def test_a_run_that_changed_is_never_pooled() -> None:
    """Figures of both parts are given; those of the run are the larger part's, equal to an analysis of it alone."""
    run = broken_run(5.0)
    analysis = analyse(run, options=Options(mcmc=False))
    output = analysis.to_json()
    (found,) = output["breaks"]
    assert (found["verdict"], found["pooled"]) == ("differs", False)
    level = found["comparisons"][0]
    assert level["difference_low"] < 5.0 < level["difference_high"]
    assert [len(part["cycles"]) for part in output["parts"]] == [len(found["before"]), len(found["after"])]
    alone = analyse(Plant(seed=1).run(*triangle(9, 4.0)), options=Options(mcmc=False))
    own = analysis.sensors[0].figures["system_hysteresis_percent_fso"]
    assert own.value == pytest.approx(alone.sensors[0].figures["system_hysteresis_percent_fso"].value, rel=0.1)
    assert output["parts"][1]["sensors"][0]["figures"]["system_hysteresis_percent_fso"]["value"] == own.value
    assert any(flag["code"] == "differs_over_break" for flag in output["flags"])
    titles = [section.title for section in build_report([analysis]).sections]
    assert "Before and after the interruption" in titles


def test_an_unbroken_run_has_no_such_keys() -> None:
    """Results stored before breaks were known come out the same."""
    output = analyse(Plant().run(*triangle(3, 4.0)), options=Options(mcmc=False)).to_json()
    assert not {"breaks", "parts"} & set(output)


def test_breaks_that_are_no_breaks_are_refused() -> None:
    """A hand-made list is refused by its name."""
    run = broken_run(0.0)
    for wrong in ("yes", [1], [{"utc": "x"}], [resumption(-1)]):
        with pytest.raises(RecordingError, match="resumptions"):
            compare_breaks(
                Recording.from_arrays(run.time_s, run.pressure_kpa, run.signal_mv, meta={"resumptions": wrong}),
                Cycles((), (), (), run.pressure_kpa, 0.0, 90.0),
                break_comparison.continuous_loops(run, Cycles((), (), (), run.pressure_kpa, 0.0, 90.0)),
            )
