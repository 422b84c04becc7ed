"""Tested versions of numba, and the choice between tuned and plain compilation."""

import logging
import os

import numba

#: All tests pass with these versions. `setup.py` also allows untested ones.
TESTED = ("0.68.1",)

#: Environment variable: `plain` selects plain compilation, and `off` makes each compilation an error.
VARIABLE = "UNC_PHYSICS_COMPILER"


def is_off() -> bool:
    """Return whether only kernels that are compiled already may run."""
    return os.environ.get(VARIABLE) == "off"


def choose_tuned() -> bool:
    """Return whether to use tuned compilation; log a warning if the numba version excludes it.

    Raises
    ------
    ValueError
        If the environment variable is neither empty, `plain` nor `off`; or if it is `off`, and kernels for
        this numba cannot exist.
    """
    wanted = os.environ.get(VARIABLE, "")
    if wanted not in ("", "plain", "off"):
        raise ValueError(
            f"environment variable {VARIABLE}: {wanted!r} is not 'plain' or 'off'; unset it or set one"
        )
    if wanted == "plain":
        return False
    if numba.__version__ in TESTED:
        return True
    if is_off():
        raise ValueError(
            f"environment variable {VARIABLE}: 'off' needs numba {' or '.join(TESTED)} (got"
            f" {numba.__version__}); unset it or install that version"
        )
    logging.getLogger(__name__.partition(".")[0]).warning(
        "numba %s is not tested with unc_physics (tested: %s). Kernels compile several times slower;"
        " results agree within tolerances. Install a tested version for fast compilation.",
        numba.__version__,
        ", ".join(TESTED),
    )
    return False
