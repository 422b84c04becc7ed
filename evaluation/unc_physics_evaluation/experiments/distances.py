"""Distances of pieces beside those of the library coal or of a minimisation, and the time of contacts."""

from __future__ import annotations

import itertools
import time
from importlib.util import find_spec

import numpy as np
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from unc_physics.compiler import kernel
from unc_physics.compiler.arrays import empty
from unc_physics.shapes.columns import CONTACT, FRAME, POLYGON
from unc_physics.shapes.distance import distance_of_bodies, even_directions
from unc_physics.shapes.manifold import contacts_of_pieces
from unc_physics.shapes.pieces import Hull, Lathe, ball, box, capsule, cylinder, frustum, piece_arrays

from ..jobs import Job, Outcome, Row, Settings
from ..results import Results

TITLE = "Distances"
KINDS = "ball", "box", "capsule", "cylinder", "cone", "hull"
#: Kinds that coal does not have: their distances are found by a minimisation over directions. It also judges
#: where coal differs by more than `_SURE`.
OTHERS = "lathe", "sector"
#: Pairs whose contacts are timed: upper and lower piece, both 10 cm high.
TIMED = {
    "box on box": ("box", "box"),
    "can on table": ("cylinder", "table"),
    "can on can": ("cylinder", "cylinder"),
}
APART, OVERLAP, WRONG_SIGN = "error apart", "error of depths to 5 mm", "wrong sign"
_DEEPEST = 5e-3  # depth to which errors are agreed [m]
_SURE = 1e-6  # distance beyond which a sign counts [m]
_CLOSE = 1e-9  # of a gap to the one that is wanted [m]
_STARTS = 4  # of the minimisation
_GAPS = 0.05, 1e-2, 1e-3, 1e-4, 1e-6, 0.0, -1e-6, -1e-4, -1e-3, -4e-3


def jobs(settings: Settings) -> list[Job]:
    """Return a job for each pair of kinds, and one that measures times."""
    if not find_spec("coal"):
        return []
    compared = []
    for a, b in _pairs():
        judged_by_coal = b not in OTHERS
        count = (200 if settings.quick else 4762) if judged_by_coal else (5 if settings.quick else 40)
        cost = (3e-3 if judged_by_coal else 0.1) * count
        compared.append(Job("distances", settings.parameters(first=a, second=b, pairs=count), cost=cost))
    timed = [
        Job("distances", settings.parameters(first=lower, second=upper, pairs=0), alone=True)
        for upper, lower in TIMED.values()
    ]
    return [*compared, *timed]


def missing(_settings: Settings) -> list[str]:
    """Return how to get coal, if it is not installed."""
    return [] if find_spec("coal") else ["Distances need the library coal: pip install coal"]


def run(job: Job) -> Outcome:
    """Compare random pairs of two kinds, or measure times of a pair."""
    if job.parameters["pairs"] == 0:
        return Outcome(_times(job.parameters["first"], job.parameters["second"]))
    rng = np.random.default_rng(job.seed("poses"))
    apart, deep, wrong = 0.0, 0.0, 0
    for k in range(int(job.parameters["pairs"])):
        (own_a, coal_a), (own_b, coal_b) = (
            _shape(job.parameters["first"], rng),
            _shape(job.parameters["second"], rng),
        )
        frames = np.zeros((2, FRAME))
        frames[:, 3:] = [_rotation(rng).ravel(), _rotation(rng).ravel()]
        arrays = piece_arrays([[own_a], [own_b]])
        direction = rng.normal(size=3)
        if rng.random() < 0.3:
            direction = np.eye(3)[rng.integers(3)]
        direction /= np.linalg.norm(direction)
        along, wanted = 0.4, _GAPS[k % len(_GAPS)]
        for _ in range(8):
            frames[1, :3] = along * direction
            gap, found = distance_of_bodies(frames, arrays.pieces, arrays.rows, arrays.first)
            if abs(gap - wanted) < _CLOSE:
                break
            along -= (gap - wanted) / max(float(found[0] @ direction), 0.3)
        expected = coal_distance(coal_a, coal_b, frames) if coal_a and coal_b else np.nan
        if not abs(gap - expected) < _SURE:  # coal fails for some round pieces that overlap
            expected = minimised_distance(own_a, own_b, frames)
        error = abs(gap - expected)
        if max(gap, expected) > 0.0:
            apart = max(apart, error)
        elif min(gap, expected) > -_DEEPEST:
            deep = max(deep, error)
        wrong += gap * expected < 0.0 and min(abs(gap), abs(expected)) > _SURE
    return Outcome(
        [
            Row("pieces", APART, "m", apart),
            Row("pieces", OVERLAP, "m", deep),
            Row("pieces", WRONG_SIGN, "1", wrong),
        ]
    )


def report(results: Results) -> str:
    """Return tables of the largest errors and of times."""
    lines, compared = [], results.rows("distances")
    rows = compared.where(pairs=0)
    for a, b in _pairs():
        found = compared.where(first=a, second=b).where(quantity=APART)
        if found:
            both = compared.where(first=a, second=b)
            values = [both.where(quantity=quantity).mean() for quantity in (APART, OVERLAP, WRONG_SIGN)]
            lines.append([a, b, *(f"{1e6 * value:.3g}" for value in values[:2]), f"{values[2]:.0f}"])
    head = ["piece", "piece", "apart [um]", "overlapping by at most 5 mm [um]", "wrong signs"]
    text = results.table("distances", head, lines)
    lines = []
    for name, (upper, lower) in TIMED.items():
        found = rows.where(first=lower, second=upper)
        if found:
            own, other = (1e6 * found.where(method=method).mean() for method in ("pieces", "coal"))
            lines.append([name, f"{own:.2f}", f"{other:.2f}", f"{own / other:.2f}"])
    head = ["pair", "contacts [us]", "distance by coal, from Python [us]", "ratio"]
    return text + "\n" + results.table("distance_times", head, lines)


def _pairs():
    """Return all pairs of kinds; the second one is the kind that coal does not have."""
    return list(itertools.combinations_with_replacement((*KINDS, *OTHERS), 2))


def minimised_distance(a, b, frames) -> float:
    """Return the signed distance of two pieces at frames (2, 12): the widest gap along any direction [m]."""

    def gap(n):
        return -_reach(b, frames[1], -n) - _reach(a, frames[0], n)

    directions = even_directions(64)
    values = gap(directions)
    best = -np.inf
    for start in np.argsort(values)[-_STARTS:]:
        n = directions[start]
        for size in (0.1, 1e-2, 1e-4):  # a new simplex each time, as one of a ridge collapses
            u = np.cross(n, np.eye(3)[np.abs(n).argmin()])
            across = np.array([u, np.cross(n, u)])

            def turned(x, n=n, across=across):
                e = n + x @ across
                return e / np.linalg.norm(e)

            found = minimize(
                lambda x, turned=turned: -gap(turned(x)[None])[0],
                np.zeros(2),
                method="Nelder-Mead",
                options={
                    "initial_simplex": size * np.array([[0.0, 0.0], [1.0, 0.0], [0.3, 1.0]]),
                    "xatol": 1e-11,
                    "fatol": 1e-14,
                    "maxfev": 400,
                },
            )
            n = turned(found.x)
        best = max(best, -float(found.fun))
    return best


def _reach(piece, frame, n):
    """Return how far a piece reaches along unit vectors (k, 3), from the world's origin [m]."""
    b = n @ frame[3:].reshape(3, 3)
    if isinstance(piece, Hull):
        core = (b @ piece.points.T).max(axis=1)
    else:
        d = b @ piece.axes
        azimuth = np.arctan2(d[:, 1], d[:, 0]) - piece.azimuth
        away = np.abs((azimuth + np.pi) % (2.0 * np.pi) - np.pi)
        s = np.hypot(d[:, 0], d[:, 1]) * np.cos(np.maximum(away - piece.half_angle, 0.0))
        core = (s[:, None] * piece.profile[:, 0] + d[:, 2:] * piece.profile[:, 1]).max(axis=1)
        core += b @ piece.origin
    return core + piece.rounding + n @ frame[:3]


def coal_distance(a, b, frames) -> float:
    """Return the signed distance of two shapes of coal at frames (2, 12) [m]."""
    import coal

    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.gjk_tolerance = request.epa_tolerance = 1e-10
    request.gjk_max_iterations = request.epa_max_iterations = 1000
    poses = [coal.Transform3s(row[3:].reshape(3, 3), row[:3]) for row in frames]
    return coal.distance(a, poses[0], b, poses[1], request, result)


def _rotation(rng):
    """Return a random rotation matrix; in two of five cases with axes along edges and diagonals."""
    if rng.random() < 0.4:
        return Rotation.from_euler("xyz", 0.25 * np.pi * rng.integers(0, 8, 3)).as_matrix()
    return Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()


def _shape(kind, rng):
    """Return a piece of a kind, 2 to 12 cm large, and the same shape of coal; None if it has no such kind."""
    import coal

    a, b, c = rng.uniform(0.02, 0.12, 3)
    if kind in OTHERS:
        height = np.sort(rng.uniform(0.0, b, 4))
        radius = 0.5 * a * np.sqrt(1.0 - ((height - 0.5 * b) / b) ** 2)  # on an ellipse, thus convex
        if kind == "lathe":
            profile = np.column_stack([radius, height])
            return Lathe(profile, rng.choice([0.0, 0.004]), rng.normal(0.0, 0.01, 3), _rotation(rng)), None
        inner, half = rng.uniform(0.2, 0.8), rng.uniform(0.1, 1.5)
        profile = [[inner * a, 0.0], [a, 0.0], [a, b], [inner * a, b]]
        return Lathe(profile, azimuth=rng.uniform(0.0, 6.0), half_angle=half), None
    if kind == "hull":
        points = rng.normal(0.0, 0.04, (20, 3))
        corners = coal.StdVec_Vec3s()
        for point in points:
            corners.append(point)
        return Hull(points), coal.Convex.convexHull(corners, False, "")
    return {
        "ball": lambda: (ball(0.5 * a), coal.Sphere(0.5 * a)),
        "box": lambda: (box((a, b, c)), coal.Box(a, b, c)),
        "capsule": lambda: (capsule(0.3 * a, b), coal.Capsule(0.3 * a, b)),
        "cylinder": lambda: (cylinder(0.5 * a, b), coal.Cylinder(0.5 * a, b)),
        "cone": lambda: (frustum(0.5 * a, 0.0, b), coal.Cone(0.5 * a, b)),
    }[kind]()


def _times(lower, upper):
    """Return rows with the CPU time of a pair's contacts, and of coal's distance from Python [s]."""
    import coal

    made = {
        "box": (box((0.1, 0.1, 0.1)), coal.Box(0.1, 0.1, 0.1)),
        "table": (box((1.0, 1.0, 0.1)), coal.Box(1.0, 1.0, 0.1)),
        "cylinder": (cylinder(0.035, 0.1), coal.Cylinder(0.035, 0.1)),
    }
    frames = np.zeros((2, FRAME))
    frames[:, 3:] = np.eye(3).ravel()
    frames[1] = [0.01, 0.02, 0.1 + 1e-5, *Rotation.from_euler("z", 0.4).as_matrix().ravel()]
    arrays = piece_arrays([[made[lower][0]], [made[upper][0]]])
    count = 20_000
    contacts_many_times(2, frames, arrays.pieces, arrays.rows)
    own = _seconds(lambda: contacts_many_times(count, frames, arrays.pieces, arrays.rows)) / count
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    poses = [coal.Transform3s(row[3:].reshape(3, 3), row[:3]) for row in frames]
    first, second = made[lower][1], made[upper][1]

    def measure():
        for _ in range(count):
            result.clear()
            coal.distance(first, poses[0], second, poses[1], request, result)

    other = _seconds(measure) / count
    return [Row("pieces", "time", "s", own), Row("coal", "time", "s", other)]


def _seconds(function):
    """Return the least CPU time of three calls [s]."""
    times = []
    for _ in range(3):
        start = time.process_time()
        function()
        times.append(time.process_time() - start)
    return min(times)


@kernel
def contacts_many_times(count, frames, pieces, rows):
    """Write the contacts of pieces 0 and 1 so many times; return their number.

    Each time but the first begins at the normal of before, as in a simulation.
    """
    work, polygons, out = empty((12, 3)), empty((3, POLYGON, 3)), empty((16, CONTACT))
    n, total, known = (0.0, 0.0, 1.0), 0, False
    for _ in range(count):
        written, _, n = contacts_of_pieces(
            0,
            1,
            n,
            known,
            1e-3,
            (1.0, 0.0, 0.0),
            (0.0, 0.0, 0.0),
            frames,
            pieces,
            rows,
            work,
            polygons,
            out,
            0,
        )
        known, total = True, total + written
    return total
