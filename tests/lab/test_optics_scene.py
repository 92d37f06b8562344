"""Rendered frames agree with the parameters of the optics: transmission, blur, noise, full scale and uneven light."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import erf

from eimi_lab.config.simulated_optics import Optics
from eimi_lab.virtual.optics import expose, make_scene, render

SIZE = (200, 160)
FLAT = Optics(vignette=0.0, gradient=0.0)
BEAM = [[80.25, 40.0], [120.25, 40.0], [120.25, 130.0], [80.25, 130.0]]
MAGNET = [[80.25, 110.0], [120.25, 110.0], [120.25, 130.0], [80.25, 130.0]]
CLAMP = [[40.0, -5.0], [160.0, -5.0], [160.0, 40.0], [40.0, 40.0]]


def test_light_silicone_magnet_and_clamp_have_their_transmissions():
    mean = make_scene(FLAT, SIZE, BEAM, MAGNET, CLAMP).mean / 255
    assert mean[80, 20] == pytest.approx(0.85, rel=1e-5)
    assert mean[80, 100] == pytest.approx(0.85 * 0.06, rel=1e-5)
    assert mean[120, 100] == pytest.approx(0.85 * 0.01, rel=1e-5)
    assert mean[20, 100] == pytest.approx(0.0, abs=1e-6)


def test_an_edge_has_the_shape_of_the_blur():
    scene = make_scene(replace(FLAT, blur_px=1.5), SIZE, BEAM, oversampling=4)
    row = scene.mean[80, 60:100] / (255 * 0.85)
    # Integration over the square pixel adds 1/12 to the variance of the blur.
    wide = np.sqrt(2.0 * (1.5**2 + 1.0 / 12.0))
    expected = 0.06 + 0.94 * 0.5 * (1.0 - erf((np.arange(60, 100) - 80.25) / wide))
    np.testing.assert_allclose(row, expected, atol=1e-3)


def test_no_light_is_transmitted_where_outlines_meet():
    sharp = replace(FLAT, blur_px=0.0)
    at_clamp = make_scene(sharp, SIZE, [[80, 40.2], [120, 40.2], [120, 130], [80, 130]], None, np.add(CLAMP, [0, 0.2]))
    behind = make_scene(sharp, SIZE, [[80, 10.0], [120, 10.0], [120, 130], [80, 130]], None, np.add(CLAMP, [0, 0.2]))
    # If the clamp and a side of the beam share one pixel, their coverages do not determine how they overlap.
    apart = np.delete(np.arange(SIZE[0]), [80, 120])
    np.testing.assert_allclose(at_clamp.mean[:, apart], behind.mean[:, apart], atol=1e-3)
    assert at_clamp.mean[38:44, 100].max() <= 255 * 0.85 * 0.06 + 1e-3
    edge = make_scene(sharp, SIZE, BEAM, MAGNET).mean[120, 80] / (255 * 0.85)
    assert edge == pytest.approx(0.75 + 0.25 * 0.01, abs=1e-4)


def test_noise_is_the_shot_noise_of_electrons():
    optics = replace(FLAT, bits=12, full_well_e=5000.0)
    scene = make_scene(optics, SIZE, BEAM)
    rng = np.random.default_rng(5)
    frames = np.array([expose(scene, rng)[60:100, 5:60] for _ in range(30)]) / 4095 * 5000
    assert frames.dtype == np.float64
    assert frames.mean() == pytest.approx(0.85 * 5000, rel=1e-3)
    assert frames.var(axis=0, ddof=1).mean() == pytest.approx(0.85 * 5000, rel=0.02)


@pytest.mark.parametrize(("bits", "dtype"), [(8, np.uint8), (12, np.uint16), (16, np.uint16)])
def test_values_above_full_scale_are_clipped_and_never_wrap(bits, dtype):
    frame = render(replace(FLAT, background=1.5, bits=bits), SIZE, np.random.default_rng(0), BEAM, None, CLAMP)
    assert frame.dtype == dtype
    assert frame[80, 20] == 2**bits - 1
    assert frame[20, 100] == 0


def test_uneven_light_has_the_given_brightness_at_its_brightest_point():
    uneven = make_scene(Optics(vignette=0.15, gradient=0.25, lumps=0.08), SIZE, BEAM).mean / 255
    assert uneven.max() == pytest.approx(0.85, rel=1e-3)
    assert uneven[-1, -1] < 0.75 * 0.85
    plain = make_scene(FLAT, SIZE, BEAM).mean
    assert not np.allclose(uneven * 255 / plain, (uneven * 255 / plain)[80, 20], atol=0.05)


def test_equal_seeds_give_equal_frames():
    first, second = (render(Optics(), SIZE, np.random.default_rng(7), BEAM) for _ in range(2))
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize(
    ("field", "value"),
    [("vignette", 1.0), ("silicone_transmission", -0.1), ("full_well_e", 0.0), ("blur_px", -1.0), ("bits", 7)],
)
def test_impossible_optics_are_refused(field, value):
    with pytest.raises(ValueError, match=field):
        Optics(**{field: value})
