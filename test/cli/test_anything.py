"""Anything at all, predicted: an answer of finite numbers, or one sentence."""

import warnings

import numpy as np
from example_scenes import CONTENTS, examples
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from unc_physics import UncPhysicsError, assess, predict
from unc_physics.scene.scene_file import scene_from_dict

SLOW = [HealthCheck.too_slow, HealthCheck.function_scoped_fixture, HealthCheck.filter_too_much]
STEPS = 3

edges = st.sampled_from(
    [0.0, -0.0, 1e-320, 1e-50, 1e-9, 1e-3, 0.5, 1.0, 2.0, 1e3, 1e6, 1e12, 1e30, 1e50, 1e150, 1e308, 5e-324]
)
numbers = st.one_of(
    edges, edges.map(lambda x: -x), st.floats(-2.0, 2.0), st.sampled_from(["1e-3", "nan", None])
)
vectors = st.lists(numbers, min_size=3, max_size=3)
SCENE_NUMBERS = ["dt", "stiffness", "damping", "friction", "restitution", "stiffness_std", "friction_std"]
SCENE_NUMBERS += ["restitution_std", "gravity_direction_std"]
BODY_NUMBERS = ["mass", "scale", "mass_std", "friction", "restitution", "friction_std", "restitution_std"]
BODY_VECTORS = ["position", "linear_velocity", "angular_velocity", "position_std", "orientation_std"]
BODY_VECTORS += ["linear_velocity_std", "angular_velocity_std", "center_of_mass_std"]


@st.composite
def extreme_scenes(draw):
    """A good scene with some numbers at the edge of what numbers can be."""
    content = CONTENTS[draw(st.sampled_from(["two_bodies", "everyday", "everyday"]))]()
    for _ in range(draw(st.integers(1, 3))):
        where = draw(st.integers(0, 3))
        if where == 0:
            content[draw(st.sampled_from(SCENE_NUMBERS))] = draw(numbers)
        elif where == 1:
            content["gravity"] = draw(vectors)
        else:
            body = content["bodies"][draw(st.integers(0, 1))]
            key = draw(st.sampled_from(BODY_NUMBERS if where == 2 else BODY_VECTORS))
            body[key] = draw(numbers if where == 2 else vectors)
    return content


def answer_or_sentence(content):
    """Predict a few steps; whether there was an answer."""
    try:
        scene, belief, _ = scene_from_dict(content)
        prediction = predict(scene, belief, "sigma_points", STEPS * scene.dt, max_computation_time=1.0)
        statuses = assess(prediction, rollouts=0)
    except UncPhysicsError as error:
        assert str(error).isprintable() and "np." not in str(error) and len(str(error)) < 1000
        return False
    for numbers in (prediction.belief.mean, prediction.belief.covariance):
        assert np.isfinite(numbers).all()
    for status in statuses:
        assert status.message.isprintable() and "nan" not in str(status.measures)
    return True


@settings(max_examples=examples(60), suppress_health_check=SLOW)
@given(extreme_scenes())
def test_numbers_at_the_edge_are_predicted_or_refused(content):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        answer_or_sentence(content)


# -- models ----------------------------------------------------------------------------------------

arrays = st.tuples(
    st.integers(0, 4), st.sampled_from([(3,), (), (1,)]), st.lists(numbers, min_size=12, max_size=12)
)


def as_array(drawn):
    """An array of drawn numbers; ones that are none become one."""
    rows, columns, values = drawn
    values = [value if isinstance(value, float) else 1.0 for value in values]
    size = int(np.prod((rows, *columns)))
    return np.resize(np.array(values), size).reshape(rows, *columns)


FIELDS = [
    "centers",
    "radii",
    "inertia",
    "volume",
    "origin",
    "bounding_radius",
    "mass",
    "bounds",
    "surface_gap",
]


@settings(max_examples=examples(100), suppress_health_check=SLOW)
@given(st.data())
def test_any_arrays_make_a_model_that_works_or_a_sentence(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("models") / "drawn.npz"
    values = {"centers": np.array([[0.0, 0, 0.03], [0, 0, -0.03]]), "radii": np.array([0.03, 0.02])}
    for field in data.draw(st.lists(st.sampled_from(FIELDS), max_size=3, unique=True)):
        kind = data.draw(st.integers(0, 2))
        if kind == 0:
            values[field] = as_array(data.draw(arrays))
        elif kind == 1:
            number = data.draw(edges)
            values[field] = np.full(np.shape(values.get(field, ())), number)
        else:
            values[field] = np.array(data.draw(st.sampled_from(["a\n", 7, True, 1j, [], [["x"]]])))
    np.savez(path, **values)
    content = CONTENTS["everyday"]()
    for body in content["bodies"]:
        body["model"] = str(path)
        del body["spheres"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        answer_or_sentence(content)
