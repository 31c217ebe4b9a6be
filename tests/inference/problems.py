"""Small problems with a known truth for the tests of the inference core; they are independent of any machine."""

import numpy as np
from scipy.stats import multivariate_normal

from pouring_robot.inference.evidence import ConditionalGram, Gram
from pouring_robot.inference.problem import Explanation, Problem

ROWS = 60


def explanation(effect, columns, form="plain", **given):
    return Explanation(effect, form, columns, np.ones(columns.shape[1], dtype=bool), **given)


def library(rng, rows=ROWS, count=8):
    """Return effects of one to four parameters, each with a second form that shares a column with the first."""
    found = []
    for k in range(count):
        columns = rng.normal(size=(rows, 1 + k % 4))
        other = np.hstack([columns[:, :1], rng.normal(size=(rows, 1))])
        found += [explanation(f"effect {k}", columns), explanation(f"effect {k}", other, "other")]
    return found


def planted(rng, items, sizes, noise=1.0):
    """Return the residual of some explanations at sizes in noise standard deviations (rms over the rows)."""
    total = noise * rng.normal(size=len(items[0].columns))
    for item, size in zip(items, sizes, strict=True):
        part = item.columns @ rng.normal(size=item.columns.shape[1])
        total = total + size * part / np.sqrt((part**2).mean())
    return total


def problem(residual, items, workmanship=(), free=None):
    return Problem.build(residual, np.zeros((len(residual), 0)) if free is None else free, workmanship, items)


def log_density(residual, *groups):
    """Return the log density of a residual whose covariance is the unit matrix and the groups' outer products."""
    covariance = np.eye(len(residual)) + sum((g @ g.T for g in groups), np.zeros((len(residual), len(residual))))
    return float(multivariate_normal(np.zeros(len(residual)), covariance).logpdf(residual))


def beside(groups, columns, residual):
    """Return inner products conditional on groups with unit coefficients, and the indices in them of columns (m, a)."""
    stacked = np.hstack([*groups, columns])
    count = stacked.shape[1] - columns.shape[1]
    seen = ConditionalGram(Gram.of([stacked], residual), np.arange(count), np.ones(count))
    return seen, np.arange(count, stacked.shape[1])
