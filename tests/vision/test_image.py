import numpy as np
import OpenEXR
from numpy.testing import assert_array_equal

from palpate.vision.image import Layers, linear, over_background, read_layers, srgb, write_layers


def test_srgb_of_known_values_and_its_inverse():
    # IEC 61966-2-1: half of the light is 188, the linear toe is a factor of 12.92.
    assert_array_equal(srgb(np.array([-1, 0, 0.001, 0.5, 1, 7])), [0, 0, 3, 188, 255, 255])
    levels = np.arange(256)
    assert_array_equal(srgb(linear(levels / 255)), levels)


def test_background_shows_where_nothing_covers_it():
    combined = np.array([[0.2, 0.1, 0.0, 1.0], [0.1, 0.05, 0.0, 0.5], [0.0, 0.0, 0.0, 0.0]], dtype=np.float32)
    white = over_background(combined, (1, 1, 1))
    assert_array_equal(white, srgb(np.array([[0.2, 0.1, 0.0], [0.6, 0.55, 0.5], [1, 1, 1]])))
    clear = over_background(combined, None)
    assert_array_equal(clear[:, 3], [255, 128, 0])
    assert_array_equal(clear[0, :3], clear[1, :3])


def test_layers_survive_a_master(tmp_path):
    rng = np.random.default_rng(0)
    layers = Layers(*(rng.random((8, 8, *tail), dtype=np.float32) for tail in ((4,), (), ())))
    write_layers(tmp_path / "a.exr", layers)
    for back, there in zip(read_layers(tmp_path / "a.exr"), layers, strict=True):
        assert_array_equal(back, there)
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        assert_array_equal(file.channels()["ViewLayer.Combined.G"].pixels, layers.combined[..., 1])


def test_empty_layers_show_nothing():
    image = Layers.empty(4).image((1, 1, 1))
    assert (image.rgb == 255).all() and not image.mask.any() and np.isposinf(image.depth).all()
