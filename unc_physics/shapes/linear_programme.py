"""Small linear programmes by HiGHS, which is inside SciPy, without the checks that take most of `linprog`."""

from __future__ import annotations

import functools
from importlib import import_module

import numpy as np


def minimum(cost, rows, limits, low, high) -> tuple[np.ndarray, float] | None:
    """Return the x that minimises ``cost @ x``, and the minimum, or None if there is none.

    Parameters
    ----------
    cost, low, high : (n,) arrays
        ``x`` is from ``low`` to ``high``.
    rows, limits : (m, n), (m,) arrays
        ``rows @ x <= limits``.
    """
    options, core = _solver()
    if options is None:
        found = core.linprog(cost, rows, limits, bounds=np.column_stack([low, high]), method="highs")
        return (found.x, found.fun) if found.status == 0 else None
    column, row = np.nonzero(rows.T)
    lp = core.HighsLp()
    lp.num_row_, lp.num_col_ = lp.a_matrix_.num_row_, lp.a_matrix_.num_col_ = rows.shape
    lp.col_cost_, lp.col_lower_, lp.col_upper_ = cost, low, high
    lp.row_lower_, lp.row_upper_ = np.full(len(limits), -np.inf), limits
    lp.a_matrix_.format_ = core.MatrixFormat.kColwise
    lp.a_matrix_.start_ = np.searchsorted(column, np.arange(len(cost) + 1)).astype(np.int32)
    lp.a_matrix_.index_, lp.a_matrix_.value_ = row.astype(np.int32), rows[row, column]
    highs = core._Highs()  # a new one each time, as threads must not share it
    highs.passOptions(options)
    highs.passModel(lp)
    highs.run()
    if highs.getModelStatus() != core.HighsModelStatus.kOptimal:
        return None
    return np.array(highs.getSolution().col_value), highs.getInfo().objective_function_value


@functools.lru_cache(maxsize=1)
def _solver():
    """Return the options of `linprog` and the module of HiGHS; None and SciPy's for other versions."""
    try:
        core = import_module("scipy.optimize._highspy._core")
    except ImportError:  # before SciPy 1.15, or where it has moved
        return None, import_module("scipy.optimize")
    options = core.HighsOptions()
    options.presolve, options.output_flag, options.highs_debug_level = "on", False, 0
    options.simplex_strategy = int(core.simplex_constants.SimplexStrategy.kSimplexStrategyDual)
    return options, core
