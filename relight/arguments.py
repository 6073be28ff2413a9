"""What the relight command takes: its options, in the groups of its help. Imports nothing heavy."""

import argparse
from typing import Any

from splat2mesh.base.commandline import Parser
from splat2mesh.base.manual import add_manuals
from splat2mesh.base.version import VERSION
from splat2mesh.cli import add_display, add_meshing, add_tiling

from .options import DEFAULT_TOLERANCE, PLACE_TOLERANCE, LightingOptions
from .output.kinds import FILES
from .request import RelightRequest
from .transfer import METHODS
from .transfer.settings import EFFECTS, GLOSS

EXAMPLES = """examples:
  relight garden.ply --env sunset                  meshes the splat into the scene folder garden/ first
  relight garden                                   under the built-in studio: garden/relit/studio_0/
  relight garden --env stpeters.exr --rotate 45
  relight bust.obj --env noon --albedo white --format glb ply npy -o bust_noon
  relight garden --env sunset --rotate 0:350:10    a folder for each of 36 angles, the transfer computed once
  relight lounge --env overcast --lamps off --format splat
  relight lounge --captured .1 --lamp 1.5,1.5,-1.5 color=2700K   dusk, and a lamp put in
  relight patio --insert statue.glb --at 1.55,0,-.6 --turn 30 --on floor   its shadow, and its own light
  relight city --env sunset --format splat --workers 8   a city that splat2mesh made in tiles
  relight garden --env noon --plan                 which effects this scene calls for, and what accuracy costs
  relight garden --env hdris/ --sheet              every light of a folder, and all of them in one picture
  relight garden --env sunset --format web         relit.html: a page to turn the light in, that any browser opens

Every folder holds report.json: inputs, settings, times, warnings. A mesh's default folder is ./NAME_relit/."""


class OfInsert(argparse.Action):
    """A word for the object that was named last; `--at` of two numbers is of the sun, one that is left of a probe."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: str | None = None) -> None:
        """Put it to the words of that object."""
        inserted = getattr(namespace, "inserted", None)
        if self.dest == "at" and str(values).count(",") < 2:
            namespace.at = values
        elif self.dest == "at" and (not inserted or any(word.startswith("at=") for word in inserted[-1])):
            namespace.probe_at = [*getattr(namespace, "probe_at", []), values]
        elif not inserted:
            parser.error(f"--{self.dest} {values}: it belongs to an --insert before it")
        else:
            inserted[-1].append(f"{self.dest}={values}")


def parser() -> argparse.ArgumentParser:
    """The command line of relight."""
    parser = Parser(
        prog="relight",
        description="Put a scene under any light, with the shadows of everything on everything.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        argument_default=argparse.SUPPRESS,
    )
    parser.signed = "--rotate", "--up", "--eye", "--at", "--north", "--turn", "--white"
    parser.signed_words = ("--lamp",)
    scene = "scene folder of splat2mesh, a splat, which is meshed first, or a mesh: .ply .obj .glb .stl"
    parser.add_argument("scene", metavar="SCENE", help=scene)

    add = parser.add_argument_group("light").add_argument
    names = "studio, overcast, noon, sunset"
    add(
        "--env",
        metavar="FILE|NAME|FOLDER",
        help=f".exr or .hdr file, a folder of them, each of which lights the scene, {names}, or captured, as it was "
        "captured (default: captured where anything is put in or that light is changed, else studio)",
    )
    rotate = "turn the light about +y, counter-clockwise from above; a range, end included, fills several folders"
    add("--rotate", dest="angles_deg", metavar="DEG|A:B:STEP", help=rotate)
    exposure = "show radiance times 2^EV (default: as the capture was exposed, else by the brightest vertices)"
    lamp = "put in a lamp: its place in the frame of the splat, and what differs from a warm bulb "
    lamp += "(1.5,1.5,-1.5 radius=.1 color=3000K brightness=+1EV), or a file of lamps (docs/lamps.md); repeatable"
    add("--lamp", dest="placed", nargs="+", action="append", metavar="SPEC|FILE", help=lamp)
    captured = "how much of the captured light stays, 0 for night (default: 1 beside lamps, 0 under another light)"
    add("--captured", type=float, metavar="FACTOR", help=captured)
    sun = "instead of --env the clear sky of a date and time with its zone (2026-06-21T19:30+02:00)"
    add("--sun", metavar="TIME", help=sun)
    where = "of --sun latitude and longitude (48.85,2.35); behind --insert where its origin goes, else "
    where += "where a probe stands (1.55,0,-.6)"
    add("--at", action=OfInsert, metavar="LAT,LON|X,Y,Z", help=where)
    add("--north", dest="north_deg", type=float, metavar="DEG", help="turn north from -z, counter-clockwise from above")
    day = "times of the day of --sun (05:00-21:30/15min): a folder for each, at one exposure, and with ffmpeg a film"
    add("--day", metavar="A-B/STEP", help=day)
    insert = "put in a mesh or a splat, in the frame of the splat; or a layout of several (docs/insert.md); repeatable"
    add("--insert", dest="inserted", nargs="+", action="append", metavar="FILE", help=insert)
    turn = "turn the --insert before it about the vertical, counter-clockwise from above"
    add("--turn", action=OfInsert, metavar="DEG", help=turn)
    scale = "how many units of the splat a unit of the --insert before it is (default: 1)"
    add("--scale", action=OfInsert, metavar="S", help=scale)
    add("--on", action=OfInsert, metavar="floor", help="let the --insert before it down on what is below")
    add("--env-scale", type=float, metavar="FACTOR", help="dim or raise the light of --env (default: 1)")
    lamps = "captured lamps of a closed room: keep, off, a factor on their light, or a factor of each by its number "
    lamps += f"(default: {LightingOptions.lamps})"
    add("--lamps", metavar="keep|off|FACTOR|1=off,3=.5", help=lamps)
    add("--open", dest="opened", choices=("ceiling",), help="let the light into a closed room from above")
    add("--exposure", dest="exposure_ev", type=float, metavar="EV", help=exposure)

    add = parser.add_argument_group("surface and accuracy").add_argument
    albedo = "estimated (the light of the capture taken out), captured (the scene's colours), white, or FILE.npy, "
    albedo += "(V, 3) linear (default: estimated; of mesh files captured)"
    add("--albedo", metavar="WHICH", help=albedo)
    capture = "the light of the capture, where it is known (.exr, .hdr): then only its exposure is estimated"
    add("--capture-env", metavar="FILE", help=capture)
    tint = "the colour of the captured light, where the estimate is wrong: 5600K, linear red,green,blue, or a name"
    add("--capture-tint", metavar="R,G,B|KELVIN", help=tint)
    white = "instead of --capture-tint a place in the frame of the splat whose surface is white or grey"
    add("--white", dest="white_at", metavar="X,Y,Z", help=white)
    method = f"{', '.join(METHODS)}; the last three know no shadows, auto is raytraced "
    method += f"(default: {LightingOptions.method})"
    add("--method", metavar="NAME", help=method)
    tolerance = "relative error of the light that is accepted; what it does not call for is not computed "
    tolerance += f"(default: {DEFAULT_TOLERANCE:g}, which is {DEFAULT_TOLERANCE:.0%}%, of places {PLACE_TOLERANCE:g})"
    add("--tolerance", metavar="ERROR", help=tolerance)
    budget = "the most exact light in so much time, instead of a tolerance"
    add("--budget", type=float, dest="budget_s", metavar="SECONDS", help=budget)
    effects = f"auto (what the scene calls for), none, or some of {','.join((*EFFECTS, GLOSS))} "
    effects += f"(default: {LightingOptions.effects})"
    add("--effects", metavar="LIST", help=effects)
    add("--bands", type=int, metavar="1..10", help="SH bands (default: as planned)")
    add("--rays", type=int, metavar="N", help="rays per vertex (default: as planned)")
    add("--plan", action="store_true", help="print what would be done, and what accuracy costs here; do nothing")
    add(
        "--no-cache",
        dest="caching",
        action="store_const",
        const="none",
        help="neither use nor keep what was computed, in SCENE/cache",
    )
    add("--clear-cache", action="store_true", help="remove first what is kept in SCENE/cache")
    add("--seed", type=int, metavar="N", help=f"seed of the ray directions (default: {LightingOptions.seed})")

    add = parser.add_argument_group("session").add_argument
    add("--view", action="store_true", help="open a window to turn, swap and compare lights in; h lists its keys")
    add("--screenshot", metavar="FILE", help="write a .png, .jpg or .webp of the session, and open no window")
    serve = "the session, or the page that --format web wrote as a folder, in a browser of this machine, at the "
    serve += "address that is printed (default port: any free one)"
    add("--serve", nargs="?", const=0, type=int, metavar="PORT", help=serve)

    add = parser.add_argument_group("motion").add_argument
    add(
        "--animate",
        dest="animated",
        action="store_true",
        help="light every frame of an animated .glb; with ffmpeg a film too",
    )
    add("--fps", type=float, metavar="N", help=f"frames per second of --animate (default: {RelightRequest.fps:g})")

    add_meshing(parser.add_argument_group("meshing of a splat that has no scene folder yet").add_argument)
    add_tiling(parser)
    add = parser.add_argument_group("results").add_argument
    output = "folder to write, for several angles the one for their folders (default: SCENE/relit/ENV_ANGLE)"
    add("-o", "--output", metavar="OUT", help=output)
    kinds = f"any of {' '.join(FILES)} (default: glb png, and splat where the scene was made of one); of a city any of "
    kinds += "glb ply npy splat sog"
    add("--format", dest="formats", nargs="+", action="extend", metavar="KIND", help=kinds)
    add("--sheet", action="store_true", help="sheet.png too: captured, albedo and the lights side by side")
    live = "with --format glb: live.glb too, whose light shaders turn (docs/engines.md)"
    add("--live", dest="live_mesh", action="store_true", help=live)
    harmonics = "colour of an albedo splat that depends on the view: zero, keep "
    harmonics += f"(default: {RelightRequest.harmonics})"
    add("--harmonics", metavar="WHICH", help=harmonics)
    bake = "textures for low-poly meshes: texture (GLB, relit and as albedo); with transfer also its images for shaders"
    add("--bake", dest="baked", nargs="+", action="extend", metavar="WHAT", help=bake)
    add("--texture-size", type=int, metavar="N", help="side of the textures in texels (default: as fine as the splat)")
    add("--splat", metavar="FILE", help="the splat of the scene, for --format splat (default: where scene.json says)")
    sky = "the far background of a relit splat: new (the new light), keep (as captured), drop "
    sky += f"(default: {RelightRequest.sky})"
    add("--sky", metavar="WHICH", help=sky)
    lights = "other lights that --format live and web hold, beside that of --env and the built-in ones"
    add("--lights", nargs="+", metavar="FILE|NAME", help=lights)
    add("--overwrite", action="store_true", help="replace results of other settings")
    add_display(add)
    add("--version", action="version", version=f"%(prog)s {VERSION}")
    add_manuals(parser)
    return parser
