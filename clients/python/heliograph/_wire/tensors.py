"""Tensors of PyTorch, which is not imported for them. Used where arrays come in."""

from __future__ import annotations

import sys
from typing import Any


def is_tensor(value: Any) -> bool:
    """True for a PyTorch tensor."""
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(value, torch.Tensor)


def on_host(value: Any) -> Any:
    """Converts a tensor to an array of numpy, without a gradient; returns other values as they
    are."""
    return value.detach().cpu().numpy() if is_tensor(value) else value
