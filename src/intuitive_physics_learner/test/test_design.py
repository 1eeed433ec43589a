"""Suggested throws tell what is asked; expected information is that of closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from intuitive_physics.errors import (
    InvalidInputError,
    SimulationStoppedError,
    UnknownNameError,
)
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.observation import Detections
from intuitive_physics.parameter_posterior import ParameterPosterior
from intuitive_physics.regions import HalfSpaceRegion
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation.stop_flag import StopFlag
from intuitive_physics.state import ObjectState
from intuitive_physics_learner import NoObservationsError
from intuitive_physics_learner.design import (
    AboutMotion,
    AboutParameters,
    ThrownObject,
    ThrowOptions,
    ViewingConditions,
    expected_information,
    suggest,
)
from intuitive_physics_learner.design.expected_information import (
    Reduction,
    expected_reductions,
)

FLOOR = Environment([Plane("floor", "floor", [0, 0, 1], 0.0)])
RADIUS = 0.05
BALL = SceneObject("ball", "ball", Sphere(RADIUS))
EVERYWHERE = np.array([[-100.0, 100.0]] * 3)
E, MU = "restitution[ball, floor]", "dynamic_friction[ball, floor]"
PERFECT = {"execution_error": 0.0, "draws": 1}
"""For throws that are made as meant, at one draw."""


def ranges(position, velocity, spin=(0.0, 0.0, 0.0)):
    """Ranges of no width."""
    return [np.stack([each, each], axis=1) for each in (position, velocity, spin)]


def thrown(position, velocity, deviations=(0.0, 0.0, 0.0, 0.0), spin=(0.0, 0.0, 0.0)):
    """Throw the ball in one way only."""
    covariance = np.diag(np.repeat(deviations, 3)) ** 2
    ball = ThrownObject(BALL, *ranges(position, velocity, spin), covariance)
    return ThrowOptions(FLOOR, ((ball,),))


def known(restitution_at, deviation=1e-4, materials=("ball", "floor")):
    """A posterior that knows restitution well, and nothing else."""
    start = LearnedParameters.defaults(materials).whole_posterior()
    mean, k = start.mean.copy(), start.space.names.index(E)
    mean[k] = restitution_at
    factor = np.zeros((1, mean.size))
    factor[0, k] = 1.0 / deviation
    return ParameterPosterior(materials, mean, factor)


def viewing(noise=0.002, count=45, rate=30.0, region=EVERYWHERE):
    return ViewingConditions(np.arange(count) / rate, noise, region)


def deviation_after(options, posterior, view, simulator, name=E):
    """Standard deviation, in widths, of one parameter after the only throw."""
    rng = np.random.default_rng(0)
    (throw,) = options.draw(1, rng)
    units = posterior.draw(1, rng)
    direction = np.eye(posterior.mean.size)[[posterior.space.names.index(name)]]
    ((_, reduction),) = expected_reductions(
        [throw], posterior, direction, units, view, simulator, 0.0, rng
    )
    return np.sqrt(reduction.variances[0, 0])


def test_information_of_a_drop_is_that_of_the_closed_form(event_driven):
    # From height h the ball meets the floor at t₁ = √(2h/g) with v = √(2gh) and is at
    # e v (t - t₁) - g (t - t₁)² / 2 above it until the second impact at t₁ + 2 e v / g; so a
    # detection then tells e with v (t - t₁) / σ. Before t₁ none depends on e.
    height, e, g, noise = 0.8, 0.8, 9.81, 0.003
    v, first = np.sqrt(2.0 * g * height), np.sqrt(2.0 * height / g)
    times = np.arange(0.0, first + 2.0 * e * v / g, 1.0 / 60.0)
    slopes = np.maximum(0.0, v * (times - first))
    # Bounds of e are 0 and 1, so widths are its unit; 1/12 is the variance of the bounds.
    deviation = 0.01
    expected = ((slopes**2).sum() / noise**2 + deviation**-2 + 12.0) ** -0.5
    got = deviation_after(
        thrown([0, 0, RADIUS + height], [0, 0, 0]),
        known(e, deviation),
        ViewingConditions(times, noise, EVERYWHERE),
        event_driven,
    )
    # The draw is within some 0.01 of 0.8, by which the times of both impacts do not change.
    np.testing.assert_allclose(got, expected, rtol=0.02)


def test_an_unknown_initial_state_takes_its_part_of_the_information(event_driven, monkeypatch):
    """The same by the Schur complement, of initial height and velocity that are free too."""
    monkeypatch.setattr(expected_information, "STATE_STEP", 1e-4)
    monkeypatch.setattr(expected_information, "PARAMETER_STEP", 1e-3)
    height, e, g, noise = 0.8, 0.8, 9.81, 0.003
    v, first = np.sqrt(2.0 * g * height), np.sqrt(2.0 * height / g)
    times = np.arange(0.0, first + 1.9 * e * v / g, 1.0 / 60.0)
    late = np.maximum(0.0, times - first)
    up = times > first
    # dz/dv₀: the impact is later by v₀ / g, and as fast to first order; before it t.
    # dz/dh: the impact is later by 1 / v and faster by g / v.
    by_height = np.where(up, e * g * late / v - (e * v - g * late) / v, 1.0)
    by_velocity = np.where(up, -(e * v - g * late) / g, times)
    slopes = np.stack([by_height, by_velocity, v * late], axis=1)
    # Joint estimation widens the priors of position and velocity tenfold.
    position, velocity, prior = 0.002, 0.01, 0.05
    precision = [(10 * position) ** -2, (10 * velocity) ** -2, prior**-2 + 12.0]
    expected = np.sqrt(np.linalg.inv(slopes.T @ slopes / noise**2 + np.diag(precision))[2, 2])
    got = deviation_after(
        thrown([0, 0, RADIUS + height], [0, 0, 0], (position, 0.0, velocity, 0.0)),
        known(e, prior),
        ViewingConditions(times, noise, EVERYWHERE),
        event_driven,
    )
    np.testing.assert_allclose(got, expected, rtol=0.1)


def test_the_fall_of_a_determinant_is_that_of_the_whole_matrices():
    generator = np.random.default_rng(0)
    root = generator.normal(size=(6, 6))
    covariance, directions = root @ root.T + np.eye(6), generator.normal(size=(4, 6))
    parameters = np.array([[0, 2, 5], [1, 2, 3]])
    # Some information on the three parameters of each throw.
    after = []
    for rows in parameters:
        information = np.zeros((6, 6))
        part = generator.normal(size=(3, 3))
        information[np.ix_(rows, rows)] = part @ part.T
        after.append(np.linalg.inv(np.linalg.inv(covariance) + information))
    small = np.array([whole[np.ix_(o, o)] for whole, o in zip(after, parameters, strict=True)])
    reduction = Reduction.of(covariance, directions, parameters, small)
    blur = 0.3
    for w, whole in enumerate(after):
        expected = directions @ whole @ directions.T
        np.testing.assert_allclose(reduction.variances[w], np.diag(expected))
        before = directions @ covariance @ directions.T
        fall = np.linalg.slogdet(before + blur**2 * np.eye(4))[1]
        fall -= np.linalg.slogdet(expected + blur**2 * np.eye(4))[1]
        np.testing.assert_allclose(reduction.determinant_fall(blur)[w], fall)


def gains(question, event_driven, ways, posterior=None, **how):
    """Expected information on a question of each of some ways to throw, nat."""
    results = []
    for position, velocity in ways:
        best = suggest(
            thrown(position, velocity, (0.002, 0.0, 0.05, 0.1)),
            posterior or LearnedParameters.defaults(("ball", "floor")).whole_posterior(),
            question,
            viewing(**how),
            event_driven,
            np.random.default_rng(1),
            candidates=1,
            execution_error=0.0,
            draws=16,
        )
        results.append(best[0].gain)
    return results


DROP = ([0, 0, 1.0], [0, 0, 0])
ROLL = ([0, 0, RADIUS], [0.4, 0, 0])
SLIDE = ([0, 0, RADIUS + 0.001], [4.0, 0, 0])


def test_drop_informs_restitution_and_slide_informs_friction(event_driven):
    drop, slide = gains(AboutParameters((E,)), event_driven, (DROP, SLIDE))
    assert drop > slide + 0.5
    drop, slide = gains(AboutParameters((MU,)), event_driven, (DROP, SLIDE))
    assert slide > drop + 0.3
    assert drop < 0.01
    rolling = AboutParameters(("rolling_friction[floor, ball]",))
    drop, roll = gains(rolling, event_driven, (DROP, ROLL))
    assert roll > drop + 0.5


def test_motion_out_of_view_informs_nothing(event_driven):
    # The floor itself is out of view, so that the track ends before the impact.
    region = np.array([[-1.0, 1.0], [-1.0, 1.0], [0.2, 2.0]])
    assert gains(AboutParameters((E,)), event_driven, (DROP,), region=region) == pytest.approx([0])


def test_more_noise_informs_less(event_driven):
    results = [
        gains(AboutParameters((E,), 1e-6), event_driven, (DROP,), known(0.8, 0.1), noise=noise)[0]
        for noise in (0.001, 0.004, 0.016)
    ]
    # Without a resolution that matters, four times the noise costs ln 4 once data outweigh priors.
    np.testing.assert_allclose(-np.diff(results), np.log(4.0), rtol=0.2)


def test_a_parameter_that_is_known_to_its_resolution_is_no_more_of_interest(event_driven):
    def gain(resolution):
        (best,) = suggest(
            thrown(*DROP),
            known(0.8, 0.005),
            AboutParameters((E,), resolution),
            viewing(),
            event_driven,
            np.random.default_rng(1),
            **PERFECT,
        )
        return best.gain

    assert gain(0.1) < 0.01
    assert gain(1e-4) > 1.0


def test_query_depends_on_relevant_parameters(event_driven):
    """The position after the first bounce depends on e, the position before on nothing."""
    state = ObjectState([0.0, 0.0, 0.5 + RADIUS])
    scene = Scene(FLOOR, (BALL,), (state,))
    drop, roll = gains(AboutMotion(scene, "ball", 0.6), event_driven, (DROP, ROLL))
    assert drop > roll + 0.5
    high = AboutMotion(scene, "ball", 0.9, HalfSpaceRegion([0.0, 0.0, -1.0], -0.6))
    assert gains(high, event_driven, (DROP, ROLL)) == pytest.approx([0.0, 0.0])
    assert gains(AboutMotion(scene, "ball", 0.2), event_driven, (DROP,)) == pytest.approx([0.0])


def test_the_answer_of_a_linear_motion_has_its_slope(event_driven):
    """At a time after the bounce a dropped ball is v (t - t₁) per unit of e higher."""
    height, g = 0.5, 9.81
    scene = Scene(FLOOR, (BALL,), (ObjectState([0.0, 0.0, height + RADIUS]),))
    first, v = np.sqrt(2 * height / g), np.sqrt(2 * g * height)
    slopes = AboutMotion(scene, "ball", first + 0.1).directions(
        known(0.7, 0.02), event_driven, np.random.default_rng(0)
    )
    (k,) = AboutParameters((E,)).indices(known(0.7).space.names)
    np.testing.assert_allclose(slopes[:, k], [0.0, 0.0, 0.1 * v], atol=1e-3)


WIDE = ThrowOptions(
    FLOOR,
    (
        (
            ThrownObject(
                BALL,
                [[-1, 1], [-1, 1], [-0.5, 1]],
                [[-3, 3], [0, 0], [-1, 1]],
                covariance=np.diag(np.repeat([0.002, 0.0, 0.05, 0.1], 3)) ** 2,
            ),
        ),
    ),
)


def test_the_same_generator_gives_the_same_suggestions_best_first(event_driven):
    def once(seed):
        return suggest(
            WIDE,
            known(0.6, 0.1),
            AboutParameters((E, MU)),
            viewing(),
            event_driven,
            np.random.default_rng(seed),
            count=5,
            candidates=24,
            draws=3,
        )

    first, other, third = once(0), once(0), once(1)
    assert [each.gain for each in first] == [each.gain for each in other]
    assert [each.gain for each in first] != [each.gain for each in third]
    assert [each.gain for each in first] == sorted((each.gain for each in first), reverse=True)
    assert len(first) == 5
    for each in first:
        assert (each.after <= each.before).all()
        assert each.throw.states[0].position[2] >= RADIUS


def test_can_be_cancelled(event_driven):
    flag = StopFlag()
    flag.set()
    with pytest.raises(SimulationStoppedError):
        suggest(
            WIDE,
            known(0.6),
            AboutParameters((E,)),
            viewing(),
            event_driven.stopped_by(flag),
            np.random.default_rng(0),
        )


finite = st.floats(-5.0, 5.0, width=32)
pair = st.tuples(finite, finite)


@settings(max_examples=40)
@given(st.lists(pair, min_size=9, max_size=9), st.integers(1, 12), st.integers(0, 2**32))
def test_throws_lie_within_their_ranges_and_outside_of_everything(ends, count, seed):
    wrong = any(low > high for low, high in ends)
    parts = ends[:3], ends[3:6], ends[6:]
    if wrong:
        with pytest.raises(InvalidInputError, match="expected lowest ≤ highest"):
            ThrownObject(BALL, *parts)
        return
    options = ThrowOptions(FLOOR, ((ThrownObject(BALL, *parts),),))
    if ends[2][1] < RADIUS:
        with pytest.raises(InvalidInputError, match="expected ranges in which objects are outside"):
            options.draw(count, np.random.default_rng(seed))
        return
    try:
        throws = options.draw(count, np.random.default_rng(seed))
    except InvalidInputError:
        # Hardly any of the range is above the floor.
        assert ends[2][0] < RADIUS
        return
    assert len(throws) == count
    for throw in throws:
        vector = throw.states[0].to_vector()
        values = np.concatenate([vector[0:3], vector[7:13]])
        low, high = np.array(ends).T
        assert (values >= low - 1e-12).all()
        assert (values <= high + 1e-12).all()
        assert values[2] >= RADIUS - 1e-9


def test_throws_of_observed_objects(throws):
    observations = throws(6, seed=0, noise=0.002, state_noise=0.002)
    options = ThrowOptions.of_observations(observations)
    ((ball,),) = options.casts
    states = np.array([each.objects[0].initial_state.to_vector() for each in observations])
    np.testing.assert_allclose(ball.position[:, 0], states[:, 0:3].min(axis=0))
    np.testing.assert_allclose(ball.linear_velocity[:, 1], states[:, 7:10].max(axis=0))
    view = ViewingConditions.of_observations(observations)
    np.testing.assert_allclose(view.times, np.arange(60) / 30.0, atol=1e-9)
    # Third differences of bounces count a little.
    assert view.noise == pytest.approx(0.002, rel=0.3)
    assert ThrowOptions.of_observations(observations, "ball").materials == ("ball", "floor")
    with pytest.raises(InvalidInputError, match=r"no object 'cup' was seen; expected .*: ball"):
        ThrowOptions.of_observations(observations, "cup")
    with pytest.raises(NoObservationsError, match="expected at least one throw"):
        ThrowOptions.of_observations([])


def test_noise_is_that_of_the_detections_where_there_are(throws):
    (observation,) = throws(1, seed=0, noise=0.002, state_noise=0.002)
    (ball,) = observation.objects
    track = ball.trajectory
    covariances = np.tile(0.004**2 * np.eye(3), (len(track), 1, 1))
    detections = Detections(track.times, track.positions, covariances, np.zeros((3, 3)))
    detected = replace(observation, objects=(replace(ball, detections=detections),))
    assert ViewingConditions.of_observations([detected]).noise == pytest.approx(0.004)


def test_names_of_parameters_are_read_in_either_order():
    names = known(0.5).space.names
    assert AboutParameters(("restitution[floor,ball]",)).indices(names) == [names.index(E)]
    with pytest.raises(UnknownNameError, match=r"parameter is 'restitution\[cup\]'; expected"):
        AboutParameters(("restitution[cup]",)).indices(names)
    with pytest.raises(InvalidInputError, match="each once"):
        AboutParameters((E, "restitution[floor, ball]")).indices(names)
    scene = Scene(FLOOR, (BALL,), (ObjectState([0.0, 0.0, 1.0]),))
    with pytest.raises(UnknownNameError, match="object is 'cup'"):
        AboutMotion(scene, "cup", 1.0)
