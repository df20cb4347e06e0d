"""A camera for tests of import nvisii, and what it looks at. Its fixture is in conftest.py."""

import numpy as np
import nvisii
import pytest


@pytest.fixture
def camera(client):
    """An initialized module with a camera at (0, -4, 0) that looks along +Y."""
    nvisii.initialize(headless=True, max_entities=3, address=client.address)
    eye = nvisii.entity.create(
        "eye", transform=nvisii.transform.create("eye"), camera=nvisii.camera.create("eye")
    )
    eye.get_transform().look_at(at=(0, 0, 0), up=(0, 0, 1), eye=(0, -4, 0))
    nvisii.set_camera_entity(eye)
    nvisii.set_dome_light_color((1, 1, 1))
    yield eye
    nvisii.deinitialize()
    vars(nvisii.settings.current).update(vars(nvisii.settings.Settings()))


def ball(name="ball", position=(0, 0, 0), radius=1.0, **look):
    return nvisii.entity.create(
        name,
        transform=nvisii.transform.create(name, position=position),
        mesh=nvisii.mesh.create_sphere(name, radius),
        material=nvisii.material.create(name, **look),
    )


def rows(flat, width, height):
    """(H, W, 4), row 0 at the top."""
    return np.array(flat).reshape(height, width, 4)[::-1]
