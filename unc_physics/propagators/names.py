"""Which propagators there are, by name; a new one is a new file and a line in `BUILT_IN`.

Nothing is imported for it, so that a command line's help can list them at once. Other packages add theirs by
entry points in the group ``unc_physics.propagators``, each of which names a subclass of
`propagators.base.Propagator`.
"""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points

GROUP = "unc_physics.propagators"
#: Module and class of each propagator of this package: the paper's four methods, what they are measured by,
# and what goes past them.
BUILT_IN = {
    "linearization": "linearization:Linearization",
    "surrogate": "surrogate:Surrogate",
    "sigma_points": "sigma_points:SigmaPoints",
    "local_sampling": "local_sampling:LocalSampling",
    "monte_carlo": "monte_carlo:MonteCarlo",
    "cloud": "cloud:Cloud",
    "auto": "auto:Auto",
}
#: What takes the place of a propagator that is not named, in Python.
DEFAULT = "cloud"
#: Plain rollouts of drawn states, which a prediction is compared with; has the options ``samples`` and
# ``seed``.
REFERENCE = "monte_carlo"

#: Goes on until an error is small enough or a time is used up, and is what command line and node take where
# none is named; has the options ``error``, ``position_error``, ``rotation_error``, ``probability_error`` and
# ``time``.
ANYTIME = "auto"

#: By whose points the belief is found that a single nominal rollout begins with.
POINTS = "sigma_points"


def entries() -> dict[str, EntryPoint]:
    """Where each propagator is found: those of this package first, which none of the others replaces."""
    own = {name: EntryPoint(name, f"{__package__}.{place}", GROUP) for name, place in BUILT_IN.items()}
    others = sorted(entry_points(group=GROUP), key=lambda entry: entry.name)
    return own | {entry.name: entry for entry in others if entry.name not in own}
