"""The sky's model against tables and itself, without a daemon."""

import math

import numpy as np
import pytest
from heliograph.errors import InvalidArgument
from heliograph.values.sky import sky

LUMENS = 683 * np.array([0.2126, 0.7152, 0.0722])


def diffuse_illuminance(made):
    luminance = made.radiance @ LUMENS
    rows, columns = luminance.shape
    theta = np.pi * (np.arange(rows // 2) + 0.5) / rows
    weights = np.cos(theta) * np.sin(theta) * 2 * np.pi**2 / (rows * columns)
    return float((luminance[: rows // 2] * weights[:, None]).sum())


@pytest.mark.parametrize("degrees", [30, 60, 90])
def test_illuminance_is_that_of_a_clear_day(degrees):
    """IES Lighting Handbook, daylight availability, clear sky: direct 127.5 exp(-0.21 / sin h) klx,
    diffuse 0.8 + 15.5 sqrt(sin h) klx. Ours is cleaner air: a brighter sun, a darker sky."""
    made = sky(math.radians(degrees), width=64)
    sine = math.sin(math.radians(degrees))
    direct = float(made.sun_irradiance @ LUMENS)
    assert direct == pytest.approx(127.5e3 * math.exp(-0.21 / sine), rel=0.2)
    assert 0.5 < diffuse_illuminance(made) / (800 + 15500 * math.sqrt(sine)) < 1.1


def test_the_sun_reddens_and_the_sky_is_blue():
    noon, evening = sky(1.2, width=64), sky(math.radians(3), width=64)
    red, _, blue = noon.radiance[0].mean(0)
    assert blue > 2 * red
    ratio = [m.sun_irradiance[0] / m.sun_irradiance[2] for m in (noon, evening)]
    assert ratio[0] < 2 < 10 < ratio[1]
    night = sky(math.radians(-30), width=64)
    assert night.sun_irradiance.max() == 0
    assert night.radiance.max() < 1e-3 * noon.radiance.max()


def test_the_aureole_is_about_the_sun():
    elevation, azimuth = 0.5, 1.1
    made = sky(elevation, azimuth, width=256)
    rows, columns, _ = made.radiance.shape
    high = made.radiance[: rows * 3 // 8, :, 0]  # the horizon is bright, too
    y, x = np.unravel_index(high.argmax(), high.shape)
    phi, theta = (0.5 - (x + 0.5) / columns) * 2 * math.pi, math.pi * (y + 0.5) / rows
    assert abs(phi - azimuth) < 0.1
    assert abs(math.pi / 2 - theta - elevation) < 0.1
    x, y, z = made.sun_direction
    assert math.atan2(y, x) == pytest.approx(azimuth)
    assert math.asin(z) == pytest.approx(elevation)


def test_more_haze_more_scatters():
    clear, hazy = (sky(0.8, aerosol=a, width=64) for a in (1.0, 4.0))
    assert hazy.sun_irradiance.sum() < clear.sun_irradiance.sum()
    assert diffuse_illuminance(hazy) > diffuse_illuminance(clear)


@pytest.mark.parametrize(
    ("field", "arguments"),
    [("elevation", {"elevation": 2.0}), ("aerosol", {"aerosol": -1.0}), ("width", {"width": 30})],
)
def test_bad_input_is_refused(field, arguments):
    with pytest.raises(InvalidArgument, match=field):
        sky(**{"elevation": 0.5, **arguments})
