"""Files of others are measured before they are unpacked or parsed."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.limits import InputLimits, limits, use_limits
from intuitive_physics_recordings.bag_reader import BagReader
from intuitive_physics_recordings.depth_bag_writer import DepthBagWriter
from intuitive_physics_recordings.npz_file import load_arrays
from intuitive_physics_recordings.parameter_files import load_parameters, save_parameters

from .small_camera import SMALL


@pytest.fixture(autouse=True)
def own_limits():
    before = limits()
    yield
    use_limits(before)


def with_header(path, shape):
    """A file with one array whose header says so, and none of its numbers."""
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        file, {"shape": shape, "fortran_order": False, "descr": "<f8"}
    )
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("xyz.npy", file.getvalue())


def test_a_header_that_asks_for_terabytes(tmp_path):
    with_header(tmp_path / "large.npz", (10**9, 1000))
    with pytest.raises(InvalidInputError, match="asks for an array of shape"):
        load_arrays(tmp_path / "large.npz")


def test_an_archive_that_unpacks_to_much(tmp_path):
    use_limits(InputLimits(largest_unpacked=1_000_000))
    path = tmp_path / "bomb.npz"
    np.savez_compressed(path, xyz=np.zeros(200_000))
    assert path.stat().st_size < 10_000
    with pytest.raises(InvalidInputError, match="expected at most 1000000 bytes"):
        load_arrays(path)


@pytest.mark.parametrize("kind", ["<f8", "<i4", "|b1", "<U5"])
@pytest.mark.parametrize("shape", [(), (0,), (3,), (2, 3)])
def test_honest_files_are_read(tmp_path, kind, shape):
    path = tmp_path / "honest.npz"
    np.savez(path, one=np.zeros(shape, dtype=kind), other=np.asfortranarray(np.ones((4, 5))))
    arrays = load_arrays(path)
    assert arrays["one"].shape == shape
    np.testing.assert_array_equal(arrays["other"], np.ones((4, 5)))


@pytest.mark.parametrize("suffix", [".yaml", ".json"])
def test_parameter_files_are_measured_first(tmp_path, suffix):
    path = tmp_path / f"parameters{suffix}"
    save_parameters(LearnedParameters.defaults(["a", "b"]), path)
    load_parameters(path)
    use_limits(InputLimits(most_materials=1))
    with pytest.raises(InvalidInputError, match="materials: got 2, expected at most 1"):
        load_parameters(path)
    use_limits(InputLimits(longest_text=1000))
    with pytest.raises(InvalidInputError, match=f"bytes of {path}: got .* at most 1000 bytes"):
        load_parameters(path)
    use_limits(InputLimits())
    path.write_text("[" * 100_000)
    with pytest.raises(InvalidInputError, match="cannot read the parameters"):
        load_parameters(path)


def test_chunks_of_a_bag_say_what_they_unpack_to(tmp_path):
    with DepthBagWriter(tmp_path / "bag", SMALL) as writer:
        for i in range(100):
            writer.write(10**18 + i, np.zeros((6, 8), np.uint16))
    with BagReader(tmp_path / "bag") as bag:
        assert len(list(bag.messages())) == 200
    use_limits(InputLimits(largest_unpacked=1000))
    with pytest.raises(InvalidInputError, match="bytes of a chunk of the bag"):
        BagReader(tmp_path / "bag")


@pytest.mark.needs("rclpy")
@pytest.mark.parametrize(
    "name", ["os/msg/path", "os.path/msg/X", "../x/msg/Y", "std_msgs/msg/a", "std_msgs/msg/"]
)
def test_no_module_is_imported_that_is_no_package_of_messages(name):
    from intuitive_physics_recordings.nodes import replay_node

    assert replay_node._message_class(name) is None
    assert replay_node._message_class("std_msgs/msg/Header") is not None
