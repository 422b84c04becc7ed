"""Names of the propagators; a new one is a file and a line in `BUILT_IN`.

The list imports no propagator, so that the command line's help is fast. Other packages add propagators by
entry points in the group ``unc_physics.propagators``; each names a subclass of `propagators.base.Propagator`.
"""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points

GROUP = "unc_physics.propagators"
#: Module and class of each propagator of this package: the paper's methods with Monte Carlo, then others.
BUILT_IN = {
    "linearization": "linearization:Linearization",
    "surrogate": "surrogate:Surrogate",
    "sigma_points": "sigma_points:SigmaPoints",
    "local_sampling": "local_sampling:LocalSampling",
    "monte_carlo": "monte_carlo:MonteCarlo",
    "cloud": "cloud:Cloud",
    "auto": "auto:Auto",
}
#: Propagator with a fixed number of rollouts and a response surface through them.
SURFACE = "cloud"
#: Propagator for comparisons: plain rollouts of drawn states, with the options ``samples`` and ``seed``.
REFERENCE = "monte_carlo"
#: Default propagator. It adds rollouts until an error or a time limit is reached, and has the options
#: ``error``, ``position_error``, ``rotation_error``, ``probability_error`` and ``time``.
ANYTIME = "auto"
#: Propagator whose points give the initial belief of propagators with a single nominal rollout.
POINTS = "sigma_points"


def entries() -> dict[str, EntryPoint]:
    """Return the entry point of each propagator; those of this package come first and are never replaced."""
    own = {name: EntryPoint(name, f"{__package__}.{place}", GROUP) for name, place in BUILT_IN.items()}
    others = sorted(entry_points(group=GROUP), key=lambda entry: entry.name)
    return own | {entry.name: entry for entry in others if entry.name not in own}
