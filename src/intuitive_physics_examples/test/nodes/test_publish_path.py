"""The example that publishes paths: as the prediction it heard, in messages of others."""

from __future__ import annotations

import sys
from pathlib import Path as FilePath

import numpy as np
import pytest
from geometry_msgs.msg import PoseArray
from intuitive_physics_msgs.msg import PredictedTrajectory, TrajectoryDistribution
from nav_msgs.msg import Path

from intuitive_physics.processes import ChildProcess
from intuitive_physics_ros.conversions import seconds_from_stamp, stamp_from_seconds
from intuitive_physics_ros.qos import STREAM
from intuitive_physics_ros.scripting import Peer

CLIENT = FilePath(__file__).parents[2] / "nodes" / "publish_path.py"
TIMES = np.array([0.0, 0.25, 0.5, 0.75])
SAMPLES = 5


def prediction() -> TrajectoryDistribution:
    """Two objects; sample s of the second one is at (t, s, 2) m."""
    message = TrajectoryDistribution(times=TIMES, sample_count=SAMPLES)
    message.header.frame_id, message.header.stamp = "lab", stamp_from_seconds(100.0)
    for k, name in enumerate(("first", "second")):
        samples = np.zeros((SAMPLES, TIMES.size, 3), dtype=np.float32)
        samples[..., 0], samples[..., 2] = TIMES, 1.0 + k
        samples[..., 1] = np.arange(SAMPLES)[:, None]
        message.objects.append(
            PredictedTrajectory(
                object_id=name, samples=samples.ravel(), mean=samples.mean(axis=0).ravel()
            )
        )
    return message


@pytest.mark.parametrize(("arguments", "height"), [((), 1.0), (("-p", "object:=second"), 2.0)])
def test_path_and_poses_are_those_of_the_prediction(arguments: tuple[str, ...], height: float):
    client = ChildProcess(
        [sys.executable, str(CLIENT), "--ros-args", "-p", "after:=0.3", *arguments]
    )
    try:
        with Peer("tester", 60.0) as peer:
            paths = peer.listen(Path, "intuitive_physics/path")
            poses = peer.listen(PoseArray, "intuitive_physics/sample_poses")
            publisher = peer.publisher(
                TrajectoryDistribution, "intuitive_physics/predictions", STREAM
            )

            def feed() -> None:
                publisher.publish(prediction())
                peer.spin_for(0.05)

            peer.spin_until(lambda: (paths and poses) or feed(), "a path")
    finally:
        assert client.stop() == 0
    assert "Traceback" not in client.output
    path, samples = paths[-1], poses[-1]
    assert path.header.frame_id == samples.header.frame_id == "lab"
    stamps = [float(seconds_from_stamp(pose.header.stamp)) for pose in path.poses]
    np.testing.assert_allclose(stamps, 100.0 + TIMES)
    places = [pose.pose.position for pose in path.poses]
    np.testing.assert_allclose([(p.x, p.y, p.z) for p in places], [(t, 2, height) for t in TIMES])
    assert all(pose.pose.orientation.w == 1.0 for pose in path.poses)
    # Nearest to 0.3 s after the start is 0.25 s.
    assert float(seconds_from_stamp(samples.header.stamp)) == 100.25
    np.testing.assert_allclose(
        [(p.position.x, p.position.y, p.position.z) for p in samples.poses],
        [(0.25, s, height) for s in range(SAMPLES)],
    )


def test_an_object_that_is_not_there_publishes_nothing() -> None:
    client = ChildProcess([sys.executable, str(CLIENT), "--ros-args", "-p", "object:=third"])
    try:
        with Peer("tester", 60.0) as peer:
            paths = peer.listen(Path, "intuitive_physics/path")
            publisher = peer.publisher(
                TrajectoryDistribution, "intuitive_physics/predictions", STREAM
            )
            peer.spin_until(lambda: publisher.get_subscription_count() > 0, "the example")
            for _ in range(20):
                publisher.publish(prediction())
                peer.spin_for(0.05)
            assert not paths
    finally:
        assert client.stop() == 0
    assert "Traceback" not in client.output
