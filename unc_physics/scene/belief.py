"""Belief about a scene's state: mean and covariance, before and after a prediction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..checks.array_field import Array, OptionalArray, array_field
from ..checks.errors import InvalidCovarianceError, InvalidRequestError, NotFiniteError
from ..checks.memory import require_memory
from ..checks.names import hint
from ..checks.validation import array, covariance, instance, non_negative, numbers, point, quaternion
from ..spatial.layout import (
    ANGULAR_VELOCITY,
    ERR_ANGULAR_VELOCITY,
    ERR_POSITION,
    ERR_ROTATION,
    ERR_VELOCITY,
    ERROR,
    POSITION,
    QUATERNION,
    STATE,
    VELOCITY,
)
from ..spatial.moments import pivoted_cholesky_of_blocks, second_moment, spread_states
from ..spatial.rotation import rotation_matrix
from .body_belief import BodyBelief
from .scene import Scene

#: Variance below which a direction counts as certain, over the largest variance of its scale.
RANK_TOLERANCE = 1e-14
#: Independent bodies above which draws are made block by block: fewer take less time together.
_MANY = 16
_ROUND_OFF = 1e-10  # share of a coordinate's own variance that a factor of larger scale leaves by round-off


@dataclass(frozen=True, eq=False)
class Belief:
    """Gaussian over the error state about a mean state.

    Attributes
    ----------
    mean : (B, 13) array
        State of each body, ``[p, v, q, omega]``: position of the centre of mass [m], velocity [m/s],
        quaternion (x, y, z, w) of ``R_world_body`` and angular velocity [rad/s]; all but q in the world
        frame.
    covariance : (M, 12, 12) or (12 M, 12 M) array
        Covariance of the error state ``[dp, dv, dtheta, domega]`` of the M moving bodies, with ``R = R_mean
        Exp(dtheta)``. Either one block for each body, if bodies are independent, or the joint matrix.
    moving : (M,) int64 array
        Indices of the bodies that move; by default all.

    Raises
    ------
    InvalidRequestError, NotFiniteError, InvalidOrientationError, InvalidCovarianceError
        For wrong shapes, NaN or infinity, quaternions far from unit length, or an invalid covariance.
    """

    mean: Array = array_field()
    covariance: Array = array_field()
    moving: OptionalArray = array_field(None)

    def __repr__(self) -> str:
        return f"<Belief with means of {len(self.mean)} and covariances of {len(self.moving)} bodies>"

    def __post_init__(self):
        mean = numbers(self.mean, "mean")
        mean = array(mean, (len(mean) if mean.ndim else 0, STATE), "mean").copy()
        for k in range(len(mean)):
            mean[k, QUATERNION] = quaternion(mean[k, QUATERNION], f"orientation of body {k}")
            point(mean[k, POSITION], f"position of body {k}")
        moving = np.arange(len(mean)) if self.moving is None else _ascending_indices(self.moving, len(mean))
        P = numbers(self.covariance, "covariance", InvalidCovarianceError)
        if P.ndim == 3:
            if len(P) != len(moving):
                raise InvalidCovarianceError(
                    f"must have {len(moving)} blocks, not {len(P)}", field="covariance"
                )
            blocks = [
                covariance(block, ERROR, f"covariance of body {moving[k]}") for k, block in enumerate(P)
            ]
            P = np.array(blocks).reshape(-1, ERROR, ERROR)
        else:
            P = covariance(P, ERROR * len(moving), "covariance")
        self._store(mean, P, moving)

    def _store(self, mean, P, moving):
        for field, value in (("mean", mean), ("covariance", P), ("moving", moving)):
            value.flags.writeable = False
            object.__setattr__(self, field, value)

    @classmethod
    def trusted(cls, mean, P, moving) -> Belief:
        """Return a belief that takes over arrays of a propagator without checking them."""
        belief = object.__new__(cls)
        belief._store(mean, P, moving)
        return belief

    @classmethod
    def of_errors(cls, mean: np.ndarray, errors: np.ndarray, moving: np.ndarray) -> Belief:
        """Return the belief with the second moments of equally probable errors (N, 12 M) about a mean.

        Blocks of single bodies are computed at once, the joint covariance when it is first used.
        """
        belief = object.__new__(cls)
        parts = errors.reshape(len(errors), len(moving), ERROR)
        blocks = [second_moment(np.ascontiguousarray(parts[:, k])) for k in range(len(moving))]
        values = {"mean": mean, "moving": moving, "blocks": np.array(blocks).reshape(-1, ERROR, ERROR)}
        for field, value in values.items():
            value.flags.writeable = False
            object.__setattr__(belief, field, value)
        object.__setattr__(belief, "_errors", errors)
        return belief

    if not TYPE_CHECKING:  # type checkers know all attributes

        def __getattr__(self, name):
            if name != "covariance" or "_errors" not in self.__dict__:
                raise AttributeError(f"'{type(self).__name__}' object has no attribute '{name}'")
            _require_joint_memory(len(self.moving))
            P = second_moment(self.__dict__["_errors"])
            P.flags.writeable = False
            object.__setattr__(self, "covariance", P)
            return P

    def with_mean(self, mean: np.ndarray) -> Belief:
        """Return the belief with another mean (B, 13), which is not checked."""
        belief = object.__new__(type(self))
        belief.__dict__.update(self.__dict__)
        mean.flags.writeable = False
        object.__setattr__(belief, "mean", mean)
        return belief

    @classmethod
    def exact(cls, mean: ArrayLike, moving: ArrayLike | None = None) -> Belief:
        """Return a belief without uncertainty."""
        count = len(np.asarray(mean if moving is None else moving))
        return cls(mean, np.zeros((count, ERROR, ERROR)), moving)

    @classmethod
    def of(cls, scene: Scene, bodies: Mapping[str, BodyBelief]) -> Belief:
        """Return a belief about a scene's bodies by name, independent between bodies.

        Parameters
        ----------
        scene : Scene
        bodies : mapping of str to BodyBelief
            One for each body of the scene, including fixed ones, in any order; none for prescribed bodies.

        Raises
        ------
        InvalidRequestError
            If a name is missing or not in the scene, or a fixed body moves or is uncertain.
        """
        instance(scene, Scene, "scene")
        instance(bodies, Mapping, "bodies")
        names = [body.name for body in scene.bodies]
        for name, given in bodies.items():
            if name not in names:
                raise InvalidRequestError(
                    f"is no body of the scene{hint(str(name), names)}", field=f"bodies[{name!r}]"
                )
            instance(given, BodyBelief, f"bodies[{name!r}]")
        states, blocks = [], []
        for body in scene.bodies:
            if body.trajectory is not None:
                if body.name in bodies:
                    raise InvalidRequestError(
                        "must be absent: its trajectory says where it is", field=f"bodies['{body.name}']"
                    )
                states.append(body.trajectory.states[0])
                continue
            if body.name not in bodies:
                raise InvalidRequestError(f"must have an entry for '{body.name}'", field="bodies")
            if body.fixed:
                try:
                    bodies[body.name].check_fixed()
                except InvalidRequestError as error:
                    raise error.at(f"{error.field} of body '{body.name}'") from None
            given = bodies[body.name].at_center_of_mass(body.model.origin)
            states.append(given.state)
            blocks += [given.covariance] if body.free else []
        belief = cls(np.array(states), np.array(blocks).reshape(-1, ERROR, ERROR), scene.moving)
        belief.check_fits(scene)
        return belief

    def with_common_pose_std(
        self, std: ArrayLike, origin: ArrayLike = (0.0, 0.0, 0.0), axes: ArrayLike | None = None
    ) -> Belief:
        """Return the belief with a pose error added that all moving bodies share, as of a camera.

        The error moves and turns all bodies together, so that their relative poses stay. Velocities turn with
        them.

        Parameters
        ----------
        std : (6,) array_like
            Standard deviations of the shared translation along the axes [m] and rotation about them [rad].
        origin : (3,) array_like
            Point about which the rotation turns, world frame [m].
        axes : (3, 3) array_like, optional
            Axes as columns, world frame; by default the world's axes.

        Returns
        -------
        Belief
            Belief with a joint covariance (12 M, 12 M); the same belief if all of ``std`` is zero.

        Raises
        ------
        InvalidCovarianceError
            If ``std`` is not six non-negative numbers.
        InvalidRequestError, NotFiniteError
        """
        field = "common_pose_std"
        if numbers(std, field, InvalidCovarianceError).shape != (6,):
            raise InvalidCovarianceError(
                "must be six numbers: three of the translation [m], three of the rotation [rad]",
                field=field,
                value=std,
            )
        std = array(std, (6,), field, InvalidCovarianceError)
        for k, value in enumerate(std.tolist()):
            non_negative(value, f"{field}[{k}]", InvalidCovarianceError)
        origin = array(origin, (3,), "common_pose_origin")
        axes = np.eye(3) if axes is None else array(axes, (3, 3), "axes")
        if not std.any():
            return self
        roots = np.zeros((len(self.moving), ERROR, 6))  # errors of one standard deviation each
        shifts, turns = axes * std[:3], axes * std[3:]
        with np.errstate(over="ignore", invalid="ignore"):
            for root, state in zip(roots, self.mean[self.moving], strict=True):
                root[ERR_POSITION, :3] = shifts
                root[ERR_POSITION, 3:] = np.cross(turns.T, state[POSITION] - origin).T
                root[ERR_VELOCITY, 3:] = np.cross(turns.T, state[VELOCITY]).T
                root[ERR_ROTATION, 3:] = rotation_matrix(state[QUATERNION]).T @ turns
                root[ERR_ANGULAR_VELOCITY, 3:] = np.cross(turns.T, state[ANGULAR_VELOCITY]).T
            roots = roots.reshape(-1, 6)
            P = self.joint + roots @ roots.T
        if not np.isfinite(P).all():
            raise NotFiniteError("is too large for a finite covariance", field=field, value=std.tolist())
        return Belief.trusted(self.mean, P, self.moving)

    @property
    def independent(self) -> bool:
        """Whether the covariance is stored as one block for each body."""
        return "_errors" not in self.__dict__ and self.covariance.ndim == 3

    @cached_property
    def joint(self) -> np.ndarray:
        """Joint covariance (12 M, 12 M) of all moving bodies."""
        if not self.independent:
            return self.covariance
        count = len(self.covariance)
        _require_joint_memory(count)
        joint = np.zeros((count, ERROR, count, ERROR))
        joint[np.arange(count), :, np.arange(count), :] = self.covariance
        return joint.reshape(count * ERROR, count * ERROR)

    @cached_property
    def blocks(self) -> np.ndarray:
        """Covariance (M, 12, 12) of each moving body."""
        if self.independent:
            return self.covariance
        count = len(self.moving)
        return self.covariance.reshape(count, ERROR, count, ERROR)[np.arange(count), :, np.arange(count), :]

    def marginal(self, body: int) -> np.ndarray:
        """Return the covariance (12, 12) of a body; zeros for a fixed one."""
        place = np.flatnonzero(self.moving == body)
        return self.blocks[place[0]] if len(place) else np.zeros((ERROR, ERROR))

    def root(self) -> np.ndarray:
        """Return a pivoted Cholesky factor (12 M, r) of the joint covariance; r is its rank.

        Variances may have several scales, as of millimetres beside an unknown height. Smaller ones are
        factored after the others, from the rest that these leave.
        """
        roots, numbers = self._factor
        found = np.zeros((*roots.shape[:2], self.rank))
        block, column = np.nonzero(numbers >= 0)
        found[block, :, numbers[block, column]] = roots[block, :, column]
        return found.reshape(ERROR * len(self.moving), self.rank)

    def sample(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Draw states (count, B, 13) from the belief; the first k are the same for every larger count."""
        require_memory(8.0 * count * (4 * self.mean.size + self.rank), f"{count} draws", "count", count)
        return self.states_along(rng.standard_normal((count, self.rank)))

    @cached_property
    def _factor(self):
        """Factors (M, 12, R) of the blocks, and which columns of `root` theirs are, (M, R), or -1.

        Of a joint covariance it is one block.
        """
        rest = self.covariance if self.independent else self.joint[None]
        variance = np.einsum("mii->mi", rest)
        # turning a direction without variance leaves a square of round-off
        least = np.maximum(_ROUND_OFF * variance, RANK_TOLERANCE**2 * variance.max(initial=0.0))
        left, roots, numbers, known = np.ones(variance.shape, bool), [], [], 0
        while left.any():
            rest = rest * (left[:, :, None] & left[:, None, :])
            root, number, rest = pivoted_cholesky_of_blocks(rest, RANK_TOLERANCE)
            roots.append(root)
            numbers.append(np.where(number < 0, -1, number + known))
            known += int((number >= 0).sum())
            left = np.einsum("mii->mi", rest) > least
        if not roots:
            return np.zeros((*variance.shape, 0)), np.zeros((len(variance), 0), int)
        return np.concatenate(roots, axis=2), np.concatenate(numbers, axis=1)

    @property
    def rank(self) -> int:
        """Rank of the joint covariance, the number of columns of `root`."""
        return int(self._factor[1].max(initial=-1)) + 1

    def states_along(self, z: np.ndarray) -> np.ndarray:
        """Return the states (N, B, 13) at ``z`` (N, rank) standard deviations along the columns of `root`."""
        if len(self.moving) <= _MANY or not self.independent:
            # einsum sums each row in a fixed order; BLAS would depend on the count and on threads
            errors = np.einsum("nr,kr->nk", z, self.root())
        else:
            roots, numbers = self._factor
            z = np.concatenate([z, np.zeros((len(z), 1))], axis=1)  # of columns that a block does not have
            parts = np.zeros((len(z), *roots.shape[:2]))
            for r, column in enumerate(numbers.T):
                parts += z[:, column, None] * roots[:, :, r]
            errors = parts.reshape(len(z), -1)
        return spread_states(self.mean.copy(), self.moving.copy(), errors)

    def check_fits(self, scene: Scene) -> None:
        """Raise `InvalidRequestError` unless the belief fits the bodies of ``scene``.

        Bodies at rest must have zero mean velocity.
        """
        if len(self.mean) != len(scene.bodies):
            raise InvalidRequestError(
                f"must describe as many bodies as the scene has, {len(scene.bodies)}, not {len(self.mean)}",
                field="belief",
            )
        if not np.array_equal(self.moving, scene.moving):
            raise InvalidRequestError(
                f"must have covariance for the scene's moving bodies, moving={scene.moving.tolist()}, not"
                f" for {self.moving.tolist()}; pass moving=scene.moving, or take Belief.of",
                field="belief",
            )
        for body, state in zip(scene.bodies, self.mean, strict=True):
            for name, place in (("angular_velocity", ANGULAR_VELOCITY), ("linear_velocity", VELOCITY)):
                if body.at_rest and state[place].any():
                    raise InvalidRequestError(
                        "must be zero, as the body is at_rest",
                        field=f"{name} of body '{body.name}'",
                        value=state[place].tolist(),
                    )


def _require_joint_memory(count):
    require_memory(
        8.0 * (ERROR * count) ** 2, "a joint covariance of all", "the number of moving bodies", count
    )


def _ascending_indices(values, count):
    """Return ascending indices of some of ``count`` bodies; the kernels rely on their range and order."""
    indices = numbers(values, "moving")
    if indices.ndim != 1 or np.any(indices != np.floor(indices)) or np.any(np.diff(indices) <= 0):
        raise InvalidRequestError(
            "must be ascending indices of bodies", field="moving", value=indices.tolist()
        )
    if len(indices) and not (indices[0] >= 0 and indices[-1] < count):
        raise InvalidRequestError(
            f"must be indices of {count} bodies", field="moving", value=indices.tolist()
        )
    return indices.astype(np.int64)
