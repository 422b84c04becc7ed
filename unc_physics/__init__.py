"""Rigid-body dynamics with uncertainty: predict where rigid objects will be, and how certain that is.

For example::

    from unc_physics import load_scene, predict
    scene, belief, horizon = load_scene("scene.yaml")
    prediction = predict(scene, belief, "sigma_points", horizon)
    prediction["mug"].position, prediction["mug"].position_std

The public interface is the names in ``__init__.pyi``; submodules are private.
"""

from __future__ import annotations

from .programs import let_programs_die, let_programs_use_one_blas_thread

let_programs_die()
let_programs_use_one_blas_thread()

__version__ = "0.3.0.dev0"


def _homes():
    """Return the module of each public name."""
    import ast
    from pathlib import Path

    stub = ast.parse(Path(__file__).with_name("__init__.pyi").read_text(encoding="utf-8"))
    imports = [statement for statement in stub.body if isinstance(statement, ast.ImportFrom)]
    return {name.name: f".{statement.module}" for statement in imports for name in statement.names}


_HOMES = _homes()
__all__ = list(_HOMES)  # pyright: ignore[reportUnsupportedDunderAll]


def __dir__() -> list[str]:
    """Return all public names, including names not imported yet."""
    return sorted({*globals(), *__all__})


def __getattr__(name):
    """Import a public name on first use; importing numba takes a second, which `--help` avoids."""
    from importlib import import_module

    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name], __name__), name)
    globals()[name] = value
    return value
