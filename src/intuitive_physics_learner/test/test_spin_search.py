"""Fast spins are found where slopes do not lead, and nothing moves where all is explained."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation import make_simulator
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner import TrajectoryCost
from intuitive_physics_learner.joint_estimation.fit_horizons import RETREAT
from intuitive_physics_learner.joint_estimation.joint_fit import LARGEST_ADVANCE, JointFit
from intuitive_physics_learner.joint_estimation.spin_search import other_spins
from intuitive_physics_learner.joint_estimation.trajectory_model import TrajectoryModel

from .cases import task_of

FLOOR = Environment([Plane("floor", "floor", (0, 0, 1), 0.0)])
GRIPPY = StaticParameters.uniform(
    ["ball", "floor"],
    static_friction=0.9,
    dynamic_friction=0.9,
    rolling_friction=0.0,
    restitution=0.7,
)
RADIUS, GUESS, NOISE = 0.05, 10.0, 1e-3
TIMES = np.arange(1, 46) / 60.0
"""s; the ball hits the floor after 0.36 s, beyond the ten points that a fit begins with."""


def model_of(spin, parameters=GRIPPY, known=False):
    """A ball dropped 0.63 m onto the floor with a spin (3,) rad/s that is not seen."""
    ball, start = SceneObject("ball", "ball", Sphere(RADIUS)), (0.0, 0.0, RADIUS + 0.63)
    thrown = ObjectState(start, linear_velocity=(1.0, 0.0, 0.0), angular_velocity=spin)
    rollout = make_simulator("event_driven").rollout(
        [Scene(FLOOR, (ball,), (thrown,))], GRIPPY, TIMES
    )
    noisy = rollout.positions[0, 0] + np.random.default_rng(0).normal(0.0, NOISE, (TIMES.size, 3))
    believed = ObjectState(
        start,
        linear_velocity=(1.0, 0.0, 0.0),
        angular_velocity=spin if known else (0.0, 0.0, 0.0),
        covariance=np.diag(np.repeat([1e-8, 0.0, 1e-8, 0.0 if known else GUESS**2], 3)),
    )
    observed = [
        Observation(FLOOR, (ObservedObject(ball, Trajectory(TIMES, noisy), believed),), 0.0)
    ]
    cost = TrajectoryCost(observed, make_simulator("event_driven"))
    return TrajectoryModel(task_of(cost, parameters).fit_task, LARGEST_ADVANCE)


def other_spin(model):
    """The spin that is found to explain more, and up to when; None: there is none."""
    spins = other_spins(model, model.initial_estimate())
    if not spins:
        return None
    ((deviations, until),) = spins.values()
    return deviations[model.unknown_spins[0][0].places], until


@settings(max_examples=15)
@given(st.floats(-40.0, 40.0), st.floats(-40.0, 40.0), st.floats(-60.0, 60.0))
def test_a_bounce_that_sticks_leads_to_the_spin_along_its_plane(x, y, z):
    # It sticks where (2/7) |v + ω × r| < μ (1 + e) v_n: here (2/7) (1 + 0.05 · 57) < 5.4. After it
    # v' = (5 v + 2 r (ω_y, -ω_x)) / 7: an error of 1.5 rad/s is one of 21 mm/s, 8 mm at the end.
    estimate = other_spin(model_of((x, y, z)))
    if np.hypot(x, y) > 5.0:
        spin, until = estimate
        assert until == pytest.approx(TIMES[9] + RETREAT + LARGEST_ADVANCE)
        np.testing.assert_allclose(spin[:2], (x, y), atol=1.5)


def test_a_bounce_that_slips_leads_to_its_direction():
    # Slip (1 - r ω_y, r ω_x): of ω = (0, -150, 0) it is along x, and any faster spin does the same.
    share = np.array([0.1, 0.1, 1.0, 1.0])[:, None, None]
    model = model_of((0.0, -150.0, 0.0), replace(GRIPPY, coefficients=GRIPPY.coefficients * share))
    spin, _ = other_spin(model)
    assert spin[1] < 0.0


def test_where_all_is_explained_there_is_no_other_spin():
    assert other_spin(model_of((0.0, 0.0, 0.0))) is None


def test_known_spin_is_not_searched():
    assert other_spin(model_of((0.0, -40.0, 0.0), known=True)) is None


def test_a_fit_that_has_reached_the_end_is_left_alone():
    model = model_of((0.0, -40.0, 0.0))
    estimate = model.initial_estimate()
    estimate.fits[0].horizons = model.blocks[0].durations.copy()
    assert not other_spins(model, estimate)


def test_likelihood_is_of_the_spin_that_explains_more():
    # Before the bounce, where the fit begins, the spin moves nothing.
    model = model_of((0.0, -40.0, 0.0))
    fit = JointFit(model.task)
    ((alone,),) = (likelihood.spins for likelihood in fit.likelihoods())
    ((likelihood,),) = (likelihood.spins for likelihood in fit.likelihoods(look_for_spins=True))
    assert not alone.precision.any()
    # 0.36 s after the bounce, 1 mm and 21 points tell v' to 2 mm/s, so r ω to 7 mm/s.
    values, axes = np.linalg.eigh(likelihood.precision)
    assert values[1] > 1.0
    along = axes[:, 1:]
    spin = along @ (along.T @ likelihood.pull / values[1:])
    np.testing.assert_allclose(spin[:2], (0.0, -40.0), atol=1.5)
    # The fit itself stays where it was.
    assert not np.array(fit.state()["fits"][0]["estimate"]).any()
