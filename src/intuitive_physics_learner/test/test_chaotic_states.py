"""Changes of states, how they are drawn again, and states at the end of a rollout."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics_learner.segmented_estimation.chaotic_states import (
    VELOCITY_STEP,
    change,
    drawn_again,
    moved,
    states_at,
)

MATERIALS = ("thing", "floor")
G = np.array([0.0, 0.0, -9.81])
FLOOR = Environment([Plane("floor", "floor", (0.0, 0.0, 1.0), 0.0)], gravity=G)


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 3.0))
def test_a_change_leads_from_one_state_to_the_other(seed, angle):
    """change(moved(x, d), x) = d for turns of less than half a revolution, and moved leads back."""
    generator = np.random.default_rng(seed)
    state = generator.normal(size=13)
    state[3:7] /= np.linalg.norm(state[3:7])
    asked = generator.normal(size=12)
    asked[3:6] *= angle / np.linalg.norm(asked[3:6])
    after = moved(state, asked)
    np.testing.assert_allclose(change(after, state), asked, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(after[3:7]), 1.0, rtol=1e-12)
    back = moved(after, change(state, after))
    np.testing.assert_allclose(back[[*range(3), *range(7, 13)]], state[[*range(3), *range(7, 13)]])
    np.testing.assert_allclose(abs(back[3:7] @ state[3:7]), 1.0, rtol=1e-12)


@given(st.integers(0, 2**32 - 1), st.integers(2, 40))
def test_motions_are_drawn_by_their_losses_and_failed_ones_never(seed, count):
    """Systematic resampling: a share w of N draws is drawn ⌊w N⌋ or ⌈w N⌉ times."""
    generator = np.random.default_rng(seed)
    losses = generator.exponential(3.0, (1, count))
    failed = np.zeros((1, count), dtype=bool)
    failed[0, generator.integers(count)] = True
    drawn = drawn_again(losses, failed, generator)[0]
    times = np.bincount(drawn, minlength=count)
    shares = np.where(failed[0], 0.0, np.exp(-losses[0] / 2.0))
    expected = count * shares / shares.sum()
    assert (np.abs(times - expected) <= 1.0 + 1e-9).all()
    assert times[failed[0]].sum() == 0


def test_states_of_a_free_flight_are_read_from_a_rollout(event_driven):
    """Over a step h a velocity errs by g h / 2, and a spin of constant axis by rounding."""
    thing = SceneObject("thing", "thing", Sphere(0.1))
    state = ObjectState(
        [0.0, 0.0, 5.0], linear_velocity=[1.0, 2.0, 3.0], angular_velocity=[4.0, -5.0, 6.0]
    )
    parameters = StaticParameters.uniform(MATERIALS)
    rollout = event_driven.rollout(
        [Scene(FLOOR, (thing,), (state,))], parameters, [0.2, 0.2 + VELOCITY_STEP]
    )
    ((read,),) = states_at(rollout, np.zeros(1, dtype=np.int64))
    np.testing.assert_allclose(read[:3], rollout.positions[0, 0, 0])
    velocity = state.linear_velocity + 0.2 * G
    np.testing.assert_allclose(read[7:10], velocity, atol=9.81 * VELOCITY_STEP)
    np.testing.assert_allclose(read[10:], state.angular_velocity, rtol=1e-4)
