"""Where tensors are computed."""

from __future__ import annotations

import torch

from fit_material.renderer.errors.input_error import InputError


def torch_device(name: str) -> torch.device:
    """A device by torch's name for it, once it has shown that it computes here."""
    try:
        device = torch.device(name)
        torch.ones(1, device=device).sum().item()
    except Exception as error:  # each kind of device has its own way to be absent
        count = torch.cuda.device_count()
        known = ", ".join(["cpu", *(f"cuda:{i}" for i in range(count))])
        raise InputError("--device", value=name, expected=f"one that torch can use here: {known}") from error
    return device
