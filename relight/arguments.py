"""The options of the relight command, in the groups of its help. Imports nothing heavy."""

import argparse
from collections.abc import Iterable
from typing import Any

from splat2mesh.base.commandline import Parser
from splat2mesh.base.completion import add_completion, offer
from splat2mesh.base.version import VERSION
from splat2mesh.cli import MESHING_WORDS, add_display, add_meshing, add_tiling

from .light import ANEW, CAPTURED, CAPTURED_SKIES
from .options import DEFAULT_TOLERANCE, PLACE_TOLERANCE, LightingOptions
from .output.kinds import FILES
from .request import ALBEDOS, CHOICES, RelightRequest
from .transfer import METHODS
from .transfer.settings import EFFECTS, GLOSS

EXAMPLES = """examples:
  relight garden.ply --env sunset                  meshes the splat into the scene folder garden/ first
  relight garden                                   under the built-in studio light: garden/relit/studio_0/
  relight garden --env stpeters.exr --rotate 45
  relight bust.obj --env noon --albedo white --format glb ply npy -o bust_noon
  relight garden --env sunset --rotate 0:350:10    a folder for each of 36 angles, one transfer
  relight lounge --env overcast --lamps off --format splat
  relight lounge --captured .1 --lamp 1.5,1.5,-1.5 color=2700K   dusk, and a lamp added
  relight patio --insert statue.glb --at 1.55,0,-.6 --turn 30 --on floor   an object with its shadow
  relight city --env sunset --format splat --workers 8   a city that splat2mesh made in tiles
  relight garden --env noon --plan                 which effects this scene needs, and the cost of accuracy
  relight garden --env noon --env hdris/ --sheet   several lights, and one picture of them all
  relight garden --env sunset --format web         relit.html: a page that relights in any browser

Every result folder holds report.json: inputs, settings, times, warnings. A mesh file gets the folder ./NAME_relit/."""


BUILTIN = ("studio", "overcast", "noon", "sunset")
"""Names of `light.skies.BUILTIN`, whose module is too heavy to import here."""

WORDS: dict[str, Iterable[str]] = {
    **CHOICES,
    "env": (*BUILTIN, CAPTURED),
    "captured_sky": CAPTURED_SKIES,
    "captured_light": (ANEW,),
    "on": ("floor",),
    "lamps": ("keep", "off"),
    "albedo": ALBEDOS,
    "method": METHODS,
    "effects": ("auto", "none", *EFFECTS, GLOSS),
}
"""Words that shells offer as values of options, by setting."""


class AnySun(argparse.Action):
    """A sun, which the words after it describe: the captured one, or that of the new light."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: str | None = None) -> None:
        """Keep it, and that `--at` and `--north` belong to it from now on."""
        setattr(namespace, self.dest, values)
        namespace.latest_sun = self.dest


class OfSun(argparse.Action):
    """A word for the last sun."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: str | None = None) -> None:
        """Keep it as that of the new light, or as `captured_at` or `captured_north_deg`."""
        captured = getattr(namespace, "latest_sun", "") == "captured_sun"
        setattr(namespace, f"captured_{self.dest}" if captured else self.dest, values)


class OfInsert(OfSun):
    """A word for the last --insert; `--at` with two numbers belongs to the last sun, any other to a probe."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: str | None = None) -> None:
        """Add it to the words of that object."""
        inserted = getattr(namespace, "inserted", None)
        if self.dest == "at" and str(values).count(",") < 2:
            super().__call__(parser, namespace, values, option_string)
        elif self.dest == "at" and (not inserted or any(word.startswith("at=") for word in inserted[-1])):
            namespace.probe_at = [*getattr(namespace, "probe_at", []), values]
        elif not inserted:
            parser.error(f"--{self.dest} {values}: needs an --insert before it")
        else:
            inserted[-1].append(f"{self.dest}={values}")


def parser() -> argparse.ArgumentParser:
    """The command line of relight."""
    parser = Parser(
        prog="relight",
        description="Relight a scene or a splat under any light, with shadows and bounced light.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        argument_default=argparse.SUPPRESS,
    )
    parser.signed = "--rotate", "--up", "--eye", "--at", "--north", "--turn", "--white", "--captured-sun"
    parser.signed_words = ("--lamp",)
    scene = "scene folder of splat2mesh, a splat (meshed first), or a mesh: .ply .obj .glb .stl"
    parser.add_argument("scene", metavar="SCENE", help=scene)

    add = parser.add_argument_group("light").add_argument
    names = ", ".join(BUILTIN)
    add(
        "--env",
        action="append",
        metavar="FILE|NAME|FOLDER",
        help=f".exr or .hdr file, a folder of them, {names}, or captured, the light of the capture; repeatable "
        "(one result each; default: captured with added lamps or objects or a changed captured light, else studio)",
    )
    rotate = (
        "turn the light about +y, counter-clockwise from above; a range (end included) makes a folder for each angle; "
        "45:1,0,0 turns it about an axis of the scene"
    )
    add("--rotate", dest="angles_deg", metavar="DEG|A:B:STEP|DEG:X,Y,Z", help=rotate)
    exposure = "show radiance times 2^EV (default: exposure of the capture, else by the brightest vertices)"
    lamp = "add a lamp: position in the frame of the splat, and what differs from a warm bulb "
    lamp += "(1.5,1.5,-1.5 radius=.1 color=3000K brightness=+1EV), or a file of lamps (docs/lamps.md); repeatable"
    add("--lamp", dest="placed", nargs="+", action="append", metavar="SPEC|FILE", help=lamp)
    captured = "fraction of the captured light that stays, 0 for night (default: 1 beside lamps, 0 under another light)"
    add("--captured", type=float, metavar="FACTOR", help=captured)
    sun = "replaces --env by the clear sky of a date and time with its zone (2026-06-21T19:30+02:00)"
    add("--sun", action=AnySun, metavar="TIME", help=sun)
    where = "latitude and longitude for the --sun or --captured-sun before it (48.85,2.35); position of the --insert "
    where += "before it, or else of a probe (1.55,0,-.6)"
    add("--at", action=OfInsert, metavar="LAT,LON|X,Y,Z", help=where)
    north = "turn north of the --sun or --captured-sun before it from -z, counter-clockwise from above"
    add("--north", action=OfSun, dest="north_deg", type=float, metavar="DEG", help=north)
    day = "times of the day of --sun (05:00-21:30/15min): a folder for each, at one exposure; with ffmpeg also a film"
    add("--day", metavar="A-B/STEP", help=day)
    insert = "add a mesh or a splat, in the frame of the splat, or a layout of several (docs/insert.md); repeatable"
    add("--insert", dest="inserted", nargs="+", action="append", metavar="FILE", help=insert)
    turn = "turn the --insert before it about the vertical, counter-clockwise from above"
    add("--turn", action=OfInsert, metavar="DEG", help=turn)
    scale = "units of the splat per unit of the --insert before it (default: 1)"
    add("--scale", action=OfInsert, metavar="S", help=scale)
    add("--on", action=OfInsert, metavar="floor", help="stand the --insert before it on what is below")
    add("--env-scale", type=float, metavar="FACTOR", help="scale the light of --env (default: 1)")
    lamps = "captured lamps of a closed room: keep, off, a factor for all, or a factor for each by its number or by a "
    lamps += "place on it in the frame of the splat (1=off,at=1.2,2.0,-.4=off) "
    lamps += f"(default: {LightingOptions.lamps})"
    add("--lamps", metavar="keep|off|FACTOR|1=off,at=X,Y,Z=.5", help=lamps)
    add("--exposure", dest="exposure_ev", type=float, metavar="EV", help=exposure)

    add = parser.add_argument_group("surface and accuracy").add_argument
    albedo = "estimated (captured light removed), captured (colours as they are), white, or FILE.npy, "
    albedo += "(V, 3) linear (default: estimated; captured for mesh files)"
    add("--albedo", metavar="WHICH", help=albedo)
    capture = "the light of the capture, if you have it (.exr, .hdr): only its exposure is then estimated"
    add("--capture-env", metavar="FILE", help=capture)
    known = "the sun of the capture, if you know it: date and time with its zone, with --at and --north after it, or "
    known += "azimuth from north, clockwise, and height in degrees (210,35)"
    add("--captured-sun", action=AnySun, metavar="TIME|AZIMUTH,HEIGHT", help=known)
    above = f"the sky of the capture: {', '.join(CAPTURED_SKIES)}, or a file of light"
    add("--captured-sky", metavar="KIND|FILE", help=above)
    likely = "the light of the capture: the number of a likely one that an estimate offered in the scene folder, or a "
    likely += "file (captured_light.json, .exr or .hdr); auto ignores the one that was chosen there"
    add("--captured-light", metavar="N|FILE|auto", help=likely)
    white = "a place in the frame of the splat whose surface is white or grey, where the estimate of the captured "
    white += "light has another colour"
    add("--white", dest="white_at", metavar="X,Y,Z", help=white)
    tolerance = "accepted relative error of the light; effects that it does not need are skipped "
    tolerance += f"(default: {DEFAULT_TOLERANCE:g}, which is {DEFAULT_TOLERANCE:.0%}%; for places {PLACE_TOLERANCE:g})"
    add("--tolerance", metavar="ERROR", help=tolerance)
    budget = "replaces the tolerance: the most accurate light in this time"
    add("--budget", type=float, dest="budget_s", metavar="SECONDS", help=budget)
    add("--plan", action="store_true", help="print what the command would do and what accuracy costs here; do nothing")
    add("--plot", metavar="FILE.png", help="with --plan: draw what accuracy costs here, and the choice")
    add(
        "--no-cache",
        dest="caching",
        action="store_const",
        const="none",
        help="do not use or keep intermediate results in SCENE/cache",
    )
    add("--clear-cache", action="store_true", help="empty SCENE/cache first")

    add = parser.add_argument_group("expert: in place of what the plan chooses").add_argument
    method = f"{', '.join(METHODS)}; the last three trace no shadows, auto is raytraced "
    method += f"(default: {LightingOptions.method})"
    add("--method", metavar="NAME", help=method)
    effects = f"auto (what the scene needs), none, or some of {','.join((*EFFECTS, GLOSS))} "
    effects += f"(default: {LightingOptions.effects})"
    add("--effects", metavar="LIST", help=effects)
    add("--bands", type=int, metavar="1..10", help="SH bands (default: as planned)")
    add("--rays", type=int, metavar="N", help="rays per vertex (default: as planned)")
    add("--seed", type=int, metavar="N", help=f"seed of the ray directions (default: {LightingOptions.seed})")

    add = parser.add_argument_group("session").add_argument
    add("--view", action="store_true", help="open a window to turn, change and compare lights; h lists its keys")
    add("--screenshot", metavar="FILE", help="write a .png, .jpg or .webp of the session, without a window")
    serve = "show the session, or the page that --format web wrote as a folder, in a browser of this machine; prints "
    serve += "the address (default port: any free one)"
    add("--serve", nargs="?", const=0, type=int, metavar="PORT", help=serve)

    add = parser.add_argument_group("motion").add_argument
    add(
        "--animate",
        dest="animated",
        action="store_true",
        help="light every frame of an animated .glb, or of those of --insert; with ffmpeg also a film",
    )
    sequence = "SCENE is a folder of numbered splats, the frames of a sequence: all are relit in one captured light"
    add("--sequence", action="store_true", help=sequence)
    fps = f"frames per second of films and of the page of a sequence (default: {RelightRequest.fps:g})"
    add("--fps", type=float, metavar="N", help=fps)

    add_meshing(parser.add_argument_group("meshing, for a splat without a scene folder").add_argument)
    add_tiling(parser)
    add = parser.add_argument_group("results").add_argument
    output = "folder to write; with several angles, the parent of their folders (default: SCENE/relit/ENV_ANGLE)"
    add("-o", "--output", metavar="OUT", help=output)
    kinds = (
        f"any of {' '.join(FILES)} (default: glb png, and splat where the scene was made from one); for a city any of "
    )
    kinds += "glb ply npy splat sog"
    add("--format", dest="formats", nargs="+", action="extend", metavar="KIND", help=kinds)
    space = "of --format passes: srgb or acescg, linear both; their --cameras are as those of meshing, one file each "
    space += f"(default: {RelightRequest.color_space})"
    add("--color-space", metavar="NAME", help=space)
    probes = "of --format probe: a grid of light probes for engines, as counts along x, y, z (4x2x4) or as the largest "
    probes += "distance between two, in the box of two --at or all over the scene"
    add("--probes", metavar="GRID", help=probes)
    add("--sheet", action="store_true", help="also sheet.png: capture, albedo and all lights side by side")
    live = "with --format glb: also live.glb, whose light turns in shaders (docs/engines.md)"
    add("--live", dest="live_mesh", action="store_true", help=live)
    harmonics = "view-dependent colour of an albedo splat: zero, keep "
    harmonics += f"(default: {RelightRequest.harmonics})"
    add("--harmonics", metavar="WHICH", help=harmonics)
    bake = "textures for low-poly meshes: texture (GLB, relit and albedo); transfer adds images for shaders"
    add("--bake", dest="baked", nargs="+", action="extend", metavar="WHAT", help=bake)
    add("--texture-size", type=int, metavar="N", help="side of the textures in texels (default: as fine as the splat)")
    add(
        "--splat",
        metavar="FILE",
        help="the splat of the scene, for --format splat (default: the file that scene.json names)",
    )
    sky = "far background of a relit splat: new (shows the new light), keep (as captured), drop "
    sky += f"(default: {RelightRequest.sky})"
    add("--sky", metavar="WHICH", help=sky)
    part = (
        "new light on this part alone: box:at=X,Y,Z,size=A,B,C or sphere:at=X,Y,Z,radius=R in the frame of the splat, "
    )
    part += "a .ply of it, a .npy or .txt of rows, column:NAME of the splat file, object:NAME of a layout, "
    part += "a part made in the session; repeatable"
    add("--only", action="append", metavar="SPEC|FILE", help=part)
    add(
        "--keep",
        action="append",
        metavar="SPEC|FILE",
        help="new light on all but this part, as --only names it; repeatable",
    )
    lit = (
        "a part, as --only names it, in a light of its own: env=FILE|NAME, rotate=DEG, exposure=EV, tint=KELVIN|R,G,B; "
    )
    lit += "of a part made in the session also what it keeps; repeatable"
    add("--part", dest="parts", nargs="+", action="append", metavar="SPEC", help=lit)
    shadow = "with --only or --keep: what takes the new light also casts its shadow on the rest"
    add("--shadow-of-parts", action="store_true", help=shadow)
    quick = "stop at the first look at a splat: preview.png and relit_splat.ply in seconds, without a mesh"
    add("--quick", action="store_true", help=quick)
    add("--overwrite", action="store_true", help="replace results of other settings")
    add_display(add)
    add("--version", action="version", version=f"%(prog)s {VERSION}")
    add_completion(parser)
    offer(parser, MESHING_WORDS | WORDS)
    return parser
