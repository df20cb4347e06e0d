"""Progress of long work: a tqdm bar on a terminal or in a notebook, or a callback."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

_QUIET_SECONDS = 1.0  # a job shorter than this shows no bar


@dataclass(frozen=True)
class Progress:
    """done: share of the work, of `total`. rays_per_second. eta_seconds. noise: mean relative
    standard error, nan until known."""

    done: float
    total: float
    rays_per_second: float
    eta_seconds: float
    noise: float


class Meter:
    """Shows Progress messages. `mode`: None (a bar if watched), True, False or a callable."""

    def __init__(self, mode: bool | Callable[[Progress], Any] | None) -> None:
        self._callback = mode if callable(mode) else None
        self._wanted = mode is True or (mode is None and is_watched())
        self._quiet_until = time.monotonic() + (0 if mode is True else _QUIET_SECONDS)
        self._bar: Any = None

    @property
    def is_on(self) -> bool:
        """True if progress is shown or reported."""
        return self._callback is not None or self._wanted

    def __enter__(self) -> Meter:
        return self

    def update(self, message: Any) -> None:
        """Shows or reports a v1.Progress."""
        if self._callback is not None:
            self._callback(
                Progress(
                    message.done, 1.0, message.rays_per_second, message.eta_seconds, message.noise
                )
            )
        elif self._wanted and time.monotonic() >= self._quiet_until:
            self._show(message)

    def _show(self, message: Any) -> None:
        if self._bar is None:
            from tqdm.auto import tqdm

            bar = "{l_bar}{bar}| {elapsed}<{remaining}{postfix}"
            self._bar = tqdm(total=1.0, desc="render", bar_format=bar, leave=False)
        postfix = f"{message.rays_per_second * 1e-6:.1f} Mrays/s"
        if message.noise == message.noise:
            postfix += f", noise {message.noise:.3f}"
        self._bar.set_postfix_str(postfix, refresh=False)
        self._bar.n = min(1.0, message.done)
        self._bar.refresh()

    def __exit__(self, *_: Any) -> None:
        if self._bar is not None:
            self._bar.close()


def is_watched() -> bool:
    """A terminal or a notebook."""
    return sys.stderr.isatty() or "ipykernel" in sys.modules
