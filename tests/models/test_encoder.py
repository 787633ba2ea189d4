"""The image encoder: sizes and receptive fields against what a real pass gives, and its errors."""

from dataclasses import replace

import pytest
import torch

from palpate.architectures import PAPER_ARCHITECTURES, Encoder
from palpate.models.encoder import NORMS, ImageEncoder, ReadingEncoder
from tests.models.batches import SMALL


@pytest.mark.parametrize("name", [name for name in PAPER_ARCHITECTURES if name != "touch"] + ["small"])
@pytest.mark.parametrize("size", [256, 137])
@pytest.mark.parametrize("downsample", [1, 2])
def test_sizes_are_those_of_a_real_pass(name, size, downsample):
    options = Encoder(**SMALL["encoder"]) if name == "small" else PAPER_ARCHITECTURES[name].encoder
    encoder = ImageEncoder(replace(options, downsample=downsample)).eval()
    try:
        sizes = encoder.sizes(size)
    except ValueError:
        with pytest.raises(RuntimeError):
            encoder(torch.rand(1, 3, size, size))
        return
    with torch.no_grad():
        maps = encoder(torch.rand(1, 3, size, size))
    assert [tuple(features.shape[1:]) for features in maps] == [
        (channels, edge, edge) for channels, edge in zip(encoder.channels, sizes, strict=True)
    ]


def test_a_downsampled_image_is_the_mean_of_its_squares():
    encoder = ImageEncoder(Encoder([4], [1], [1], padding=1, downsample=2)).eval()
    image = torch.rand(1, 3, 8, 8)
    small = (image[..., ::2, :] + image[..., 1::2, :]) / 2
    small = (small[..., ::2] + small[..., 1::2]) / 2
    torch.testing.assert_close(encoder(image)[0], encoder.layers[0](small))


def test_only_the_first_layer_of_a_block_has_a_stride():
    encoder = ImageEncoder(Encoder([4, 8], [3, 2], [3, 5]))
    assert [layer[0].stride[0] for layer in encoder.layers] == [2, 1, 1, 2, 1]
    assert [layer[0].out_channels for layer in encoder.layers] == [4, 4, 4, 8, 8]


@pytest.mark.parametrize(
    ("channels", "layers", "pool", "message"),
    [
        ([4, 8], [3], [3], "must be as many"),
        ([4, 0], [3, 1], [4], "positive"),
        ([4], [3], [], "must rise within the layers 1 to 3"),
        ([4], [3], [3, 2], "must rise"),
        ([4], [3], [4], "must rise"),
        ([4], [3], [2], "layers 3 to 3 are not used"),
    ],
)
def test_impossible_encoders(channels, layers, pool, message):
    with pytest.raises(ValueError, match=message):
        ImageEncoder(Encoder(channels, layers, pool))


def test_unknown_norm():
    with pytest.raises(ValueError, match="norm 'layer'"):
        ImageEncoder(Encoder([4], [1], [1], norm="layer"))


def test_an_image_that_is_too_small_is_an_error():
    encoder = ImageEncoder(PAPER_ARCHITECTURES["occluded"].encoder)
    with pytest.raises(ValueError, match="137 x 137 is too small .* nothing is left after layer 16"):
        encoder.sizes(137)


def test_instance_norm_by_its_formula():
    torch.manual_seed(0)
    norm = NORMS["instance"](5).double()
    for parameter in norm.parameters():
        torch.nn.init.normal_(parameter)
    maps = 3 + 2 * torch.randn(3, 5, 7, 9, dtype=torch.float64)
    mean, variance = maps.mean(dim=(2, 3), keepdim=True), maps.var(dim=(2, 3), keepdim=True, correction=0)
    scaled = (maps - mean) / (variance + 1e-5).sqrt()
    torch.testing.assert_close(norm(maps), scaled * norm.weight[:, None, None] + norm.bias[:, None, None])


def test_an_image_gives_the_same_maps_in_any_layout():
    torch.manual_seed(0)
    encoder = ImageEncoder(Encoder(**SMALL["encoder"]))
    image = torch.rand(1, 64, 64, 3).movedim(-1, 1)
    for one, other in zip(encoder(image), encoder(image.contiguous()), strict=True):
        assert torch.equal(one, other)


def test_readings_are_encoded_one_by_one():
    torch.manual_seed(0)
    encoder = ReadingEncoder(5).eval()
    readings = torch.rand(3, 3, 100, 100)
    features = encoder(readings)
    assert features.shape == (3, 5)
    torch.testing.assert_close(encoder(readings[1:2]), features[1:2])
    assert (features[0] != features[1]).any()
