"""What a choice of pixels is made from, whatever their number."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from fit_material.fitter.observations.photograph import Photograph
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.rays.gbuffer import GBuffer, Tracer


@dataclass(frozen=True)
class PixelRequest:
    """Which pixels of a scene are wanted.

    Attributes:
        photographs: to choose from.
        trace: traces rays to the object.
        scene_file: named in errors.
        footprint: rays along each side of a pixel.
        seed: of the choice among many.
        materials: number of materials that the object has.
        left_out: photographs that are not used.
        kept: materials of which pixels are taken though they mirror the object.
        progress: called with the fraction of the photographs that is done.
    """

    photographs: Sequence[Photograph]
    trace: Tracer
    scene_file: Path
    footprint: int
    seed: int
    materials: int = 1
    left_out: Collection[int] = ()
    kept: Collection[int] = ()
    progress: Callable[[float], None] = lambda share: None

    @property
    def used(self) -> list[int]:
        """Numbers of the photographs that are used."""
        return [index for index in range(len(self.photographs)) if index not in self.left_out]

    def unseen(self, photograph: int, expected: str) -> InputError:
        """An error about the camera of a photograph."""
        return InputError(self.scene_file, f"photographs[{photograph}].camera", value="", expected=expected)

    def require_front(self, photograph: int, centres: GBuffer) -> None:
        """Refuse a camera that sees nothing of the object where its mask is, or sees it from inside.

        Raises:
            InputError: names the camera.
        """
        if not centres.hit.any():
            raise self.unseen(
                photograph,
                f"a camera that sees the object in the pixels its photograph shows, but none of {len(centres.hit)}"
                " tried meets it: the object is outside the frame, or pose or field of view are wrong",
            )
        if not centres.front.any():
            raise self.unseen(
                photograph,
                "a camera outside the object, but every ray meets the back of its surface:"
                " the camera is inside the object, or the mesh's faces are wound inside out",
            )
