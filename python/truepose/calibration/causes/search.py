"""Search for the cause that explains a log: a wrong part, a mistake in columns or rows."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np

from truepose import _core
from truepose.arguments import Array, finite_rows
from truepose.calibration.bound import accuracy
from truepose.calibration.cause import Cause, Causes, Verdict
from truepose.calibration.causes import columns, outside, parts, rows
from truepose.calibration.causes.hypothesis import (
    GROSS,
    LN_RATE,
    WIDE,
    Case,
    Hypothesis,
    equations,
    evidence,
    lost,
)
from truepose.calibration.expectation import expect, poses_of
from truepose.calibration.fit import Calibration
from truepose.calibration.learnt import chi2_quantile
from truepose.exceptions import TrueposeError
from truepose.logs import Log
from truepose.robot import Robot, samples_or_home
from truepose.show import PRINT

#: Every cause by name; a new one is a generator of hypotheses and an entry here.
CAUSES: dict[str, Callable[[Case], Iterator[Hypothesis]]] = {
    **{kind: partial(parts.wrong, texts=texts) for kind, texts in parts.WRONG.items()},
    "homed again": parts.homed_again,
    "joint": parts.joint,
    "tolerances": parts.tolerances,
    "noise": parts.noise,
    "gain": columns.gain,
    "sign": columns.sign,
    "unit": columns.unit,
    "order": columns.order,
    "outside axes": outside.axes,
    "outside angles": partial(outside.nearer, made=outside.euler, share=1.0),
    "outside unit": partial(outside.nearer, made=outside.unit),
    "outside rows": partial(outside.nearer, made=outside.shifted),
    "common constant": columns.common,
    "shifted rows": rows.shifted,
    "stuck": rows.stuck,
    "slip": rows.slipped,
    "side": rows.sided,
    "gross errors": rows.gross,
    "lean": parts.leaning,
    "load": parts.load,
}
#: Probability of a consistent log below which causes are searched; below which one is unexplained.
DOUBT, REJECTED = 0.05, 1e-4
#: Odds that decide.
DECISIVE = math.log(100.0)
#: Mistakes that are fitted: the likeliest to first order; others that contradict readings least.
LIKELY, FITTED = 6, 10
#: These are only fitted above a share of the largest log odds to first order, less so much, and
#: above minus so much.
ROUGH, FAR, NEAR = 0.3, 150.0, 30.0
#: Rows by which these are compared; what each sensor counts in a row without a pose.
COMPARED, WORST = 24, 30.0
#: A log with more rows is searched by blocks of consecutive ones; then so many causes by all.
ROWS, BLOCK, AGAIN = 120, 12, 5
#: Iterations after which a hypothesis is given up: true ones need 4 to 7, 13 at most (119 logs);
#: more where the first number leaves a log unexplained.
QUICK, STEPS = 10, 25
#: Mistakes beside which a second one is searched, where one alone does not explain a log.
SECOND = 2
#: Sizes below so many σ are none.
SIGNIFICANT = 3.0
#: Causes that are kept.
SHOWN = 12
#: Mistakes that are always fitted.
ALWAYS = (
    *("stuck", "gross errors", "tolerances", "noise"),
    *("outside axes", "outside angles", "outside unit", "outside rows"),
)
#: Explanations that name no mistake.
VAGUE = ("tolerances", "noise", "correlated rows")
#: Ordinary explanations of a slip, as the core takes them: σ of independent errors over the stated
#: one, 1, correlation of consecutive rows, variance of errors that persist over theirs.
PERSISTING = np.array(
    [
        (noise, 1.0, *way)
        for way in [(0.0, 0.0), *product((0.5, 0.8, 0.95, 0.995), (0.5, 2.0, 8.0, 32.0, 128.0))]
        for noise in np.geomspace(0.5, 8.0, 9)
    ]
)


class Search(NamedTuple):
    """Causes, what explains the log best first, and the fit without any; None if that failed."""

    causes: Causes
    found: list[Explained]
    base: Calibration | None


def search(
    case: Case,
    *,
    base: Calibration | None = None,
    always: bool = False,
    progress: Callable[[float], None] = lambda _: None,
) -> Search:
    """Find the causes of a log's disagreement with a robot.

    Nothing is searched, unless `always`, where log, tolerances and noise agree. Gross errors are a
    cause, so that the loss is that of squares. Two mistakes are searched where one alone explains
    nothing. A long log is searched by some of its rows. `base` is the fit by squares where that is
    known. `progress` is called with the share done.
    """
    case = replace(case, options=replace(case.options, loss="squares"))
    none = case.nothing()
    base = base or none.fit()
    if base is not None and not always and consistent(base, DOUBT) and suspicion(base) < DECISIVE:
        return Search(Causes("none"), [], base)
    some, count = _some(case), len(case.log.readings)
    most = _equations(case.robot, case.log.only(some))
    begun = base if len(some) == count else none.fit(some)
    own = -GROSS * (most + case.robot.m * len(some))
    own = own if begun is None else evidence(begun, none, most)

    def explained(tried: list[Hypothesis], steps: int) -> list[Explained]:
        found = []
        progress(0.0)
        for k, of in enumerate(tried, 1):
            if (fit := of.fit(some, iterations=steps)) is not None:
                found.append(Explained(of, fit, evidence(fit, of, most) - own))
            progress(k / (len(tried) + 1))
        return found

    likely, rest = _tried(case)
    found = _once(explained(likely, QUICK))
    if _puzzling(found):
        left = [of for of in likely if all(of is not each.of for each in found)]
        found = _once([*found, *explained([*left, *rest], STEPS)])
    if _puzzling(found):
        # No mistake has no fit; but two mistakes explain any few rows.
        few = len(np.unique(case.log.readings, axis=0)) <= case.log.readings.shape[1]
        least = DECISIVE if begun or few else -math.inf
        causing = [each for each in found if not vague(each) and each.log_odds > least]
        for each in causing[:SECOND]:
            found += explained(_tried(each.of.case)[0], QUICK)
        found = _once(found)
    if len(some) < count:  # the most probable ones by every row
        found = [
            each._replace(fit=fit) for each in found[:AGAIN] if (fit := each.of.fit()) is not None
        ]
    if base is None and found and _nothing(found[0]):  # which had only not converged
        return Search(Causes("none"), [], found[0].fit)
    return _judged(base, _once([*found, *_persisting(case, base, found, some)]))


class Explained(NamedTuple):
    """A hypothesis, the calibration under it, and its log odds against no mistake."""

    of: Hypothesis
    fit: Calibration
    log_odds: float

    @property
    def cause(self) -> Cause:
        """The cause with its size."""
        said: dict[str, str] = {}
        size = None
        for mistake in self.of.each:  # a very wrong part may need its mistake twice to converge
            text, size = mistake.text, mistake.measured(self.fit)
            if mistake.size is not None and size is not None:
                factor, unit = PRINT[mistake.size.unit]
                text += f" {factor * size[0]:.4g} ± {factor * size[1]:.2g}{unit and f' {unit}'}"
            said[text] = mistake.kind
        value, sigma = size or (None, None)
        return Cause(
            kind=", ".join(said.values()),
            text=", and ".join(said),
            log_odds=self.log_odds,
            consistent=consistent(self.fit, REJECTED),
            size=value,
            sigma=sigma,
        )


def _nothing(found: Explained) -> bool:
    """Return whether a single mistake explains a log by a size that is none."""
    cause, size = found.cause, found.of.size
    if size is None or cause.size is None or cause.sigma is None or found.of.given.first:
        return False
    off = cause.size - (size.gain is not None)
    return cause.consistent and abs(off) < SIGNIFICANT * cause.sigma


def vague(found: Explained) -> bool:
    """Return whether an explanation names no mistake."""
    return found.of.kind in VAGUE


def _persisting(
    case: Case, base: Calibration | None, found: list[Explained], rows: Array
) -> list[Explained]:
    """Return errors that persist over rows as an explanation, where slips are the likeliest.

    The largest marginal likelihoods with a slip and without it are compared, both with such errors.
    """
    over = []
    rate = np.where(PERSISTING[:, 3] > 0, LN_RATE, 0.0)[:, None]
    if base is None:
        return []
    for each in found:
        slips = [slip for slip in each.of.each if slip.kind == "slip"]
        if each.log_odds < found[0].log_odds - DECISIVE or not slips:
            continue
        fit = each.of.fit(rows, keeps_rows=True)
        if fit is None or fit.rows is None:
            continue
        B, y, D, line, _, acting = fit.rows
        for slip in slips:
            k = acting[list(fit.influences).index(slip.influence)]
            rest, end = np.delete(B, k, axis=1), np.array([1])
            both = _core.weigh(rest, y, D, line, B[:, [k]], end, PERSISTING)
            over.append(float(np.diff((both + rate).max(axis=0))[0]) + slip.log_odds)
    text = "errors that persist from row to row, without a slip"
    of = replace(case.nothing(), text=text, kind="correlated rows")
    return [Explained(of, base, found[0].log_odds - max(over))] if over else []


def _puzzling(found: list[Explained]) -> bool:
    """Return whether the likeliest of some explanations is none."""
    return not found or vague(found[0]) or not found[0].cause.consistent


def _once(found: list[Explained]) -> list[Explained]:
    """Return explanations by their odds, of two mistakes in either order once."""
    found = sorted(found, key=lambda each: -each.log_odds)
    said = {frozenset((of.kind, of.text) for of in each.of.each): each for each in reversed(found)}
    return sorted(said.values(), key=lambda each: -each.log_odds)


def _some(case: Case) -> Array:
    """Return the rows that are searched: all, or blocks of consecutive ones of a long log."""
    count = len(case.log.readings)
    if count <= ROWS or case.differences:
        return np.arange(count)
    starts = np.linspace(0, count - BLOCK, ROWS // BLOCK).astype(int)
    return np.unique(starts[:, None] + np.arange(BLOCK))


def _equations(robot: Robot, log: Log) -> int:
    """Return the number of equations of a log beyond those that its poses take."""
    read = finite_rows(log.readings[:, : robot.m])
    values = [of[read] for of in (log.readings, log.measured) if of is not None]
    return int(np.isfinite(np.hstack(values)).sum() - robot.n * read.sum())


def consistent(fit: Calibration, probability: float) -> bool:
    """Return whether cost and rows of a fit are those of a correct model.

    The least cost, Σ d² plus the squared deviations from the prior in units of σ, has the χ²
    distribution of as many freedoms as there are equations, whatever the number of unknowns.
    """
    limit = chi2_quantile(1 - probability, max(equations(fit), 1))
    return lost(fit) == 0 and bool(fit.cost <= limit)


def suspicion(fit: Calibration) -> float:
    """Return the largest log odds of a parameter far beyond its tolerance, to first order.

    With more variance v of one parameter, ln (marginal likelihood) rises by
    ½ (g² v / (1 + v h) - ln (1 + v h)), g = [Σ₀⁻¹ (ξ̂ - μ)], h = [Σ₀⁻¹ - Σ₀⁻¹ Σ Σ₀⁻¹].
    """
    off = np.array([p.value - p.prior for p in fit.parameters.values()])
    inverse = np.linalg.inv(fit.prior_covariance)
    g = inverse @ off
    h = np.maximum(np.diag(inverse - inverse @ fit.covariance @ inverse), 0.0)
    v = WIDE**2 * np.diag(fit.prior_covariance)
    gain = (g**2 * v / (1 + v * h) - np.log1p(v * h)) / 2
    return float(gain.max(initial=-math.inf)) + LN_RATE


def _tried(case: Case) -> tuple[list[Hypothesis], list[Hypothesis]]:
    """Return the likeliest hypotheses to first order and those that contradict least; and more."""
    linear, likely, others = case.linear, list[Hypothesis](), list[Hypothesis]()
    first, columns = list[Hypothesis](), list[Array]()
    for of in (of for kind in CAUSES for of in _stated(kind, case)):
        by = linear.columns(of) if linear and of.kind not in ALWAYS else None
        if by is not None:
            first.append(of)
            columns.append(by)
        else:
            (likely if of.size or of.kind in ALWAYS else others).append(of)
    odds = np.array([of.log_odds for of in first])
    if linear:
        none, *own = linear.weigh(columns)[0]
        odds += np.array(own) - none
    none, *far = _contradictions(case, [case.nothing(), *others])
    rest = list[Hypothesis]()
    for some, by, count, share in (
        (first, -odds, LIKELY, ROUGH),
        (others, np.array(far) - none, FITTED, 1.0),
    ):
        limit = min(FAR + share * by.min(initial=0.0), NEAR)
        for k, at in enumerate(np.argsort(by, kind="stable")[: 2 * count]):
            (likely if k < count and by[at] < limit else rest).append(some[at])
    return likely, rest


def _stated(kind: str, case: Case) -> Iterator[Hypothesis]:
    """Yield the hypotheses of one cause, as far as the poses that they need have answers."""
    with contextlib.suppress(TrueposeError):
        if case.first is None or kind not in VAGUE:
            yield from (replace(of, kind=kind) for of in CAUSES[kind](case))


def _contradictions(case: Case, every: list[Hypothesis]) -> list[float]:
    """Return how far some rows are from the motors' prediction: -ln likelihood, of Cauchy errors.

    A row without a pose counts most.
    """
    m, readings, model = case.robot.m, case.log.readings, case.robot.expected().stiff
    read = np.flatnonzero(finite_rows(readings[:, :m]))
    rows = read[np.linspace(0, len(read) - 1, min(len(read), COMPARED)).astype(int)]
    usual = model.extended_positions(samples_or_home(model, 20), errors="nan")
    sigma = np.nanmedian(expect(case.robot, usual).sigma, axis=0) if model.r else np.zeros(0)
    result = []
    for of in every:
        given = of.given.only(rows)
        x = poses_of(model, given.log.readings[:, :m])
        expected = model.extended_positions(x, errors="nan")
        off = _core.innovation(model.core, given.log.readings, expected)[0][:, m:]
        each = np.nansum(np.log1p((off / sigma) ** 2), axis=1)
        each += WORST * max(model.r, 1) * np.isnan(x[:, 0])
        far = float(each.mean()) if len(rows) else 0.0
        if given.log.measured is not None:
            far += outside.View(given).distance(given.log.measured)
        result.append(far * len(readings) - of.log_odds - of.density)
    return result


def _judged(base: Calibration | None, found: list[Explained]) -> Search:
    """Return the verdict: the first cause must explain the log, and be likelier than any other."""
    if not found or found[0].log_odds < DECISIVE:
        agrees = base is not None and consistent(base, REJECTED)
        causes = tuple(each.cause for each in found[:SHOWN])
        return Search(Causes("none" if agrees else "unexplained", causes), found, base)
    best = found[0]
    near = [each for each in found if each.log_odds > best.log_odds - DECISIVE]
    same, other = [best], list[Explained]()
    for each in near[1:]:
        (same if _exchangeable(best, each) else other).append(each)
    found = same + other + found[len(near) :]
    causes = tuple(each.cause for each in found[:SHOWN])
    # A step at the middle is there to rival slips. Alone it may be backlash, or any smooth error.
    kinds = {of.kind for each in near for of in each.of.each}
    sided = "slip" not in kinds and any(of.kind == "side" for of in best.of.each)
    verdict: Verdict = "undecided" if other else "decisive"
    if not causes[0].consistent or any(map(vague, near)) or sided:
        verdict = "unexplained"
    where = None
    if verdict == "undecided" and not _alike(best.fit, other[0].fit):
        where = separating(best.fit, other[0].fit)
    return Search(Causes(verdict, causes, len(same), len(near), where), found, base)


def _exchangeable(first: Explained, second: Explained) -> bool:
    """Return whether two explanations are one to their user: by the same poses, later ones too.

    A step where the platform crosses the middle comes back there, a slip does not.
    """
    sided = ["side" in {of.kind for of in each.of.each} for each in (first, second)]
    return sided[0] == sided[1] and _alike(first.fit, second.fit)


def _alike(first: Calibration, second: Calibration) -> bool:
    """Return whether two calibrations give the same poses of the log, within their σ."""
    if first.x.shape != second.x.shape:
        return False
    off = first.x - second.x
    good = finite_rows(off)
    sigma2 = accuracy(first.robot, first.x[good], level=first.level, errors="nan")
    seen = finite_rows(sigma2)
    if not seen.any():
        return False
    off, inverse = off[good][seen], np.linalg.inv(sigma2[seen])
    return bool(np.einsum("ki,kij,kj->k", off, inverse, off).mean() < off.shape[1])


def separating(first: Calibration, second: Calibration) -> Array | None:
    """Return the pose of the workspace at which the readings of two robots differ most, in σ."""
    if first.robot.spec.workspace is None:
        return None
    x = samples_or_home(first.robot, 200)
    q = first.robot.ikm(x, errors="nan")
    rows = np.hstack([q, np.zeros((len(q), first.robot.r))])
    a, b = (expect(of.robot, rows) for of in (first, second))
    off = np.nan_to_num(np.abs(a.expected - b.expected) / np.hypot(a.sigma, b.sigma)).sum(axis=1)
    return np.asarray(x[off.argmax()]) if off.any() else None
