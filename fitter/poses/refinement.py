"""Small errors of cameras' poses, removed before a fit: by outlines first, then by its shading."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from fit_material.fitter.estimation.coarse_to_fine import Fit
from fit_material.fitter.forward.lighting import Lighting
from fit_material.fitter.least_squares.sample_halves import believed
from fit_material.fitter.observations.scene_data import Loaded
from fit_material.fitter.options.fidelity import PRESETS, Fidelity
from fit_material.fitter.options.progress import Progress
from fit_material.fitter.poses.photometric_alignment import Shown, informed, shown_pixels
from fit_material.fitter.poses.silhouette_alignment import MOST_APART, Border, border_of
from fit_material.fitter.poses.transforms_file import transforms_json
from fit_material.fitter.result.schema import RefinedCamera
from fit_material.renderer.cameras.pose_offset import DEGREES, SHARE, Pose
from fit_material.renderer.errors.input_error import InputError
from fit_material.renderer.rays.gbuffer import Tracer
from fit_material.renderer.rays.occlusion import occluder
from fit_material.shaders.materials.kinds import MaterialType

MOST_DEGREES, MOST_SHARE = 5.0, 0.03  # beyond them a pose is no small error any more
EFFORTS = ((500, 256, 3), (4000, 1024, 1))  # pixels of each photograph, directions of each, and rounds at most
MOST_PIXELS = 60000  # of all photographs
STILL = 1.0  # standard errors of each number, below which a step ends the rounds: noise moves them by as much


@dataclass(frozen=True)
class RefinedPoses:
    """A scene as it was loaded, but for its cameras' poses.

    Attributes:
        loaded: with the cameras moved.
        cameras: by how much, in words of `result.json`.
        told: the same in a sentence.
    """

    loaded: Loaded
    cameras: tuple[RefinedCamera, ...]
    told: str

    @property
    def transforms(self) -> str | None:
        """The cameras as `transforms.json` has them; None where one is orthographic."""
        return transforms_json(self.loaded)


def pose_fidelity(fidelity: Fidelity) -> Fidelity:
    """How accurately light is computed for poses: exactly, whatever the fit's own model, but from few directions."""
    return replace(PRESETS["standard"], environment_size=fidelity.environment_size)


def refine_poses(
    loaded: Loaded,
    trace: Tracer,
    lighting: Lighting,
    kinds: Sequence[MaterialType | None],
    progress: Progress,
    scene_file: Path,
    *,
    varied: bool,
) -> RefinedPoses:
    """Find where the cameras stood: six numbers for each, from the pose that the scene gives.

    Gauss–Newton steps on the outline's distances and on the pixels' differences together, the material fitted anew
    before each; poses have a prior, of `DEGREES` and `SHARE`, so that undetermined motions stay as they were.

    Args:
        loaded: the scene.
        trace: of the object.
        lighting: the light, at `pose_fidelity`; its seed chooses pixels as well.
        kinds: types of the materials, None where that is open.
        progress: called with the stage and the fraction of it done.
        scene_file: for the error's sentence.
        varied: whether colours change from place to place, which would be taken for a shift: outlines alone count then.

    Raises:
        InputError: a photograph has neither mask nor alpha channel, these are not the object's outline, or a pose is
            off by more than `MOST_DEGREES` or `MOST_SHARE`.
    """
    borders, poses = [], []
    for index, spec in enumerate(loaded.scene.photographs):
        progress("registering outlines", index / len(loaded.photographs))
        place = (scene_file, f"photographs[{index}]")
        border = border_of(spec, place)
        pose = border.registered(Pose.of(loaded.photographs[index].camera, loaded.shape), trace)
        _require_outline(border, pose, trace, place)
        _require_small(pose, place)
        borders.append(border)
        poses.append(pose)
    lighting = replace(lighting, occluder=occluder(loaded.shape))
    scene = _Scene(loaded, trace, lighting, kinds, borders)
    poses, covariance = (poses, scene.covariance(poses)) if varied else _by_pixels(scene, poses, progress)
    for index, pose in enumerate(poses):
        _require_small(pose, (scene_file, f"photographs[{index}]"))
    errors = covariance.diagonal().clamp_min(0).sqrt().reshape(-1, 6)
    names = [thumbnail.name for thumbnail in loaded.photographs.thumbnails]
    records = tuple(_record(*each) for each in zip(names, poses, errors, strict=True))
    album = loaded.photographs.taken_by([pose.camera for pose in poses])
    by = "outlines" if varied else "outlines and pixels"
    return RefinedPoses(replace(loaded, photographs=album), records, _sentence(records, by))


@dataclass(frozen=True)
class _Scene:
    """What poses are found from."""

    loaded: Loaded
    trace: Tracer
    lighting: Lighting
    kinds: Sequence[MaterialType | None]
    borders: Sequence[Border]

    def pixels(self, poses: Sequence[Pose], count: int, lighting: Lighting) -> list[Shown]:
        return shown_pixels(
            self.loaded.photographs,
            poses,
            self.trace,
            materials=len(self.loaded.materials),
            count=count,
            footprint=lighting.fidelity.footprint,
            seed=self.lighting.seed,
        )

    def outlined(self, poses: Sequence[Pose]) -> tuple[Float[Tensor, "v v"], Float[Tensor, " v"]]:
        """Matrix and gradient of the normal equations of all poses, by outlines and prior."""
        rows = [
            border.rows(pose, self.trace, border.reach(pose)) for border, pose in zip(self.borders, poses, strict=True)
        ]
        matrix = torch.block_diag(*(each.information for each in rows)) + torch.eye(6 * len(poses)).double()
        return matrix, torch.cat([each.gradient + pose.motion for each, pose in zip(rows, poses, strict=True)])

    def covariance(self, poses: Sequence[Pose]) -> Float[Tensor, "v v"]:
        """Of all poses, by outlines and prior alone."""
        return torch.linalg.inv(self.outlined(poses)[0])


def _by_pixels(scene: _Scene, poses: list[Pose], progress: Progress) -> tuple[list[Pose], Float[Tensor, "v v"]]:
    """Poses and their covariance, by more pixels from effort to effort."""
    covariance = torch.eye(6 * len(poses)).double()
    for of_each, samples, rounds in EFFORTS:
        pixels = min(of_each * len(poses), MOST_PIXELS)
        lighting = replace(scene.lighting, fidelity=replace(scene.lighting.fidelity, pixels=pixels, samples=samples))
        shown = scene.pixels(poses, pixels, lighting)
        fits: dict[int, Fit] = {}
        for _ in range(rounds):
            said, gradient = scene.outlined(poses)
            crossed = said
            for each in shown:
                kind, before = scene.kinds[each.material], fits.get(each.material)
                found = informed(each, poses, scene.trace, lighting, kind, before, progress)
                said, crossed, gradient = said + found.said, crossed + found.crossed, gradient + found.gradient
                fits[each.material] = found.fit
            covariance = torch.linalg.inv(believed(said, crossed))
            step = -covariance @ gradient
            poses = [pose.by(each) for pose, each in zip(poses, step.reshape(-1, 6), strict=True)]
            if bool((step.abs() < STILL * covariance.diagonal().sqrt()).all()):
                break
    return poses, covariance


def _require_outline(border: Border, pose: Pose, trace: Tracer, place: tuple[Path, str]) -> None:
    apart = border.apart(pose, trace)
    if apart > MOST_APART:
        found = f"{apart:.1f} pixels from the object's outline, at best" if apart < torch.inf else "far from the object"
        expected = (
            "a mask of the object and nothing else, and a pose that is off by a few degrees at most;"
            " look at both, or leave --refine-pose out"
        )
        raise InputError(place[0], f"{place[1]}.mask", found, expected)


def _require_small(pose: Pose, place: tuple[Path, str]) -> None:
    if pose.degrees > MOST_DEGREES or pose.share > MOST_SHARE:
        found = f"off by {pose.degrees:.1f}° and {pose.share:.1%} of its distance"
        expected = (
            f"a pose that is off by less than {MOST_DEGREES:g}° and {MOST_SHARE:.0%}, which --refine-pose mends;"
            " check the camera, its field of view, the mask and the mesh"
        )
        raise InputError(place[0], f"{place[1]}.camera", found, expected)


def _record(name: str, pose: Pose, error: Float[Tensor, "6"]) -> RefinedCamera:
    turn, shift = error.split(3)
    return RefinedCamera.model_validate(
        {
            "name": name,
            "degrees": pose.degrees,
            "percent": 100 * pose.share,
            "stderr_degrees": DEGREES * float(turn.norm()),
            "stderr_percent": 100 * SHARE * float(shift.norm()),
            "matrix": pose.camera.camera_to_world.tolist(),
        }
    )


def _sentence(records: Sequence[RefinedCamera], by: str) -> str:
    turned, shifted = (max(getattr(each, key) for each in records) for key in ("degrees", "percent"))
    errors = (max(getattr(each, f"stderr_{key}") for each in records) for key in ("degrees", "percent"))
    of_degrees, of_percent = errors
    return (
        f"Cameras were moved, by up to {turned:.2g}° and {shifted:.2g} % of their distance, to where {by}"
        f" agree; their own errors, {of_degrees:.1g}° and {of_percent:.1g} % at most, are not in the material's."
    )
