from __future__ import annotations

import pytest
from effect_scenes import planar, scene_of, spatial

from elid_cli.model.effects.effect import Scene


@pytest.fixture(scope="session")
def planar_scene() -> Scene:
    return scene_of(planar())


@pytest.fixture(scope="session")
def spatial_scene() -> Scene:
    return scene_of(spatial())
