"""Nodes that are launched look for others on this machine, unless something else is said."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_bringup.connections import (
    PEERS,
    RANGE,
    RANGES,
    default_peers,
    default_range,
    discovery_environment,
)


def test_default_discovery_is_this_machine_or_that_of_the_environment(monkeypatch):
    for name in (RANGE, PEERS):
        monkeypatch.delenv(name, raising=False)
    assert discovery_environment(default_range(), default_peers()) == {
        RANGE: "LOCALHOST",
        PEERS: "",
    }
    monkeypatch.setenv(RANGE, "SUBNET")
    monkeypatch.setenv(PEERS, "192.168.1.7")
    assert discovery_environment(default_range(), default_peers()) == {
        RANGE: "SUBNET",
        PEERS: "192.168.1.7",
    }


@given(st.lists(st.ip_addresses().map(str), max_size=5), st.sampled_from(["localhost", "subnet"]))
def test_every_address_can_be_a_peer(addresses, wanted):
    peers = discovery_environment(wanted, " ; ".join(addresses))[PEERS]
    assert [one for one in peers.split(";") if one] == addresses


@given(st.text())
def test_invalid_peers_are_refused_or_harmless(text):
    try:
        peers = discovery_environment("localhost", text)[PEERS]
    except InvalidInputError:
        return
    assert set(peers) <= set("0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ.:-;")


@pytest.mark.parametrize(
    ("wanted", "peers", "complaint"),
    [
        ("everywhere", "", "discovery is 'everywhere'; expected one of localhost, subnet"),
        ("", "", "expected one of"),
        ("localhost", "a b", "peers has 'a b'; expected host names or addresses"),
        ("off", "robot.local", "looks for none of them"),
        ("system_default", "robot.local", "looks for none of them"),
    ],
)
def test_invalid_discovery_is_refused(wanted, peers, complaint):
    with pytest.raises(InvalidInputError, match=complaint):
        discovery_environment(wanted, peers)


@pytest.mark.parametrize("wanted", RANGES)
def test_every_discovery_range_is_one_of_ros(wanted):
    """ROS says on standard error what it does not know of these variables."""
    done = subprocess.run(
        [sys.executable, "-c", "import rclpy; rclpy.init(); rclpy.create_node('any')"],
        env={**os.environ, **discovery_environment(wanted, "")},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    assert "Invalid value" not in done.stdout + done.stderr
