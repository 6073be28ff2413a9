"""Live light in Blender: reads live.glb of `relight SCENE --format glb --live`, with a slider.

Install: Edit > Preferences > Add-ons > Install from Disk. Then File > Import > Live light (.glb), and the sidebar
of the 3D view (N), tab Relight. From a script: `import relight_light; relight_light.load("live.glb")`.

Blender's own importer drops the transfer (16-bit attributes of four numbers), so the file is read here, by its
specification. The light is in the shader nodes alone: Attribute nodes for the transfer, nine products, and a driver for
each number of the light, which is a short sum of sines and cosines of the angle. Such drivers need no permission to run
Python, so that a saved .blend works without this add-on.
"""

import json
import math
import struct

import numpy as np

bl_info = {
    "name": "Relight: live light",
    "author": "splat2mesh",
    "version": (1, 0, 0),
    "blender": (4, 0, 0),
    "location": "File > Import > Live light (.glb); View3D > Sidebar > Relight",
    "description": "A mesh whose light can be turned, swapped and exposed",
    "category": "Import-Export",
}

KEY, VERSION = "relight_live", 1
ANGLE, EXPOSURE = "relight_angle", "relight_exposure"  # custom properties of the Blender scene
TYPES = {5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
SIZES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def read(path):
    """Contents of live.glb: (description, list of dicts of arrays: positions, normals, albedo, transfer
    (V, 12), faces).

    Positions and normals in Blender's axes. Raises ValueError, in one line, for another file.
    """
    with open(path, "rb") as file:
        data = file.read()
    try:
        return _read(path, data)
    except (KeyError, IndexError, TypeError, AttributeError, OverflowError, RecursionError, struct.error) as error:
        raise ValueError(f"{path}: damaged ({type(error).__name__}: {error}); export it again") from error


def _read(path, data):
    if len(data) < 20 or data[:4] != b"glTF":
        raise ValueError(f"{path}: not a binary glTF")
    length = struct.unpack_from("<I", data, 12)[0]
    document, binary = json.loads(data[20 : 20 + length]), data[28 + length :]
    live = document["scenes"][document.get("scene", 0)].get("extras", {}).get(KEY)
    if live is None:
        raise ValueError(f"{path}: has no live light; write it with relight SCENE --format glb --live")
    if live["version"] > VERSION or live["coefficients"] != 9:
        raise ValueError(f"{path}: live light of version {live['version']}, this add-on reads version {VERSION}")

    def array(index):
        accessor = document["accessors"][index]
        view = document["bufferViews"][accessor["bufferView"]]
        size = SIZES[accessor["type"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        values = np.frombuffer(binary, TYPES[accessor["componentType"]], accessor["count"] * size, start)
        values = values.reshape(-1, size)
        return np.maximum(values / np.float32(32767.0), -1.0) if accessor.get("normalized") else values

    parts = []
    for mesh in document["meshes"]:
        for primitive in mesh["primitives"]:
            named = primitive["attributes"]
            parts.append(
                {
                    "name": mesh["name"],
                    "positions": upright(array(named["POSITION"])),
                    "normals": upright(array(named["NORMAL"])),
                    "albedo": array(named["COLOR_0"])[:, :3],
                    "transfer": np.hstack([array(named[f"_TRANSFER_{i}"]) for i in range(3)]),
                    "faces": array(primitive["indices"]).reshape(-1, 3).astype(np.int32),
                }
            )
    return live, parts


def upright(vectors):
    """(x, y, z) of glTF, y up, as Blender has them: (x, -z, y)."""
    return np.stack([vectors[:, 0], -vectors[:, 2], vectors[:, 1]], axis=1).astype(np.float32)


def turned(sh, degrees):
    """Nine radiance coefficients (9, 3) of light turned about glTF's +y, counter-clockwise from above.

    Band 2 is rewritten about y first: the polar axis of the basis is z.
    """
    a, h = math.radians(degrees), math.sqrt(3.0) / 2.0
    c, s, c2, s2 = math.cos(a), math.sin(a), math.cos(2 * a), math.sin(2 * a)
    sh = np.asarray(sh, float)
    around, along = h * sh[6] - 0.5 * sh[8], -0.5 * sh[6] - h * sh[8]
    new = around * c2 - sh[7] * s2
    rows = [sh[0], sh[1], sh[2] * c - sh[3] * s, sh[3] * c + sh[2] * s, sh[4] * c + sh[5] * s, sh[5] * c - sh[4] * s]
    return np.stack([*rows, h * new - 0.5 * along, sh[7] * c2 + around * s2, -0.5 * new - h * along])


def waves(sh):
    """(5, 9, 3): every coefficient as 1, cos a, sin a, cos 2a, sin 2a times these, for light turned by a."""
    angles = np.arange(5) * 2 * np.pi / 5
    basis = np.stack([np.ones(5), np.cos(angles), np.sin(angles), np.cos(2 * angles), np.sin(2 * angles)], axis=1)
    return np.einsum("ij,jkc->ikc", np.linalg.inv(basis), np.stack([turned(sh, math.degrees(a)) for a in angles]))


def expression(five):
    """A driver's expression of these five numbers, with `a` the angle in degrees."""
    terms = ("1", "cos(radians(a))", "sin(radians(a))", "cos(2*radians(a))", "sin(2*radians(a))")
    kept = [f"{value:.7g}*{term}" for value, term in zip(five, terms, strict=True) if abs(value) > 1e-9]
    return " + ".join(kept) or "0"


def load(path, context=None):
    """Bring live.glb into the scene: the list of new objects, one a chunk, all of one material."""
    import bpy

    context = context or bpy.context
    live, parts = read(path)
    scene = context.scene
    scene[ANGLE], scene[EXPOSURE] = float(live["light"]["angle_deg"]), float(live["exposure"])
    scene.id_properties_ui(ANGLE).update(min=-360.0, max=360.0, description="Light turned about the vertical, degrees")
    scene.id_properties_ui(EXPOSURE).update(min=0.0, soft_max=10.0, description="Display value per unit of radiance")
    material = make_material(bpy, scene, live["light"]["sh"])
    objects = []
    for part in parts:
        mesh = bpy.data.meshes.new(part["name"])
        mesh.from_pydata(part["positions"], [], part["faces"].tolist())
        for name, values in (("relight_albedo", part["albedo"]), ("relight_tint", part["transfer"][:, 9:])):
            mesh.attributes.new(name, "FLOAT_VECTOR", "POINT").data.foreach_set("vector", flat(values))
        for i in range(3):
            attribute = mesh.attributes.new(f"relight_{i}", "FLOAT_VECTOR", "POINT")
            attribute.data.foreach_set("vector", flat(part["transfer"][:, 3 * i : 3 * i + 3]))
        mesh.normals_split_custom_set_from_vertices(part["normals"].tolist())
        mesh.materials.append(material)
        thing = bpy.data.objects.new(part["name"], mesh)
        context.collection.objects.link(thing)
        objects.append(thing)
    return objects


def flat(values):
    return np.ascontiguousarray(values, np.float32).ravel()


def make_material(bpy, scene, sh):
    """The material: emission = albedo * tint * max(sum of transfer times light, 0) * exposure."""
    material = bpy.data.materials.new("relight")
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()

    def node(kind, **settings):
        made = tree.nodes.new(kind)
        for name, value in settings.items():
            setattr(made, name, value)
        return made

    def vector(operation, *inputs):
        made = node("ShaderNodeVectorMath", operation=operation)
        for socket, given in zip(made.inputs, inputs, strict=False):
            if hasattr(given, "is_linked"):
                tree.links.new(given, socket)
            elif given is not None:
                socket.default_value = given
        return made

    def attribute(name):
        return node("ShaderNodeAttribute", attribute_name=name).outputs["Vector"]

    received, factors = (0.0, 0.0, 0.0), waves(sh)
    for i in range(3):
        apart = node("ShaderNodeSeparateXYZ")
        tree.links.new(attribute(f"relight_{i}"), apart.inputs[0])
        for k in range(3):
            product = vector("MULTIPLY_ADD", apart.outputs[k], None, received)
            for channel in range(3):
                drive(product.inputs[1], channel, scene, ANGLE, expression(factors[:, 3 * i + k, channel]))
            received = product.outputs[0]
    shown = vector("MAXIMUM", received, (0.0, 0.0, 0.0)).outputs[0]
    for name in ("relight_albedo", "relight_tint"):
        shown = vector("MULTIPLY", shown, attribute(name)).outputs[0]
    emission, output = node("ShaderNodeEmission"), node("ShaderNodeOutputMaterial")
    tree.links.new(shown, emission.inputs["Color"])
    drive(emission.inputs["Strength"], -1, scene, EXPOSURE, "a")
    tree.links.new(emission.outputs[0], output.inputs["Surface"])
    return material


def drive(socket, index, scene, name, text):
    """Let a driver set a socket from a custom property of the Blender scene, called `a` in the expression."""
    driver = socket.driver_add("default_value", index).driver
    variable = driver.variables.new()
    variable.name = "a"
    variable.targets[0].id_type = "SCENE"
    variable.targets[0].id = scene
    variable.targets[0].data_path = f'["{name}"]'
    driver.expression = text


def register():
    import bpy
    from bpy_extras.io_utils import ImportHelper

    class RELIGHT_OT_import(bpy.types.Operator, ImportHelper):
        bl_idname, bl_label, bl_options = "import_scene.relight_live", "Live light (.glb)", {"REGISTER", "UNDO"}
        filename_ext = ".glb"

        def execute(self, context):
            try:
                load(self.filepath, context)
            except (ValueError, KeyError, OSError) as error:
                self.report({"ERROR"}, str(error))
                return {"CANCELLED"}
            return {"FINISHED"}

    class RELIGHT_PT_panel(bpy.types.Panel):
        bl_label, bl_space_type, bl_region_type, bl_category = "Light", "VIEW_3D", "UI", "Relight"

        def draw(self, context):
            for name, text in ((ANGLE, "Angle"), (EXPOSURE, "Exposure")):
                if name in context.scene:
                    self.layout.prop(context.scene, f'["{name}"]', text=text)

    register.classes = RELIGHT_OT_import, RELIGHT_PT_panel
    for each in register.classes:
        bpy.utils.register_class(each)
    register.menu = lambda self, context: self.layout.operator(RELIGHT_OT_import.bl_idname)
    bpy.types.TOPBAR_MT_file_import.append(register.menu)


def unregister():
    import bpy

    bpy.types.TOPBAR_MT_file_import.remove(register.menu)
    for each in reversed(register.classes):
        bpy.utils.unregister_class(each)
