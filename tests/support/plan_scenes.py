"""Scenes and skies made to call for one effect each, and what light on them converges to."""

import numpy as np
import open3d as o3d

from relight import Environment
from relight.light.projections import texel_directions
from relight.options import LightingOptions
from relight.planning.planner import planned
from relight.planning.sample import PlannedScene
from relight.transfer.bounces import Interreflection, with_bounces
from relight.transfer.occluder import Occluder
from relight.transfer.reference import reference
from relight.transfer.volume import Foliage
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

X, Y, Z = np.eye(3)


def square(corner, edge_u, edge_v, count):
    """A square of count x count cells that faces edge_u x edge_v: vertices, normals, faces."""
    u, v = np.meshgrid(*2 * [np.linspace(0, 1, count + 1)], indexing="ij")
    vertices = np.asarray(corner) + u.reshape(-1, 1) * edge_u + v.reshape(-1, 1) * edge_v
    first = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).reshape(-1, 1)
    faces = (first + np.array([0, count + 1, count + 2, 0, count + 2, 1])).reshape(-1, 3)
    normal = np.cross(edge_u, edge_v)
    return vertices, np.tile(normal / np.linalg.norm(normal), (len(vertices), 1)), faces


def ball(radius=1.0, center=(0.0, 0.0, 0.0), resolution=16):
    """A sphere; its faces are flat, but nothing of it rises above any of its vertices' horizon."""
    mesh = o3d.geometry.TriangleMesh.create_sphere(radius, resolution)
    vertices = np.asarray(mesh.vertices)
    return vertices + np.asarray(center), vertices / radius, np.asarray(mesh.triangles)


def mesh_of(*parts):
    """One white mesh of parts (vertices, normals, faces)."""
    offsets = np.cumsum([0] + [len(vertices) for vertices, _, _ in parts[:-1]])
    vertices, normals, faces = zip(*parts, strict=True)
    vertices, normals = (np.concatenate(arrays).astype(np.float32) for arrays in (vertices, normals))
    faces = np.concatenate([part + offset for part, offset in zip(faces, offsets, strict=True)]).astype(np.int32)
    return Mesh(vertices, normals, faces, np.full(vertices.shape, 255, np.uint8))


def sphere():
    """Convex: nothing hides anything."""
    return Scene([mesh_of(ball())])


def sphere_on_plane(at=(0.0, 0.0, 0.0)):
    """A sphere that nearly touches a plane of twice its width."""
    at = np.asarray(at)
    return Scene([mesh_of(ball(1.0, at), square(at - [2.0, 1.01, 2.0], 4 * Z, 4 * X, 28))])


def corner(count=16):
    """(scene, part): a floor and two walls, open to +x, +y, +z; part (V,): 0 of the floor, 1 and 2 of the walls."""
    parts = [square(0 * X, Z, X, count), square(0 * X, X, Y, count), square(0 * X, Y, Z, count)]
    return Scene([mesh_of(*parts)]), np.repeat(np.arange(3), [len(vertices) for vertices, _, _ in parts])


def closed_room():
    """A box seen from inside: black under any sky."""
    inside = [(0 * X, Z, X), (Y, X, Z), (0 * X, Y, Z), (X, Z, Y), (0 * X, X, Y), (Z, Y, X)]
    return Scene([mesh_of(*(square(*each, 6) for each in inside))])


def face():
    """A single triangle."""
    vertices = np.float32([X, Y, Z])
    normals = np.tile(np.float32([1, 1, 1]) / np.float32(np.sqrt(3)), (3, 1))
    return Scene([Mesh(vertices, normals, np.int32([[0, 1, 2]]), np.full((3, 3), 255, np.uint8))])


def far_apart():
    """Two chunks 60 radii apart: a sphere alone, and a sphere on a plane."""
    return Scene([sphere().chunks[0], sphere_on_plane((60.0, 0.0, 0.0)).chunks[0]])


def needles(count=1000, length=0.5, width=0.15):
    """Ground in the shade of thin triangles that lie any way above it, as in a capture of a tree."""
    random = np.random.default_rng(0)
    middle = random.uniform([-1.5, 0.1, -1.5], [1.5, 1.5, 1.5], (count, 3))
    along, across = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in random.normal(size=(2, count, 3)))
    vertices = np.stack([middle - length / 2 * along, middle + length / 2 * along, middle + width * across], axis=1)
    normals = np.repeat(np.cross(along, across), 3, axis=0)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    crown = vertices.reshape(-1, 3), normals, np.arange(3 * count).reshape(-1, 3)
    return Scene([mesh_of(square(-1.5 * (X + Z), 3 * Z, 3 * X, 30), crown)])


def turned(scene, angle_deg):
    """The scene after an active Ry(+angle): +z goes to +x."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    matrix = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    chunks = []
    for chunk in scene.chunks:
        vertices, normals = ((a @ matrix.T).astype(np.float32) for a in (chunk.vertices, chunk.normals))
        chunks.append(Mesh(vertices, normals, chunk.faces, chunk.colors_srgb))
    return Scene(chunks)


def kitchen_sky(seed=0, height=128):
    """Light as indoors: dim walls with grain, tall windows with bars, and lamps, small and bright, all about."""
    random = np.random.default_rng(seed)
    toward = texel_directions(height, 2 * height)
    image = 0.3 * random.gamma(2.0, 0.5, (height, 2 * height, 1)).astype(np.float32) * np.float32([1.0, 0.9, 0.75])
    row, column = np.mgrid[:height, : 2 * height]
    for left, width in ((0.05, 0.07), (0.3, 0.1), (0.62, 0.05), (0.8, 0.08)):
        window = (abs(row / height - 0.45) < 0.13) & (abs(column / (2 * height) - left) < width / 2)
        window &= (row % 9 > 1) & (column % 11 > 1)
        image[window] = 9.0 * np.float32([0.9, 1.0, 1.15])
    for _ in range(12):
        lamp = random.normal(size=3) + 0.8 * Y
        image[toward @ (lamp / np.linalg.norm(lamp)) > 0.998] = 60.0 * np.float32([1.1, 1.0, 0.7])
    return Environment(image, "kitchen")


def occluder_of(scene):
    return Occluder(scene.vertices, scene.normals, scene.faces)


def truth(scene, light, albedo=None, directions=2048):
    """Exit radiance (V, 3) under the full image; with an albedo through all its bounces, by 256 rays of each vertex."""
    everything = occluder_of(scene)
    direct = reference(everything, slice(None), light, directions)
    if albedo is None:
        return direct
    return with_bounces(direct, albedo, Interreflection(everything, 256), 1e-6, 200)[0]


def difference(found, expected):
    """Relative L2."""
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


def plan(scene, environment, tolerance=None, albedo_linear=None, angles=1, **options):
    """The Plan for a scene under a light."""
    known = PlannedScene(occluder_of(scene), albedo_linear, Foliage.of_scene(scene))
    return planned(known, environment, LightingOptions(tolerance=tolerance, **options), angles)
