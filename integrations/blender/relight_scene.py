"""Relight splats from Blender: import a scene folder or a splat, choose a light, run `relight`, see the result.

Install: Edit > Preferences > Add-ons > Install from Disk; then set the path of the `relight` command in the add-on's
preferences. File > Import > Splat to relight; then the sidebar of the 3D view (N), tab Relight.

The light is an HDRI, a built-in one, or the lamps of the Blender scene. Blender is z up, `relight` y up: (x, y, z) of
Blender is (x, z, -y) of the scene. Lamps go out as a file in the frame of the splat, suns and the background colour as
a Radiance picture.
"""

import json
import math
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np

bl_info = {
    "name": "Relight: splats",
    "author": "splat2mesh",
    "version": (1, 0, 0),
    "blender": (4, 2, 0),
    "location": "File > Import > Splat to relight; View3D > Sidebar > Relight",
    "description": "Relight a Gaussian splat by the lamps of the scene or an HDRI",
    "category": "Import-Export",
}

BUILT_IN = ("studio", "overcast", "noon", "sunset")
SCENE_FROM_BLENDER = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
SUN_WIDTH = 1024  # texels around the picture that holds suns: each 0.35 degrees, as wide as a real sun
LEAST_RADIUS = 1e-4  # a lamp of a smaller radius is a point


def background_angle(mapping_deg):
    """`--rotate` for an HDRI that Blender's background shows with this Z rotation of its Mapping node, in degrees."""
    return (90.0 - mapping_deg) % 360.0


def splat_from_blender(scene_folder):
    """Matrix (4, 4) from Blender's world to the frame of the splat of a scene folder."""
    description = json.loads((Path(scene_folder) / "scene.json").read_text("utf-8"))
    return np.linalg.inv(np.array(description["scene_from_splat"], float)) @ SCENE_FROM_BLENDER


def color_of(lamp):
    """Linear RGB of a Blender lamp with its temperature and exposure, both since Blender 4.5."""
    warmth = lamp.temperature_color if getattr(lamp, "use_temperature", False) else (1.0, 1.0, 1.0)
    return np.array(lamp.color, float) * np.array(warmth, float) * 2.0 ** getattr(lamp, "exposure", 0.0)


def lamp_fields(name, lamp, world, splat_from_world):
    """One entry of a file of lamps for a point, spot or area lamp; None for a sun.

    lamp: has Blender's `type`, `energy`, `color` and sizes. world: (4, 4), its matrix_world. Lengths keep their unit.
    Blender's watts are radiant: a point of P watts has the intensity P / (4 pi), an area P / (pi area).
    """
    matrix = splat_from_world @ np.array(world, float)
    place, light = matrix[:3, 3], lamp.energy * color_of(lamp)
    axes = matrix[:3, :3]
    ahead = -axes[:, 2] / np.linalg.norm(axes[:, 2])
    if lamp.type in ("POINT", "SPOT"):
        intensity, radius = light / (4.0 * math.pi), float(lamp.shadow_soft_size)
        fields = {"type": "sphere", "position": place.tolist(), "radius": 0.0, "intensity": intensity.tolist()}
        if lamp.type == "SPOT":
            edge = math.cos(0.5 * lamp.spot_size)
            full = math.degrees(math.acos(min(1.0, edge + (1.0 - edge) * lamp.spot_blend)))
            fields |= {"type": "spot", "target": (place + ahead).tolist()}
            fields |= {"cutoff_deg": math.degrees(0.5 * lamp.spot_size), "beam_deg": full}
        if radius >= LEAST_RADIUS:
            fields["radius"] = radius
    elif lamp.type == "AREA":
        tall = lamp.size_y if lamp.shape in ("RECTANGLE", "ELLIPSE") else lamp.size
        across, up = axes[:, 0] * lamp.size, axes[:, 1] * tall
        if lamp.shape in ("DISK", "ELLIPSE"):  # as a rectangle of their area
            across, up = (each * math.sqrt(math.pi) / 2.0 for each in (across, up))
        area = float(np.linalg.norm(np.cross(across, up)))
        fields = {"type": "rectangle", "center": place.tolist(), "edge_u": up.tolist(), "edge_v": across.tolist()}
        fields["radiance"] = (light / (math.pi * area)).tolist()
    else:
        return None
    return fields | {"name": name.strip()[:60] or "Lamp"}


def sun_picture(suns, background):
    """Radiance (H, W, 3) around the scene: a constant background and suns.

    suns: (irradiance (3,), direction towards the sun (3,) in Blender's axes) each. A sun is the texel at its direction.
    """
    height, width = SUN_WIDTH // 2, SUN_WIDTH
    picture = np.broadcast_to(np.asarray(background, np.float64), (height, width, 3)).copy()
    for irradiance, toward in suns:
        x, y, z = SCENE_FROM_BLENDER[:3, :3] @ np.asarray(toward, float) / np.linalg.norm(toward)
        row = min(int((0.5 - math.asin(max(-1.0, min(1.0, y))) / math.pi) * height), height - 1)
        column = int((0.5 - math.atan2(x, z) / (2.0 * math.pi)) * width) % width
        top, bottom = (math.pi * (0.5 - edge / height) for edge in (row, row + 1))
        solid_angle = 2.0 * math.pi / width * (math.sin(top) - math.sin(bottom))
        picture[row, column] += np.asarray(irradiance, float) / solid_angle
    return picture


def write_hdr(path, picture):
    """Write (H, W, 3) radiance as a Radiance picture without run lengths."""
    mantissa, exponent = np.frexp(picture.max(axis=-1))
    scale = np.where(mantissa > 0.0, mantissa * 256.0 / np.maximum(picture.max(axis=-1), 1e-38), 0.0)
    pixels = np.empty((*picture.shape[:2], 4), np.uint8)
    pixels[..., :3] = np.clip(picture * scale[..., None], 0, 255)
    pixels[..., 3] = np.where(mantissa > 0.0, np.clip(exponent + 128, 0, 255), 0)
    header = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {picture.shape[0]} +X {picture.shape[1]}\n"
    # Flat pixels: no row may begin like a packed one, which 2, 2 would.
    pixels[(pixels[..., 0] == 2) & (pixels[..., 1] == 2) & (pixels[..., 2] < 128), 0] = 3
    Path(path).write_bytes(header.encode() + pixels.tobytes())


def light_arguments(light, file, angle_deg, captured):
    """Arguments for a built-in light, "FILE" with its path, or "CAPTURED"."""
    name = {"FILE": str(file), "CAPTURED": "captured"}.get(light, light)
    turned = [] if light == "CAPTURED" else ["--rotate", f"{angle_deg:g}"]
    return ["--env", name, *turned, *(["--captured", f"{captured:g}"] if captured > 0.0 else [])]


def lamp_arguments(lamps, suns, background, captured, folder):
    """Arguments for lamps of the Blender scene, whose files are written to a folder. ValueError without any light."""
    arguments = []
    if suns or np.any(np.asarray(background) > 0.0):
        write_hdr(Path(folder) / "suns.hdr", sun_picture(suns, background))
        arguments += ["--env", str(Path(folder) / "suns.hdr")]
    if lamps:
        path = Path(folder) / "lamps.json"
        path.write_text(json.dumps({"about": "from Blender", "lamps": lamps}), "utf-8")
        arguments += ["--lamp", str(path)]
    if not arguments:
        raise ValueError("the Blender scene has no visible lamp and a black world: add a lamp, or choose another light")
    return [*arguments, "--captured", f"{captured:g}"]


def commands(path):
    """Paths of `relight` and `splat2mesh` for the path in the preferences. ValueError where they are not installed."""
    found = shutil.which(os.path.expanduser(path or "relight"))
    if found is None:
        raise ValueError(f"{path or 'relight'}: no such command; set its path in the preferences of this add-on")
    return found, str(Path(found).with_name("splat2mesh" + Path(found).suffix))


def scene_folder(source):
    """The scene folder of what was chosen: a folder, its scene.json, or a splat; it need not be there yet."""
    source = Path(source)
    if source.name == "scene.json":
        return source.parent
    return source if source.is_dir() else source.parent / source.name.split(".")[0]


def run(command):
    """Run a command to its end. Raises ValueError with the last line of what it says."""
    done = subprocess.run(command, capture_output=True, text=True)
    finish(done.returncode, done.stderr)


def finish(code, said):
    if code:
        lines = said.strip().splitlines()
        raise ValueError(lines[-1] if lines else f"relight ended with exit code {code}")


def import_scene(bpy, source, command):
    """Mesh a splat if it has no scene folder yet, and show its mesh as captured. Returns the new objects."""
    folder = scene_folder(source)
    if not (folder / "scene.json").is_file():
        run([commands(command)[1], str(source), "-o", str(folder), "-q"])
    before = set(bpy.data.objects)
    for chunk in sorted((folder / "chunks").glob("*.ply")):
        bpy.ops.wm.ply_import(
            filepath=str(chunk), forward_axis="NEGATIVE_Z", up_axis="Y", import_colors="SRGB", merge_verts=False
        )
    made = [each for each in bpy.data.objects if each not in before]
    material = unlit(bpy)
    for each in made:
        each.data.materials.append(material)
    collect(bpy, made, f"{folder.name} (captured)")
    bpy.context.scene.relight.source = str(folder)
    return made


def unlit(bpy):
    """A material that shows the vertex colours as they are."""
    material = bpy.data.materials.new("captured")
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    color, emission = tree.nodes.new("ShaderNodeVertexColor"), tree.nodes.new("ShaderNodeEmission")
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(color.outputs["Color"], emission.inputs["Color"])
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    return material


def collect(bpy, objects, name):
    """Move objects to a new collection, and hide what this add-on showed before."""
    for each in bpy.context.scene.collection.children:
        if each.get("relight"):
            each.hide_viewport = each.hide_render = True
    collection = bpy.data.collections.new(name)
    collection["relight"] = True
    bpy.context.scene.collection.children.link(collection)
    for each in objects:
        for old in list(each.users_collection):
            old.objects.unlink(each)
        collection.objects.link(each)


def request(bpy, folder):
    """The whole command for the settings of the scene; files of lamps and the result go to a folder."""
    scene, settings = bpy.context.scene, bpy.context.scene.relight
    if not settings.source:
        raise ValueError("import a splat or a scene folder first")
    source = Path(bpy.path.abspath(settings.source))
    if settings.light == "LAMPS":
        matrix = splat_from_blender(source)
        lamps, suns = [], []
        for each in scene.objects:
            if each.type != "LIGHT" or each.hide_render:
                continue
            world = np.array(each.matrix_world)
            fields = lamp_fields(each.name, each.data, world, matrix)
            if fields is None:
                suns.append((each.data.energy * color_of(each.data), world[:3, 2]))
            else:
                lamps.append(fields)
        arguments = lamp_arguments(lamps, suns, world_color(scene.world), settings.captured, folder)
    else:
        light, file, angle = settings.light, bpy.path.abspath(settings.hdri), settings.angle
        if light == "WORLD":
            light, (file, angle) = "FILE", world_picture(bpy, scene.world)
        arguments = light_arguments(light, file, angle, settings.captured)
    out = ["--format", "glb", *(["splat"] if settings.splat else []), "-o", str(Path(folder) / "relit"), "-q"]
    return [commands(preference(bpy))[0], str(source), *arguments, *out]


def world_color(world):
    """Linear RGB of a plain background; black for any other."""
    for node in world.node_tree.nodes if world is not None and world.node_tree else ():
        if node.type == "BACKGROUND" and not node.inputs["Color"].is_linked:
            return np.array(node.inputs["Color"].default_value[:3]) * node.inputs["Strength"].default_value
    return np.zeros(3)


def world_picture(bpy, world):
    """(path, `--rotate` in degrees) of the HDRI behind the Blender scene. ValueError without one."""
    nodes = world.node_tree.nodes if world is not None and world.node_tree else ()
    for node in nodes:
        if node.type == "TEX_ENVIRONMENT" and node.image is not None:
            socket = node.inputs["Vector"]
            mapping = socket.links[0].from_node if socket.is_linked else None
            turned = 0.0
            if mapping is not None and mapping.type == "MAPPING":
                turned = math.degrees(mapping.inputs["Rotation"].default_value[2])
            return bpy.path.abspath(node.image.filepath), background_angle(turned)
    raise ValueError("the Blender world has no Environment Texture: add one, or choose another light")


def preference(bpy):
    addon = bpy.context.preferences.addons.get(__name__)
    return addon.preferences.command if addon is not None else os.environ.get("RELIGHT_COMMAND", "relight")


def show(bpy, folder):
    """Import relit.glb of a result. Returns the new objects."""
    before = set(bpy.data.objects)
    bpy.ops.import_scene.gltf(filepath=str(Path(folder) / "relit" / "relit.glb"))
    made = [each for each in bpy.data.objects if each not in before]
    for each in [each for each in made if each.type == "LIGHT"]:  # the file carries the lamps, the scene has them
        made.remove(each)
        bpy.data.objects.remove(each)
    collect(bpy, made, f"relit: {bpy.context.scene.relight.light.lower()}")
    return made


def register():
    import bpy
    from bpy.props import BoolProperty, EnumProperty, FloatProperty, PointerProperty, StringProperty
    from bpy_extras.io_utils import ImportHelper

    kinds = [(name, name.capitalize(), f"The built-in light {name}") for name in BUILT_IN]
    kinds += [
        ("FILE", "HDRI file", "An .exr or .hdr file"),
        ("WORLD", "World's HDRI", "The Environment Texture of the Blender world, turned as its Mapping node turns it"),
        ("LAMPS", "Lamps of this scene", "Points, spots, areas and suns, and the colour of the Blender world"),
        ("CAPTURED", "As captured", "The light of the capture"),
    ]

    class RelightSettings(bpy.types.PropertyGroup):
        source: StringProperty(name="Scene", subtype="DIR_PATH", description="Scene folder")
        light: EnumProperty(name="Light", items=kinds, default="sunset")
        hdri: StringProperty(name="HDRI", subtype="FILE_PATH")
        angle: FloatProperty(name="Angle", description="Turns the light counter-clockwise from above, in degrees")
        captured: FloatProperty(name="Captured", min=0.0, soft_max=1.0, description="Captured light that stays")
        splat: BoolProperty(name="Also write the splat", description="relit_splat.ply beside relit.glb")
        result: StringProperty(name="Result", subtype="DIR_PATH")

    class RelightPreferences(bpy.types.AddonPreferences):
        bl_idname = __name__
        command: StringProperty(name="relight command", subtype="FILE_PATH", default="relight")

        def draw(self, context):
            self.layout.prop(self, "command")

    class RELIGHT_OT_scene(bpy.types.Operator, ImportHelper):
        """Import a scene folder (choose its scene.json) or a splat, which is meshed first"""

        bl_idname, bl_label, bl_options = "import_scene.relight", "Splat to relight", {"REGISTER", "UNDO"}
        filename_ext = ""
        filter_glob: StringProperty(default="*.ply;*.splat;*.spz;*.sog;scene.json", options={"HIDDEN"})

        def execute(self, context):
            try:
                import_scene(bpy, self.filepath, preference(bpy))
            except (ValueError, OSError) as error:
                self.report({"ERROR"}, str(error))
                return {"CANCELLED"}
            return {"FINISHED"}

    class RELIGHT_OT_relight(bpy.types.Operator):
        """Run relight with this light and show the result; Esc stops it"""

        bl_idname, bl_label = "scene.relight", "Relight"

        def start(self, context):
            self.folder = tempfile.mkdtemp(prefix="relight_")
            self.said = open(os.path.join(self.folder, "log.txt"), "w+", encoding="utf-8")
            self.process = subprocess.Popen(request(bpy, self.folder), stdout=subprocess.DEVNULL, stderr=self.said)

        def end(self, context):
            self.said.seek(0)
            finish(self.process.wait(), self.said.read())
            self.said.close()
            context.scene.relight.result = os.path.join(self.folder, "relit")
            show(bpy, self.folder)
            return {"FINISHED"}

        def stopped(self, error):
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}

        def execute(self, context):
            try:
                self.start(context)
                return self.end(context)
            except (ValueError, OSError) as error:
                return self.stopped(error)

        def invoke(self, context, event):
            try:
                self.start(context)
            except (ValueError, OSError) as error:
                return self.stopped(error)
            self.timer = context.window_manager.event_timer_add(0.2, window=context.window)
            context.window_manager.modal_handler_add(self)
            context.workspace.status_text_set("Relighting; Esc stops")
            return {"RUNNING_MODAL"}

        def modal(self, context, event):
            if event.type == "ESC":
                self.process.terminate()
            elif event.type != "TIMER" or self.process.poll() is None:
                return {"PASS_THROUGH"}
            context.window_manager.event_timer_remove(self.timer)
            context.workspace.status_text_set(None)
            try:
                return {"CANCELLED"} if event.type == "ESC" else self.end(context)
            except (ValueError, OSError) as error:
                return self.stopped(error)

    class RELIGHT_PT_scene(bpy.types.Panel):
        bl_label, bl_space_type, bl_region_type, bl_category = "Relight a splat", "VIEW_3D", "UI", "Relight"

        def draw(self, context):
            settings, layout = context.scene.relight, self.layout
            layout.operator(RELIGHT_OT_scene.bl_idname)
            layout.prop(settings, "source")
            layout.prop(settings, "light")
            if settings.light == "FILE":
                layout.prop(settings, "hdri")
            if settings.light == "FILE" or settings.light in BUILT_IN:
                layout.prop(settings, "angle")
            layout.prop(settings, "captured")
            layout.prop(settings, "splat")
            layout.operator(RELIGHT_OT_relight.bl_idname)
            if settings.result:
                layout.prop(settings, "result")

    register.classes = (RelightSettings, RelightPreferences, RELIGHT_OT_scene, RELIGHT_OT_relight, RELIGHT_PT_scene)
    for each in register.classes:
        bpy.utils.register_class(each)
    bpy.types.Scene.relight = PointerProperty(type=RelightSettings)
    register.menu = lambda self, context: self.layout.operator(RELIGHT_OT_scene.bl_idname)
    bpy.types.TOPBAR_MT_file_import.append(register.menu)


def unregister():
    import bpy

    bpy.types.TOPBAR_MT_file_import.remove(register.menu)
    del bpy.types.Scene.relight
    for each in reversed(register.classes):
        bpy.utils.unregister_class(each)
