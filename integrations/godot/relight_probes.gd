## Light probes of a captured place in Godot 4: reads probes.json of
## `relight SCENE --format probe --probes 4x2x4` and lights what moves among them.
##
## Add this script to a Node3D at the place of relit.glb and set `file`. What is to be lit is a
## child of it, in any depth, with a material of relight_probes.gdshader.
class_name RelightProbes
extends Node3D

const FORMAT := "relight-probes"
const VERSION := 1

@export_file("*.json") var file := ""
## Factor on the light.
@export var exposure := 1.0

var _places := PackedVector3Array()
var _lights: Array[PackedVector3Array] = []


func _ready() -> void:
	var problem := load_file(file)
	if problem != "":
		push_error("Relight: %s: %s" % [file, problem])


## Reads the probes of a file; "" or, in one line, why it cannot.
func load_file(path: String) -> String:
	var meta: Variant = JSON.parse_string(FileAccess.get_file_as_string(path))
	if not meta is Dictionary or meta.get("format") != FORMAT:
		return "not a file of light probes; write it with relight SCENE --format probe --probes 4x2x4"
	if meta["version"] > VERSION:
		return "version %d, this script reads %d" % [meta["version"], VERSION]
	_places.clear()
	_lights.clear()
	for probe: Dictionary in meta["probes"]:
		var at: Array = probe["position"]
		_places.append(Vector3(at[0], at[1], at[2]))
		var light := PackedVector3Array()
		for row: Array in probe["sh"]:
			light.append(Vector3(row[0], row[1], row[2]))
		_lights.append(light)
	return ""


func _process(_delta: float) -> void:
	if _places.is_empty():
		return
	for each: Node in find_children("*", "GeometryInstance3D", true, false):
		var shown: GeometryInstance3D = each
		var light := light_at(shown.global_transform * shown.get_aabb().get_center())
		for j in 9:
			shown.set_instance_shader_parameter("relight_%d" % j, light[j] * exposure)


## Nine coefficients, red, green and blue, of irradiance over pi at a place of the world.
func light_at(world: Vector3) -> PackedVector3Array:
	var place := to_local(world)
	var away := []
	for i in _places.size():
		away.append([_places[i].distance_to(place), i])
	away.sort()
	var distances := away.map(func(pair: Array) -> float: return pair[0])
	var shares := weights(distances)
	var result := PackedVector3Array()
	result.resize(9)
	for k in shares.size():
		for j in 9:
			result[j] += shares[k] * _lights[away[k][1]][j]
	return result


## What the nearest eight probes count, of sorted distances: each the square of 1 / distance less
## that of the ninth, so nothing jumps (Franke and Little's weights).
static func weights(distances: Array) -> Array:
	var reach := 0.0
	if distances.size() > 8:
		reach = 1.0 / maxf(distances[8], 0.000001)
	var whole := 0.0
	var result := []
	for k in mini(8, distances.size()):
		var near := 1.0 / maxf(distances[k], 0.000001) - reach
		var weight := near * near
		if k == 0:
			weight += 0.000000000001
		result.append(weight)
		whole += weight
	for k in result.size():
		result[k] /= whole
	return result
