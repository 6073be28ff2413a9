## Live light on a mesh in Godot 4: reads live.glb of `relight SCENE --format glb --live`.
##
## Add this script to a Node3D, set `file`, and turn `angle_deg`. The file is read here, as the
## importers of older Godot drop the transfer.
class_name RelightMesh
extends Node3D

const KEY := "relight_live"
const VERSION := 1
const SHADER := preload("relight_mesh.gdshader")
const GLTF_MAGIC := 0x46546c67

@export_file("*.glb") var file := ""
## The light turned about the vertical, degrees, counter-clockwise from above.
@export_range(-360.0, 360.0) var angle_deg := 0.0:
	set(value):
		angle_deg = value
		_update()
## Display value per unit of radiance.
@export var exposure := 1.0:
	set(value):
		exposure = value
		_update()

var material := ShaderMaterial.new()
var _sh := PackedVector3Array()


func _ready() -> void:
	material.shader = SHADER
	var problem := load_file(file)
	if problem != "":
		push_error("Relight: %s: %s" % [file, problem])


## Shows the meshes of a file; "" or, in one line, why it cannot.
func load_file(path: String) -> String:
	var data := FileAccess.get_file_as_bytes(path)
	if data.size() < 20 or data.decode_u32(0) != GLTF_MAGIC:
		return "not a binary glTF"
	var length := data.decode_u32(12)
	var gltf: Dictionary = JSON.parse_string(data.slice(20, 20 + length).get_string_from_utf8())
	var live: Dictionary = gltf["scenes"][0].get("extras", {}).get(KEY, {})
	if live.is_empty():
		return "has no live light; write it with relight SCENE --format glb --live"
	if live["version"] > VERSION or live["coefficients"] != 9:
		return "live light of version %d, this script reads %d" % [live["version"], VERSION]
	_sh.resize(9)
	for j in 9:
		var row: Array = live["light"]["sh"][j]
		_sh[j] = Vector3(row[0], row[1], row[2])
	for mesh: Dictionary in gltf["meshes"]:
		for primitive: Dictionary in mesh["primitives"]:
			_show(gltf, data, 28 + length, primitive)
	angle_deg = live["light"]["angle_deg"]
	exposure = live["exposure"]
	return ""


func _show(gltf: Dictionary, data: PackedByteArray, binary: int, primitive: Dictionary) -> void:
	var named: Dictionary = primitive["attributes"]
	var arrays := []
	arrays.resize(Mesh.ARRAY_MAX)
	arrays[Mesh.ARRAY_VERTEX] = _vectors(_read(gltf, data, binary, named["POSITION"]))
	arrays[Mesh.ARRAY_NORMAL] = _vectors(_read(gltf, data, binary, named["NORMAL"]))
	arrays[Mesh.ARRAY_CUSTOM0] = _read(gltf, data, binary, named["_TRANSFER_0"])
	arrays[Mesh.ARRAY_CUSTOM1] = _read(gltf, data, binary, named["_TRANSFER_1"])
	arrays[Mesh.ARRAY_CUSTOM2] = _read(gltf, data, binary, named["_TRANSFER_2"])
	# Colours of Godot have 8 bits, in which linear albedo shows bands: it travels as numbers.
	arrays[Mesh.ARRAY_CUSTOM3] = _read(gltf, data, binary, named["COLOR_0"])
	var faces := PackedInt32Array()
	for value in _read(gltf, data, binary, primitive["indices"]):
		faces.append(int(value))
	# Front faces wind clockwise in Godot, counter-clockwise in glTF.
	for i in range(0, faces.size(), 3):
		var second := faces[i + 1]
		faces[i + 1] = faces[i + 2]
		faces[i + 2] = second
	arrays[Mesh.ARRAY_INDEX] = faces
	var flags := 0
	for i in 3:
		var shift := Mesh.ARRAY_FORMAT_CUSTOM0_SHIFT + i * Mesh.ARRAY_FORMAT_CUSTOM_BITS
		flags |= Mesh.ARRAY_CUSTOM_RGBA_FLOAT << shift
	flags |= Mesh.ARRAY_CUSTOM_RGB_FLOAT << Mesh.ARRAY_FORMAT_CUSTOM3_SHIFT
	var made := ArrayMesh.new()
	made.add_surface_from_arrays(Mesh.PRIMITIVE_TRIANGLES, arrays, [], {}, flags)
	var shown := MeshInstance3D.new()
	shown.mesh = made
	shown.material_override = material
	add_child(shown)


## The numbers of an accessor: floats, normalised 16-bit integers, or indices of 16 or 32 bits.
func _read(gltf: Dictionary, data: PackedByteArray, binary: int, index: int) -> PackedFloat32Array:
	var accessor: Dictionary = gltf["accessors"][index]
	var view: Dictionary = gltf["bufferViews"][int(accessor["bufferView"])]
	var at := binary + int(view.get("byteOffset", 0)) + int(accessor.get("byteOffset", 0))
	var width: int = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
	var count := width * int(accessor["count"])
	var kind := int(accessor["componentType"])
	if kind == 5126:
		return data.slice(at, at + 4 * count).to_float32_array()
	var values := PackedFloat32Array()
	values.resize(count)
	for i in count:
		match kind:
			5122:
				values[i] = maxf(data.decode_s16(at + 2 * i) / 32767.0, -1.0)
			5123:
				values[i] = data.decode_u16(at + 2 * i)
			5125:
				values[i] = data.decode_u32(at + 4 * i)
	return values


func _vectors(values: PackedFloat32Array) -> PackedVector3Array:
	var result := PackedVector3Array()
	for i in range(0, values.size(), 3):
		result.append(Vector3(values[i], values[i + 1], values[i + 2]))
	return result


func _update() -> void:
	if _sh.size() == 9:
		material.set_shader_parameter("light", turned(_sh, angle_deg))
		material.set_shader_parameter("exposure", exposure)


## Nine radiance coefficients of light turned about +y. Band 2 is rewritten about y first: the
## polar axis of the basis is z.
static func turned(sh: PackedVector3Array, degrees: float) -> PackedVector3Array:
	var a := deg_to_rad(degrees)
	var h := sqrt(3.0) / 2.0
	var around := h * sh[6] - 0.5 * sh[8]
	var along := -0.5 * sh[6] - h * sh[8]
	var now := around * cos(2.0 * a) - sh[7] * sin(2.0 * a)
	var result := sh.duplicate()
	result[2] = sh[2] * cos(a) - sh[3] * sin(a)
	result[3] = sh[3] * cos(a) + sh[2] * sin(a)
	result[4] = sh[4] * cos(a) + sh[5] * sin(a)
	result[5] = sh[5] * cos(a) - sh[4] * sin(a)
	result[6] = h * now - 0.5 * along
	result[7] = sh[7] * cos(2.0 * a) + around * sin(2.0 * a)
	result[8] = -0.5 * now - h * along
	return result
