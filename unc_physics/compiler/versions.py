"""Tested versions of numba, and the choice between tuned and plain compilation."""

import logging
import os

import numba

#: All tests pass with these versions. `setup.py` also allows untested ones.
TESTED = ("0.68.1",)

#: Environment variable; its value `plain` selects plain compilation.
VARIABLE = "UNC_PHYSICS_COMPILER"


def choose_tuned() -> bool:
    """Return whether to use tuned compilation; log a warning if the numba version excludes it.

    Raises
    ------
    ValueError
        If the environment variable is neither empty nor `plain`.
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
