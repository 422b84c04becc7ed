"""Jobs are told apart and seeded by what they compute."""

from functools import cache

import pytest

from unc_physics_evaluation.experiments import NAMES, experiment
from unc_physics_evaluation.jobs import Job, Row, Settings
from unc_physics_evaluation.results import ORIGIN


@cache
def jobs_of(name, quick, seed=0):
    return experiment(name).jobs(Settings(quick=quick, seed=seed))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("quick", [True, False], ids=["quick", "full"])
def test_keys_and_seeds_are_distinct(name, quick):
    jobs, settings = jobs_of(name, quick), Settings(quick=quick)
    assert jobs or experiment(name).missing(settings)  # the reason why there are none
    assert all(job.experiment == name and job.cost > 0.0 for job in jobs)
    assert len({job.key for job in jobs}) == len(jobs)
    assert len({job.seed("truth") for job in jobs}) == len(jobs)
    assert all(job.seed("truth") != job.seed("second") for job in jobs)
    assert not {*Row._fields, *ORIGIN} & {
        parameter for job in jobs for parameter in job.parameters
    }  # columns of one file


@pytest.mark.parametrize("name", NAMES)
def test_another_seed_is_another_sweep(name):
    here, there = (jobs_of(name, True, seed) for seed in (0, 1))
    assert not {job.key for job in here} & {job.key for job in there}
    assert not {job.seed("truth") for job in here} & {job.seed("truth") for job in there}


def test_seeds_stay_the_same_for_ever():
    """They are part of published results: neither the process nor the order of jobs may change them."""
    assert Job("collisions", {"model": "bunny", "sigma": 0.05}).seed("truth") == 3600630892
