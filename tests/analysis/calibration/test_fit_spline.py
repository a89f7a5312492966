"""A monotone spline as the curve of a calibration."""

from __future__ import annotations

import json

import numpy as np
import pytest

from analysis.calibration.adequacy import CurveVerdict
from analysis.calibration.checks import calibration_warnings, fit_checks
from analysis.calibration.compare import compare_fits
from analysis.calibration.inverse import Fusion, Inverse
from protocol.base.errors import DataError
from tests.analysis.calibration.sessions import CUBIC, TRUTHS, session, sessions


def test_spline_of_a_sigmoid_is_adequate_and_inverts() -> None:
    """Where no cubic is right: within 1 mV of the truth, monotone, and back from mV to mm within 0.05 mm."""
    each = session(TRUTHS["sigmoid"])
    fit, at = each.fit("spline"), each.grid_of_x
    assert fit.curve == "spline"
    assert fit.adequacy is not None
    assert fit.adequacy.verdict is not CurveVerdict.INADEQUATE
    assert np.abs(fit.predict(at) - TRUTHS["sigmoid"](at)).max() < 1.5
    inverse = Inverse.of(fit, noise_sd=1.0)
    assert inverse(fit.predict(at)) == pytest.approx(at, abs=1e-5)
    assert np.isnan(inverse(np.asarray([0.0, 1e4]))).all()
    assert inverse(np.asarray([0.0, 1e4]), clamp=True) == pytest.approx(np.asarray(fit.x_range), abs=1e-6)
    assert Fusion.of([fit, each.fit("spline")]).evaluate(np.full((3, 2), 1650.0)).outside.tolist() == [False] * 3


def test_a_falling_spline_inverts_too() -> None:
    """The same sensor with a stage that does not invert."""
    each = session(lambda x: -TRUTHS["sigmoid"](x))
    fit = each.fit("spline")
    assert not fit.rises
    assert Inverse.of(fit)(fit.predict(each.grid_of_x)) == pytest.approx(each.grid_of_x, abs=1e-5)


def test_a_dead_zone_has_no_inverse() -> None:
    """The spline is flat where the sensor is: refused with the reason."""
    with pytest.raises(DataError, match="it is flat"):
        Inverse.of(session(TRUTHS["dead zone"]).fit("spline"))


def test_its_object_is_plain_and_has_no_coefficients() -> None:
    """JSON without coefficients; its checks run, no warning of rounding, and nothing is compared."""
    fit = session(CUBIC).fit("spline")
    content = json.loads(json.dumps(fit.as_json()))
    assert (content["curve"], content["coefficients"], content["monotone"]) == ("spline", [], True)
    assert fit_checks(fit)["preferred_degree"] == 3
    assert calibration_warnings(fit) == ()
    with pytest.raises(DataError, match="no coefficients"):
        compare_fits(content, content)


def test_band_of_the_spline_holds_a_sigmoid() -> None:
    """Over 12 sessions the 95 % band holds the truth in 85 % of the range or more: it is a little too smooth."""
    truth, inside = TRUTHS["sigmoid"], []
    for each in sessions(12, truth):
        low, high = each.fit("spline").band(each.grid_of_x)
        inside.append((low <= truth(each.grid_of_x)) & (truth(each.grid_of_x) <= high))
    assert np.mean(inside) >= 0.85
