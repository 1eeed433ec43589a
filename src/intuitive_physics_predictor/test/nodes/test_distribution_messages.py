"""A message carries a prediction, with the precision of float32."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st
from intuitive_physics_msgs.msg import TrajectoryDistribution
from rclpy.serialization import deserialize_message, serialize_message

from intuitive_physics.scene import Environment, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics_predictor.live.live_prediction import predict_scene
from intuitive_physics_predictor.live.settings import PredictionOptions, PredictionSettings
from intuitive_physics_predictor.nodes.distribution_messages import (
    COLUMNS,
    ROWS,
    DistributionWriter,
)

SETTINGS = PredictionSettings(PredictionOptions(position_noise=0.1))


def predicted(*, objects=1, times=2, samples=2, seed=0):
    """Predict balls beside each other in free flight."""
    balls = [SceneObject(f"ball {i}", "any", Sphere(0.05)) for i in range(objects)]
    states = [ObjectState((10.0 * i, 0.0, 0.0)) for i in range(objects)]
    return predict_scene(
        Scene(Environment(frame_id="lab"), balls, states),
        None,
        SETTINGS,
        0.125 * np.arange(times),
        seed=seed,
        sample_count=samples,
        start=5.25,
        environment_version=4,
    )


@given(
    objects=st.integers(1, 3),
    times=st.integers(1, 4),
    samples=st.integers(1, 5),
    most=st.integers(1, 5),
    seed=st.integers(0, 2**63 - 1),
)
def test_message_has_what_was_predicted(objects, times, samples, most, seed):
    made = predicted(objects=objects, times=times, samples=samples, seed=seed)
    sent = serialize_message(DistributionWriter().write(made, most))
    message = deserialize_message(sent, TrajectoryDistribution)
    distribution, kept = made.distribution, min(samples, most)
    assert message.header.frame_id == "lab"
    assert message.header.stamp == message.states_stamp == Time(sec=5, nanosec=250_000_000)
    assert (message.seed, message.environment_version) == (seed, 4)
    assert message.static_parameters_version == 0
    assert (message.sample_count, message.simulated_count) == (kept, samples)
    np.testing.assert_array_equal(message.times, distribution.times)
    np.testing.assert_allclose(message.weights, 1.0 / kept, rtol=1e-7)
    for i, trajectory in enumerate(message.objects):
        assert trajectory.object_id == distribution.object_ids[i]
        paths = np.reshape(trajectory.samples, (kept, times, 3))
        np.testing.assert_allclose(paths, distribution.positions[:kept, i], rtol=1e-7)
        mean = np.reshape(trajectory.mean, (times, 3))
        np.testing.assert_allclose(mean, distribution.mean[i], rtol=1e-7)
        triangle = np.reshape(trajectory.covariance, (times, 6))
        expected = distribution.covariance[i][:, ROWS, COLUMNS]
        np.testing.assert_allclose(triangle, expected, rtol=1e-7)


def test_writer_uses_its_memory_again_and_leaves_nothing_of_before():
    writer = DistributionWriter()
    first = writer.write(predicted(seed=1))
    memory = first.objects[0].samples.buffer_info()
    second = writer.write(predicted(seed=2))
    assert second.objects[0].samples.buffer_info() == memory
    assert second == DistributionWriter().write(predicted(seed=2))
    # Another number of samples takes another message.
    before = deepcopy(second)
    assert writer.write(predicted(samples=3)) == DistributionWriter().write(predicted(samples=3))
    assert second == before
