"""Versions of numba with which the tuned compilation is tested, and the choice between tuned and plain."""

import logging
import os

import numba

#: Each of these passes all tests. `setup.py` also admits versions that were not tested.
TESTED = ("0.68.1",)

#: Environment variable; the value `plain` selects the plain compilation.
VARIABLE = "UNC_PHYSICS_COMPILER"


def choose_tuned() -> bool:
    """Return whether kernels are compiled in the tuned way; log a warning if the numba version excludes it.

    Raises
    ------
    ValueError
        The environment variable has another value than `plain`.
    """
    wanted = os.environ.get(VARIABLE, "")
    if wanted not in ("", "plain"):
        raise ValueError(
            f"environment variable {VARIABLE}: {wanted!r} is not 'plain'; unset it or set 'plain'"
        )
    if wanted == "plain":
        return False
    if numba.__version__ in TESTED:
        return True
    logging.getLogger(__name__.partition(".")[0]).warning(
        "numba %s is not tested with unc_physics (tested: %s). Kernels compile several times slower;"
        " results agree within tolerances. Install a tested version for fast compilation.",
        numba.__version__,
        ", ".join(TESTED),
    )
    return False
