from __future__ import annotations

import pytest

from elid_cli.model.effects.scene import Scene
from tests.model.effects.effect_scenes import planar, scene_of, spatial


@pytest.fixture(scope="session")
def planar_scene() -> Scene:
    return scene_of(planar())


@pytest.fixture(scope="session")
def spatial_scene() -> Scene:
    return scene_of(spatial())
