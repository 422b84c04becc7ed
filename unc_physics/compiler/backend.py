"""Selection of the compiler: tuned for a tested numba, otherwise plain."""

from .versions import choose_tuned

TUNED = choose_tuned()

if TUNED:
    from .tuned.compilation import FOLDER, STAGE_OPTIONS, compile_function
else:
    from .plain import FOLDER, STAGE_OPTIONS, compile_function

__all__ = ["FOLDER", "STAGE_OPTIONS", "TUNED", "compile_function"]
