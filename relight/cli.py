"""The relight command: scene and light in, relit files out. Holds no mathematics, imports nothing heavy."""

import argparse
import json
import math
import sys
import warnings
from pathlib import Path

from . import __version__
from .effects import EFFECTS
from .transfer import DEFAULT_BANDS, DEFAULT_RAYS, METHODS, NEURAL_RAYS, SHADOWING

EXAMPLES = """examples:
  relight garden                                   under the built-in studio: garden/relit/studio_0/
  relight garden --env stpeters.exr --rotate 45
  relight bust.obj --env noon --albedo white --format glb ply npy -o bust_noon
  relight garden --env sunset --rotate 0:350:10    a folder for each of 36 angles, the transfer computed once

Every folder holds report.json: inputs, settings, times, warnings. A mesh's default folder is ./NAME_relit/.
A negative start needs an equals sign: --rotate=-30:30:10."""

FILES = {"glb": "relit.glb", "ply": "relit.ply", "npy": "radiance.npy", "png": "preview.png"}
MAX_ANGLES = 3600
MAX_EXPOSURE_EV = 64.0  # far beyond any light, and 2^64 still fits in the files' float32
PICTURE_SIZE = 960, 720


def parser():
    """The command line of relight."""
    parser = argparse.ArgumentParser(
        prog="relight",
        description="Put a scene under any light, with the shadows of everything on everything.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("scene", metavar="SCENE", help="scene folder of splat2mesh, or a mesh: .ply .obj .glb .stl")

    add = parser.add_argument_group("light").add_argument
    names = "studio, overcast, noon, sunset"
    add(
        "--env",
        default="studio",
        metavar="FILE|NAME",
        help=f".exr or .hdr file, or {names} (default: %(default)s)",
    )
    rotate = "turn the light about +y, counter-clockwise from above; a range, end included, fills several folders"
    add("--rotate", default="0", metavar="DEG|A:B:STEP", help=rotate)
    exposure = "show radiance times 2^EV (default: by the brightest vertices, the same for all angles)"
    add("--exposure", type=float, metavar="EV", help=exposure)

    add = parser.add_argument_group("surface and accuracy").add_argument
    albedo = "captured (the scene's colours), white, or FILE.npy, (V, 3) linear (default: %(default)s)"
    add("--albedo", default="captured", metavar="WHICH", help=albedo)
    method = f"{', '.join(METHODS)}; the last three know no shadows, auto is raytraced (default: %(default)s)"
    add("--method", default="auto", choices=METHODS, metavar="NAME", help=method)
    effects = f"auto, none, or some of {','.join(EFFECTS)}; auto is all, but no bounces on a white scene"
    add("--effects", default="auto", metavar="LIST", help=effects)
    add("--bands", type=int, default=DEFAULT_BANDS, metavar="1..10", help="SH bands (default: %(default)s)")
    rays = f"rays per vertex (default: {DEFAULT_RAYS}; {NEURAL_RAYS} with neural)"
    add("--rays", type=int, metavar="N", help=rays)
    add("--seed", type=int, default=0, metavar="N", help="seed of the ray directions (default: %(default)s)")

    add = parser.add_argument_group("results").add_argument
    output = "folder to write, for several angles the one for their folders (default: SCENE/relit/ENV_ANGLE)"
    add("-o", "--output", metavar="OUT", help=output)
    kinds = f"any of {' '.join(FILES)} (default: glb png)"
    add("--format", nargs="+", default=["glb", "png"], choices=FILES, metavar="KIND", help=kinds)
    add("--overwrite", action="store_true", help="replace results that exist")
    add("--json", action="store_true", help="print the result as one JSON object")
    add("-q", "--quiet", action="store_true", help="no progress, no summary")
    add("-v", "--verbose", action="store_true", help="stage times; the traceback of an error")
    add("--version", action="version", version=f"%(prog)s {__version__}")
    return parser


def main(arguments=None):
    """Run the command; returns the exit code."""
    from splat2mesh.console import run

    return run(_command, parser().parse_args(arguments))


def angles_from(text):
    """The angles of `--rotate`, in [0, 360), each once: "405" -> [45.0], "0:90:45" -> [0.0, 45.0, 90.0].

    Raises InputError for anything else than DEG or START:STOP:STEP.
    """
    from splat2mesh.errors import InputError

    try:
        values = [float(part) for part in text.split(":")]
    except ValueError:
        values = []
    if len(values) not in (1, 3) or not all(map(math.isfinite, values)):
        raise InputError(f"--rotate {text}: expected degrees, such as 45, or START:STOP:STEP, such as 0:350:10")
    start, stop, step = values if len(values) == 3 else (values[0], values[0], 1.0)
    if step == 0.0 or (stop - start) / step < 0.0:
        raise InputError(f"--rotate {text}: a step of {step:g} does not lead from {start:g} to {stop:g}")
    count = math.floor((stop - start) / step + 1e-6) + 1
    if count > MAX_ANGLES:
        raise InputError(f"--rotate {text}: {count} angles; expected at most {MAX_ANGLES}, take a larger step")
    return list(dict.fromkeys(round((start + i * step) % 360.0, 6) % 360.0 for i in range(count)))


def _command(options):
    from splat2mesh.console import wants_progress
    from splat2mesh.errors import InputError
    from splat2mesh.stages import Stages

    from .transfer import check_rays

    source = Path(options.scene)
    if not source.exists():
        raise InputError(f"{source}: no such scene folder or mesh file")
    if options.exposure is not None and not abs(options.exposure) <= MAX_EXPOSURE_EV:
        limit = f"{MAX_EXPOSURE_EV:g}"
        raise InputError(f"--exposure {options.exposure}: expected stops from -{limit} to {limit}")
    if options.rays is not None:
        check_rays(options.rays)
    angles = angles_from(options.rotate)
    folders = _output_folders(options, source, angles)
    messages = _recorded_warnings()
    stages = Stages(show=wants_progress(options))
    try:
        reports = list(_relight(options, source, zip(angles, folders, strict=True), stages, messages))
    finally:
        stages.close()
    lines = [str(folder / name) for folder, report in zip(folders, reports, strict=True) for name in report["files"]]
    if options.verbose:
        lines += [f"  {label:<12}{seconds:7.2f} s" for label, seconds in stages.seconds.items()]
    return lines, {"outputs": [str(folder) for folder in folders], "reports": reports}


def _output_folders(options, source, angles):
    """The folder of every angle. Raises InputError, before any work, for one that may not be written."""
    from splat2mesh.outputs import check_output

    if options.output and len(angles) == 1:
        folders = [Path(options.output)]
    else:
        default = source / "relit" if source.is_dir() else Path(f"{source.stem}_relit")
        parent = Path(options.output or default)
        folders = [parent / f"{Path(options.env).stem}_{_plain(angle)}" for angle in angles]
    for folder in folders:
        check_output(folder, options.overwrite, marker="report.json")
    return folders


def _relight(options, source, outputs, stages, messages):
    """Light the scene and write every (angle, folder) of `outputs`; yields the report of each, JSON-clean."""
    with stages.stage("environment"):
        from . import sh
        from .environment import Environment

        sh.check_bands(options.bands)
        environment = Environment.load(options.env)
    with stages.stage("load"):
        from splat2mesh.scene import Scene

        scene = Scene.load(source)
        albedo = _albedo(options.albedo, scene)

    from splat2mesh.console import peak_mb
    from splat2mesh.outputs import staged_folder

    from . import export
    from .engine import Relighter
    from .preview import Preview

    relighter = Relighter(scene, options.method, options.bands, options.rays, options.seed, options.effects, stages)
    lights = [(environment.rotated(angle), folder) for angle, folder in outputs]
    # One light is shaded once; of many the first pass only finds the exposure, or all would be in memory at once.
    first = relighter.shading(lights[0][0], albedo)
    exposure = _exposure(options.exposure, relighter, albedo, first, [light for light, _ in lights[1:]])
    preview = None
    for light, folder in lights:
        shading = first if light is lights[0][0] else relighter.shading(light, albedo)
        radiance = shading.radiance
        if "png" in options.format:
            with stages.stage("preview"):
                preview = preview or Preview(scene, None, *PICTURE_SIZE)
                picture = preview.render(radiance, light, exposure)
        report = {
            "version": __version__,
            "scene": str(source),
            "vertices": len(radiance),
            "faces": len(scene.faces),
            "chunks": len(scene.chunks),
            "environment": {"name": light.name, "source": options.env, "repaired_pixels": light.repaired},
            "angle_deg": light.rotation_deg,
            "albedo": options.albedo,
            "method": relighter.method,
            "bands": relighter.bands,
            "rays": relighter.rays if relighter.method in SHADOWING else 0,
            "effects": sorted(relighter.effects),
            "suns": shading.suns,
            "bounces": [round(share, 6) for share in shading.bounces],
            "seed": relighter.seed,
            "exposure": exposure,
            "files": [FILES[kind] for kind in FILES if kind in options.format],
        }
        with stages.stage("write"), staged_folder(folder) as staging:
            if "glb" in options.format:
                extras = {"environment": light.name, "angle_deg": light.rotation_deg}
                report["clipped_vertices"] = export.write_glb(staging / FILES["glb"], scene, radiance, exposure, extras)
            if "ply" in options.format:
                export.write_ply(staging / FILES["ply"], scene, radiance, exposure)
            if "npy" in options.format:
                export.write_npy(staging / FILES["npy"], scene, radiance)
            if "png" in options.format:
                export.write_png(staging / FILES["png"], picture)
            report.update(warnings=list(messages), seconds=dict(stages.seconds), peak_mb=peak_mb())
            (staging / "report.json").write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
        yield report


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


def _exposure(exposure_ev, relighter, albedo, first, lights):
    """Display value per unit of radiance: 2^EV, else what the brightest of the lights calls for, the `first` shaded."""
    if exposure_ev is not None:
        return 2.0**exposure_ev
    from .tonemap import auto_exposure

    exposures = (auto_exposure(relighter.shade(light, albedo)) for light in lights)
    return min([auto_exposure(first.radiance), *exposures])


def _plain(number):
    """A number without trailing zeros: 45.0 -> "45"."""
    return f"{number:.6f}".rstrip("0").rstrip(".")


def _recorded_warnings():
    """A list to which the text of every warning is added, besides being shown."""
    messages, show = [], warnings.showwarning

    def record(message, *details, **options):
        messages.append(str(message))
        show(message, *details, **options)

    warnings.showwarning = record
    return messages


if __name__ == "__main__":
    sys.exit(main())
