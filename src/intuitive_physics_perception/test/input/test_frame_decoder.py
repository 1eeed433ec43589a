"""Messages to frames of points: whatever arrives, points or one clear error, and then on."""

from __future__ import annotations

from types import SimpleNamespace as Message

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_perception.input.camera import Intrinsics
from intuitive_physics_perception.input.frame_decoder import FrameDecoder

from .camera_infos import HEIGHT, WIDTH, info, region


def image(width=WIDTH, height=HEIGHT, **changes) -> Message:
    fields = {
        "width": width,
        "height": height,
        "encoding": "16UC1",
        "step": 2 * width,
        "is_bigendian": 0,
        "data": np.full(width * height, 2000, "<u2").tobytes(),
    }
    return Message(**{**fields, **changes})


def points_or_one_sentence(decode):
    """Return the shape of what is decoded, or "refused" where one clear sentence says why not."""
    try:
        return decode().shape
    except InvalidInputError as error:
        sentence = str(error)
    return "refused" if "expected" in sentence and len(sentence) < 600 else sentence


def test_an_image_needs_a_camera_and_takes_the_newest() -> None:
    decoder = FrameDecoder()
    with pytest.raises(InvalidInputError, match="without a CameraInfo"):
        decoder.image_points(image())
    for focal_length in (10.0, 40.0):
        decoder.take_camera(info(k=[focal_length, 0, 3.5, 0, focal_length, 2.5, 0, 0, 1]))
        points = decoder.image_points(image())
        assert points[0, 0, 0] == pytest.approx(-3.5 / focal_length * 2.0)


def test_a_rectified_image_has_the_camera_matrix_p_and_no_distortion() -> None:
    decoder = FrameDecoder(rectified=True)
    decoder.take_camera(info(d=[0.3, 0.0, 0.0, 0.0, 0.0]))
    assert decoder.image_points(image())[0, 0, 0] == pytest.approx(-3.5 / 20.0 * 2.0)


def test_a_wrong_camera_is_refused_and_the_one_before_stays() -> None:
    decoder = FrameDecoder()
    decoder.take_camera(info())
    with pytest.raises(InvalidInputError, match="focal length"):
        decoder.take_camera(info(k=np.zeros(9)))
    assert np.isfinite(decoder.image_points(image())).all()


def test_a_region_of_interest_looks_where_the_whole_image_does() -> None:
    whole, part = FrameDecoder(), FrameDecoder()
    terms = [0.1, -0.05, 0.001, -0.002, 0.01]
    whole.take_camera(info(d=terms))
    part.take_camera(info(d=terms, roi=region(2, 1, 4, 3)))
    expected = whole.image_points(image())[1:4, 2:6]
    assert part.image_points(image(4, 3)) == pytest.approx(expected, abs=1e-6)


def test_a_joined_pixel_looks_through_the_middle_of_its_pixels() -> None:
    whole, joined = FrameDecoder(), FrameDecoder()
    whole.take_camera(info())
    joined.take_camera(info(binning_x=2, binning_y=2))
    points = whole.image_points(image()).reshape(HEIGHT // 2, 2, WIDTH // 2, 2, 3)
    assert joined.image_points(image(WIDTH // 2, HEIGHT // 2)) == pytest.approx(
        points.mean(axis=(1, 3)), abs=1e-6
    )


@pytest.mark.parametrize(
    "changes",
    [
        {"roi": region(6, 0, 4, 4)},
        {"binning_x": 2, "binning_y": 1},
        {"roi": region(9, 0)},
        {"binning_x": 100, "binning_y": 100},
    ],
)
def test_a_part_that_the_image_does_not_have_is_refused(changes) -> None:
    with pytest.raises(InvalidInputError, match="expected"):
        FrameDecoder().take_camera(info(**changes))


def test_a_distortion_of_no_lens_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="cannot be inverted"):
        FrameDecoder().take_camera(info(d=[-8.0, 30.0, 0.0, 0.0, 0.0]))


def test_where_a_lens_cannot_be_inverted_nothing_is_read() -> None:
    # r (1 - 0.9 r²) has its largest value, 0.406, at r = 0.61: only the corners are beyond.
    camera = Intrinsics(64, 48, [90, 0, 31.5, 0, 90, 23.5, 0, 0, 1], [-0.9, 0, 0, 0])
    lost = np.isnan(camera.rays()).all(axis=2)
    x, y = np.meshgrid((np.arange(64) - 31.5) / 90, (np.arange(48) - 23.5) / 90)
    distance = np.hypot(x, y)
    limit = 2.0 / 3.0 / np.sqrt(3.0 * 0.9)
    assert not lost[distance < 0.9 * limit].any()
    assert lost[distance > limit].all()
    assert 0 < lost.sum() < 0.1 * lost.size


unsigned = st.integers(0, 12) | st.integers(0, 2**32 - 1)
number = st.floats() | st.sampled_from([0.0, 1.0, 10.0, -1.0, 1e-300, 1e300])


@settings(max_examples=300, deadline=None)
@given(
    st.fixed_dictionaries(
        {},
        optional={
            "width": unsigned,
            "height": unsigned,
            "k": st.lists(number, min_size=9, max_size=9),
            "d": st.lists(number, max_size=14),
            "distortion_model": st.sampled_from(["plumb_bob", "rational_polynomial", "", "é"]),
            "roi": st.builds(region, unsigned, unsigned, unsigned, unsigned),
            "binning_x": unsigned,
            "binning_y": unsigned,
        },
    ),
    st.fixed_dictionaries(
        {},
        optional={
            "width": unsigned,
            "height": unsigned,
            "step": unsigned,
            "encoding": st.sampled_from(["16UC1", "32FC1", "rgb8", ""]) | st.text(max_size=5),
            "is_bigendian": st.integers(0, 255),
            "data": st.binary(max_size=300),
        },
    ),
)
def test_any_camera_and_image_give_points_or_one_error_and_then_a_good_image_points(
    of_info, of_image
) -> None:
    decoder = FrameDecoder()
    message = Message(**{**vars(image()), **of_image})

    def decode():
        decoder.take_camera(info(**of_info))
        return decoder.image_points(message)

    assert points_or_one_sentence(decode) in ("refused", (message.height, message.width, 3))
    decoder.take_camera(info())
    assert np.isfinite(decoder.image_points(image())).all()
