"""θ_s at present covers all observed materials, and follows the store."""

import numpy as np
import pytest

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics_learner.store import CurrentParameters


def test_there_are_none_while_no_material_is_known(store):
    current = CurrentParameters(store)
    assert current.extended() is None
    assert current.version == 0


@pytest.fixture(scope="session")
def seen(glides):
    def make(material):
        return glides(np.random.default_rng(0), 0.5, materials=(material,), id=material)

    return make


def test_defaults_of_observed_materials_until_something_is_learned(store, seen):
    store.add(seen("ball"))
    current = CurrentParameters(store)
    assert current.extended().materials == ("ball", "floor")
    store.add(seen("cork"))
    assert current.read()
    assert not current.read()
    assert current.extended().materials == ("ball", "floor", "cork")
    assert current.extended().version == 0
    store.delete(["ball"])
    assert current.read()
    assert current.extended().materials == ("floor", "cork")


def test_only_newer_versions_are_taken_over(store, seen):
    current = CurrentParameters(store)
    assert not current.read()
    first = store.add_parameters(LearnedParameters.defaults(("ball", "floor")))
    assert current.read()
    assert not current.read()
    assert current.version == first.version
    store.add(seen("cork"))
    assert current.read()
    assert current.extended().materials == ("ball", "floor", "cork")
    assert current.extended().version == first.version
