"""The U-Net against the same network written out row by row from the supplement's table."""

import pytest
import torch
from torch.nn import functional

from palpate.models import TouchDepth
from palpate.models.touch_depth import IMPRESSION
from palpate.touch.reading import SENSOR_RANGE


def by_the_table(model, reading):
    """The rows (1) to (27) of the table, with the weights of the model in the order they are used."""
    state = model.state_dict()
    rows = {}

    def conv(x, name):
        x = functional.conv2d(x, state[f"{name}.0.weight"], padding=1)
        mean, variance = state[f"{name}.1.running_mean"], state[f"{name}.1.running_var"]
        x = functional.batch_norm(x, mean, variance, state[f"{name}.1.weight"], state[f"{name}.1.bias"])
        return functional.relu(x)

    def rise(x, name, missing):
        weight, bias = state[f"{name}.weight"], state[f"{name}.bias"]
        return functional.conv_transpose2d(x, weight, bias, stride=2, output_padding=missing)

    x, row = reading, 0
    for level in range(5):
        for k in (0, 1):
            row += 1
            rows[row] = x = conv(x, f"down.{level}.{k}")
        if level < 4:
            row += 1
            rows[row] = x = functional.max_pool2d(x, 2)
    assert row == 14
    for k, (skip, missing) in enumerate(((11, 0), (8, 1), (5, 0), (2, 0))):
        rows[row + 1] = rise(rows[row], f"upsample.{k}", missing)
        rows[row + 2] = torch.cat([rows[row + 1], rows[skip]], dim=1)
        rows[row + 3] = conv(rows[row + 2], f"up.{k}")
        row += 3
    return functional.conv2d(rows[26], state["depth.weight"], state["depth.bias"])


def test_network_is_the_tables():
    torch.manual_seed(0)
    model = TouchDepth(width=4).double()
    reading = torch.rand(2, 3, 100, 100, dtype=torch.float64)
    model(reading)  # Moves the batch statistics off their start.
    model.eval()
    depth = model(reading)
    assert depth.shape == (2, 100, 100)
    expected = SENSOR_RANGE - IMPRESSION * by_the_table(model, reading)[:, 0]
    torch.testing.assert_close(depth, expected, rtol=1e-12, atol=1e-15)


def test_every_weight_gets_a_gradient():
    torch.manual_seed(0)
    model = TouchDepth(width=2)
    model(torch.rand(2, 3, 100, 100)).square().sum().backward()
    for name, parameter in model.named_parameters():
        assert parameter.grad is not None and torch.isfinite(parameter.grad).all(), name


def test_it_can_learn_a_depth():
    # Depth that follows the red channel: an affine function a network with skip connections learns at once.
    torch.manual_seed(0)
    model = TouchDepth(width=2)
    reading = torch.rand(2, 3, 100, 100)
    depth = SENSOR_RANGE - 0.004 * reading[:, 0]
    optimiser = torch.optim.Adam(model.parameters(), 0.03)
    errors = []
    for _ in range(25):
        optimiser.zero_grad()
        error = (model(reading) - depth).square().mean()
        (error / IMPRESSION**2).backward()
        optimiser.step()
        errors.append(error.item())
    assert errors[-1] < 0.2 * errors[0]


@pytest.mark.parametrize("shape", [(2, 100, 100, 3), (3, 100, 100), (2, 3, 96, 96)])
def test_wrong_shapes(shape):
    with pytest.raises(ValueError, match="reading has shape"):
        TouchDepth(width=1)(torch.zeros(shape))


def test_in_bfloat16_the_depth_is_not_rounded_to_it():
    torch.manual_seed(0)
    model, reading = TouchDepth(8).eval(), torch.rand(2, 3, 100, 100)
    with torch.inference_mode():
        plain = model(reading)
        with torch.autocast("cpu", dtype=torch.bfloat16):
            half = model(reading)
    assert half.dtype == torch.float32
    assert (half - plain).abs().mean() < 1e-5  # m; neighbours in bfloat16 are 6e-5 to 1.2e-4 apart here
