"""in_view: draws again until the targets are seen."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ...errors import InvalidArgument
from ...values.checks import number_of, whole_of
from ..tries import gave_up

if TYPE_CHECKING:
    from ..draw import Draw


class InView:
    """Runs a randomizer again and again until targets are seen well enough.

    randomizer: drawn again in each try; earlier draws stay. targets: labelled entities. camera:
    default all of the draw's. min_visibility: least share of a target's pixels, of all that it
    would cover on a canvas three times as large, that are in the image and not occluded: the column
    `visibility` of the labels, which are traced for each try. least: number of targets that must
    be, default all. tries: before ResourceExhausted.
    """

    def __init__(
        self,
        randomizer: Callable[[Draw], Any],
        targets: Any,
        *,
        camera: Any = None,
        min_visibility: float = 0.1,
        least: int | None = None,
        tries: int = 100,
    ) -> None:
        if not callable(randomizer):
            raise InvalidArgument(
                f"randomizer: {randomizer!r} is no callable (draw) -> None", field="randomizer"
            )
        self.randomizer, self.targets, self.camera = randomizer, targets, camera
        self.min_visibility = number_of(min_visibility, "min_visibility")
        if not 0 < self.min_visibility <= 1:
            raise InvalidArgument(
                f"min_visibility: needs to be above 0 and at most 1, is {min_visibility}",
                field="min_visibility",
            )
        self.least = None if least is None else whole_of(least, "least", 1)
        self.tries = whole_of(tries, "tries", 1)

    def __call__(self, draw: Draw) -> None:
        targets = {body.root.id for body in draw.bodies.some(self.targets, "targets")}
        least = len(targets) if self.least is None else self.least
        if least > len(targets):
            raise InvalidArgument(
                f"least: {least} of {len(targets)} targets cannot be seen; ask for fewer",
                field="least",
            )
        mark = draw.mark()
        for _ in range(self.tries):
            self.randomizer(draw)
            if self._seen(draw, targets) >= least:
                return
            draw.rewind(mark)
        raise gave_up(
            f"in_view: {least} of the targets were never seen together in {self.tries} tries; ask "
            "for less min_visibility= or least=, or raise tries=",
            "tries",
            self.tries,
        )

    def _seen(self, draw: Draw, targets: set[int]) -> int:
        """Number of targets seen well enough, by the camera that sees fewest."""
        cameras = draw.cameras if self.camera is None else [self.camera]
        frames = draw.scene.render(
            cameras, overlay=draw.edit, planes=[], labels=["boxes", "amodal"], progress=False
        )
        counts = []
        for frame in frames:
            labels = frame.labels
            rows = {int(e): float(v) for e, v in zip(labels["entity"], labels["visibility"])}
            unknown = targets - set(rows)
            if unknown:
                raise InvalidArgument(
                    f"targets: {draw.scene.handle(min(unknown))!r} has no label of its own",
                    field="targets",
                )
            counts.append(sum(rows[target] >= self.min_visibility for target in targets))
        return min(counts)
