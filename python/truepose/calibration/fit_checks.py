"""Checks of a log against a geometry that was fitted to it."""

from __future__ import annotations

import numpy as np

from truepose.calibration.departure import chi2_quantile
from truepose.calibration.fit import Calibration
from truepose.logs import Log


def left_out(fit: Calibration, log: Log) -> list[str]:
    """Lines whose motors were read and that the calibrated robot cannot reach, by the reason."""
    read = np.isfinite(log.readings[:, : fit.robot.n]).all(axis=1)
    reasons = dict.fromkeys(fit.status[read & (fit.status != "ok")].tolist())
    return [
        f"{log.at(np.flatnonzero(read & (fit.status == reason)))}: left out: by the calibrated "
        f"robot {reason}"
        for reason in reasons
    ]


def review(fit: Calibration, log: Log) -> list[str]:
    """Outliers, lines left out, what was learnt: a line of text each."""
    findings = left_out(fit, log)
    if len(outliers := fit.outliers):
        by_size = outliers[np.argsort(-fit.chi2[outliers])]
        many = "s" * (len(outliers) > 1)
        findings.append(f"{log.at(by_size)}: {len(outliers)} outlier{many}, worst first")
    counted = (fit.weights >= 0.1) & (fit.redundancy > 0)
    if counted.any():
        usual = chi2_quantile(0.5, fit.redundancy[counted])
        apart = np.sqrt(np.median(fit.chi2[counted] / usual))
        if apart > 2:
            findings.append(
                f"the readings disagree by {apart:.1f} times their noise (median) whatever the "
                "geometry: a level, a tolerance or a sensor's noise is not as the file says"
            )
    far = [
        f"{name} by {abs(p.value - p.prior) / p.prior_sigma:.1f} σ"
        for name, p in fit.parameters.items()
        if abs(p.value - p.prior) > 4 * p.prior_sigma
    ]
    if far:
        findings.append(f"further from the drawing than tolerances allow: {', '.join(far[:5])}")
    if all(p.verdict == "not identified" for p in fit.parameters.values()):
        findings.append("no parameter is known noticeably better than before")
    return findings
