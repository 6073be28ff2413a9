"""One run of relight: a scene and lights from files, results and a report into folders."""

import json
from pathlib import Path

from . import __version__

FILES = {"glb": "relit.glb", "ply": "relit.ply", "npy": "radiance.npy", "png": "preview.png"}
PICTURE_SIZE = 960, 720


class Job:
    """A scene and an environment as the options of the command name them, and the Relighter for them.

    Raises InputError for whatever of it cannot be read or used.
    """

    def __init__(self, options, angles, stages, messages):
        self.options, self.stages, self._messages = options, stages, messages
        self.source = Path(options.scene)
        with stages.stage("environment"):
            from . import sh
            from .environment import Environment

            if options.bands is not None:
                sh.check_bands(options.bands)
            self.environment = Environment.load(options.env)
        with stages.stage("load"):
            from splat2mesh.scene import Scene

            self.scene = Scene.load(self.source)
            self.albedo = _albedo(options.albedo, self.scene)
        from .cache import Cache
        from .engine import Relighter
        from .planning.plan import DEFAULT_TOLERANCE

        tolerance = DEFAULT_TOLERANCE if options.tolerance is None else options.tolerance
        with stages.stage("load"):
            cache = None if options.no_cache else Cache.of_scene(self.scene)
        self.relighter = Relighter(
            self.scene,
            options.method,
            options.bands,
            options.rays,
            options.seed,
            options.effects,
            stages,
            None if options.budget is not None else tolerance,
            options.budget,
            cache,
        )
        self.plan = self.relighter.plan_for(self.environment, self.albedo, len(angles))
        self._lights = [self.environment.rotated(angle) for angle in angles]

    def results(self, folders):
        """Light the scene and fill a folder for each angle; yields the report of each, JSON-clean."""
        from . import export
        from .preview import Preview

        options, stages = self.options, self.stages
        # One light is shaded once; of many the first pass only finds the exposure, or all would be in memory at once.
        first = self.relighter.shading(self._lights[0], self.albedo)
        exposure = self._exposure(first)
        preview = None
        from splat2mesh.console import peak_mb
        from splat2mesh.outputs import staged_folder

        for light, folder in zip(self._lights, folders, strict=True):
            shading = first if light is self._lights[0] else self.relighter.shading(light, self.albedo)
            radiance = shading.radiance
            if "png" in options.format:
                with stages.stage("preview"):
                    preview = preview or Preview(self.scene, None, *PICTURE_SIZE)
                    picture = preview.render(radiance, light, exposure)
            report = self._report(light, shading, exposure)
            with stages.stage("write"), staged_folder(folder) as staging:
                if "glb" in options.format:
                    extras = {"environment": light.name, "angle_deg": light.rotation_deg}
                    written = staging / FILES["glb"], self.scene, radiance, exposure, extras
                    report["clipped_vertices"] = export.write_glb(*written)
                if "ply" in options.format:
                    export.write_ply(staging / FILES["ply"], self.scene, radiance, exposure)
                if "npy" in options.format:
                    export.write_npy(staging / FILES["npy"], self.scene, radiance)
                if "png" in options.format:
                    export.write_png(staging / FILES["png"], picture)
                report.update(warnings=list(self._messages), seconds=dict(stages.seconds), peak_mb=peak_mb())
                (staging / "report.json").write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
            yield report

    def _report(self, light, shading, exposure):
        options, settings = self.options, shading.settings
        return {
            "version": __version__,
            "scene": str(self.source),
            "vertices": len(shading.radiance),
            "faces": len(self.scene.faces),
            "chunks": len(self.scene.chunks),
            "environment": {"name": light.name, "source": options.env, "repaired_pixels": light.repaired},
            "angle_deg": light.rotation_deg,
            "albedo": options.albedo,
            "method": settings.method,
            "bands": settings.bands,
            "rays": settings.rays,
            "effects": sorted(settings.effects),
            "suns": shading.suns,
            "bounces": [round(share, 6) for share in shading.bounces],
            "seed": options.seed,
            "plan": None if self.plan is None else self.plan.as_dict(),
            "rays_traced": self.relighter.rays_traced,
            "exposure": exposure,
            "files": [FILES[kind] for kind in FILES if kind in options.format],
        }

    def _exposure(self, first):
        """Display value per unit of radiance: 2^EV, else what the brightest of the lights calls for."""
        if self.options.exposure is not None:
            return 2.0**self.options.exposure
        from .tonemap import auto_exposure

        others = (self.relighter.shade(light, self.albedo) for light in self._lights[1:])
        return min([auto_exposure(first.radiance), *map(auto_exposure, others)])


def _albedo(choice, scene):
    """The albedo that `--albedo` names: (V, 3) float32 linear, or None for white. Raises InputError."""
    import numpy as np

    from splat2mesh.color import linear_from_srgb
    from splat2mesh.errors import InputError

    if choice == "white":
        return None
    if choice == "captured":
        return linear_from_srgb(scene.colors_srgb / np.float32(255.0))
    try:
        albedo = np.load(choice)
    except FileNotFoundError:
        raise InputError(f"--albedo {choice}: expected captured, white or a .npy file; no such file") from None
    except (OSError, ValueError) as error:
        raise InputError(f"--albedo {choice}: not an array in .npy format ({error})") from None
    count = sum(len(chunk.vertices) for chunk in scene.chunks)
    if not isinstance(albedo, np.ndarray) or albedo.shape != (count, 3) or albedo.dtype.kind not in "fiu":
        found = f"{albedo.dtype} of shape {albedo.shape}" if isinstance(albedo, np.ndarray) else "several arrays"
        raise InputError(f"--albedo {choice}: expected numbers of shape ({count}, 3), found {found}")
    if not ((albedo >= 0.0) & (albedo <= 1.0)).all():
        raise InputError(
            f"--albedo {choice}: expected linear values from 0 to 1, found {albedo.min()} to {albedo.max()}"
        )
    return albedo.astype(np.float32)
