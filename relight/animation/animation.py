"""Animated glTF: skinned, morphing and moving meshes, posed at any time, as chunks of a scene.

Matrices act on column vectors from the left; rotations in glTF are quaternions x y z w. Source: glTF 2.0
specification, sections 3.7 (skins, morph targets) and 3.11 with appendix C (interpolation).
"""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation, Slerp

from splat2mesh.base.arrays import ColorsSrgb, Faces, Floats, Integers, Matrix4, Points
from splat2mesh.base.errors import InputError
from splat2mesh.base.gltf import WIDTHS, GltfData, entry, warn_skipped
from splat2mesh.base.gltfnodes import for_normals, global_matrices, hierarchy, initial_transforms
from splat2mesh.base.inputs import reading
from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear
from splat2mesh.scene.gltfmesh import Primitive, painted, primitives
from splat2mesh.scene.gltftextures import Textures
from splat2mesh.scene.mesh import Mesh, unit, vertex_normals
from splat2mesh.scene.scene import Scene

PATHS = {"translation": WIDTHS["VEC3"], "rotation": WIDTHS["VEC4"], "scale": WIDTHS["VEC3"]}
"""Properties of a node that an animation may change, and their widths; weights of morph targets come on top."""

POSES = 16
"""Poses that stand for all of an animation: where the surface is refined, and what a camera is fitted to."""

INTERPOLATIONS = "LINEAR", "STEP", "CUBICSPLINE"


class Track:
    """One property over time: keyframes and the interpolation between them.

    times: (T,) float64, s, rising. interpolation: one of INTERPOLATIONS. spherical: whether values are quaternions.
    """

    def __init__(
        self,
        times: ArrayLike,  # (T,)
        values: ArrayLike,  # (T, N), with CUBICSPLINE (T, 3, N): tangent in, value, tangent out
        interpolation: str = "LINEAR",
        spherical: bool = False,
    ) -> None:
        """Raises InputError for keyframes that do not fit or do not rise."""
        self.times, self.interpolation, self.spherical = np.asarray(times, np.float64), interpolation, spherical
        if interpolation not in INTERPOLATIONS:
            raise InputError(f"interpolation {interpolation!r}: expected one of {', '.join(INTERPOLATIONS)}")
        values = np.asarray(values, np.float64)
        expected = 3 if interpolation == "CUBICSPLINE" else 2
        if values.ndim != expected or len(values) != len(self.times) or not len(values):
            raise InputError(f"{interpolation} keyframes of shape {values.shape} do not fit {len(self.times)} times")
        if not (np.isfinite(self.times).all() and np.isfinite(values).all() and (np.diff(self.times) >= 0).all()):
            raise InputError("keyframes must be finite, and their times must not fall")
        keys = values[:, 1] if interpolation == "CUBICSPLINE" else values
        if spherical and not keys.any(axis=1).all():
            raise InputError("a keyframe is the rotation 0 0 0 0, which is none")
        self._values = values

    def at(self, time_s: float) -> NDArray[np.float64]:
        """The value at a time, (N,) float64; that of the first key before it, of the last after it."""
        values = self._values[:, 1] if self.interpolation == "CUBICSPLINE" else self._values
        after = int(np.searchsorted(self.times, time_s, side="right"))
        if after == 0 or after == len(self.times):
            return self._unit(values[0 if after == 0 else -1])
        before = after - 1
        span = self.times[after] - self.times[before]
        share = (time_s - self.times[before]) / span
        if self.interpolation == "STEP":
            return self._unit(values[before])
        if self.interpolation == "LINEAR":
            if self.spherical:
                turns = Rotation.from_quat(values[[before, after]])
                return np.asarray(Slerp([0.0, 1.0], turns)(share).as_quat())
            return (1.0 - share) * values[before] + share * values[after]
        square, cube = share**2, share**3
        leaving, arriving = span * self._values[before, 2], span * self._values[after, 0]
        value = (2 * cube - 3 * square + 1) * values[before] + (cube - 2 * square + share) * leaving
        return self._unit(value + (3 * square - 2 * cube) * values[after] + (cube - square) * arriving)

    def _unit(self, value: NDArray[np.float64]) -> NDArray[np.float64]:
        return value / max(float(np.linalg.norm(value)), 1e-300) if self.spherical else value


def morphed(
    base: NDArray[np.float32],  # (V, 3)
    targets: NDArray[np.float32],  # (M, V, 3) differences
    weights: Floats,  # (M,)
) -> NDArray[np.float32]:
    """The base plus the weighted differences, (V, 3) float32."""
    result = base.astype(np.float64)
    for target, weight in zip(targets, weights, strict=True):
        if weight != 0.0:
            result += weight * target
    return result.astype(np.float32)


def moved(
    vertices: NDArray[np.float32],  # (V, 3)
    normals: NDArray[np.float32],  # (V, 3)
    matrix: Matrix4,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Points and normals under one matrix: (V, 3) float32 each, the normals unit, or 0 where they were."""
    turned = unit(normals @ for_normals(matrix).T)
    return (vertices @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32), turned.astype(np.float32)


def skinned(
    vertices: NDArray[np.float32],  # (V, 3)
    normals: NDArray[np.float32],  # (V, 3)
    joints: Integers,  # (V, J) into the matrices
    weights: NDArray[np.float32],  # (V, J) rows that sum to 1
    matrices: Floats,  # (N, 4, 4): of every joint, its pose times its inverse bind matrix
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Linear blend skinning: as `moved`, each vertex under its own weighted mean of matrices."""
    shares = np.asarray(weights, np.float64)
    bound = np.where(shares[..., None, None] != 0.0, np.asarray(matrices, np.float64)[joints], 0.0)
    own = np.einsum("vj,vjrc->vrc", shares, bound)
    place = np.einsum("vrc,vc->vr", own[:, :3, :3], vertices) + own[:, :3, 3]
    turned = unit(np.einsum("vrc,vc->vr", for_normals(own), normals))
    return place.astype(np.float32), turned.astype(np.float32)


class Animation:
    """An animated .glb or .gltf, one chunk for each mesh primitive of each node, posed at any time.

    duration_s: time of the last keyframe. name: of the animation played. names: of all in the file.
    scene: Scene at the time 0, scene frame (glTF's own: right-handed, y up).
    chunks: list of AnimatedPart. moving: numbers of the chunks that any keyframe can move.
    """

    def __init__(self, path: str | Path, animation: str | int | None = None) -> None:
        """animation: name or number; the first without.

        Raises InputError for a file that is broken, has no triangles or no animation, or lacks the requested one.
        """
        self._data = GltfData(path)
        self._textures = Textures(self._data)
        with reading(self._data.path):
            self._read(animation)
        self._textures.warn_lost()

    def _read(self, animation: str | int | None) -> None:
        document = self._data.document
        self._order, self._parent, _ = hierarchy(self._data)
        self._initial = initial_transforms(self._data)
        self.names = [each.name or str(number) for number, each in enumerate(document.animations or [])]
        number = _chosen(self._data.path, self.names, animation)
        self.name = self.names[number]
        self._tracks = self._read_tracks(document.animations[number])
        self.duration_s = max((float(track.times[-1]) for track in self._tracks.values()), default=0.0)
        self._skins = [self._read_skin(skin, each) for each, skin in enumerate(document.skins or [])]
        self.chunks = self._read_parts()
        self.moving = [number for number, part in enumerate(self.chunks) if self._can_move(part)]
        meshes = [
            Mesh(vertices, normals, part.faces, part.colors_srgb)
            for (vertices, normals), part in zip(self.at(0.0), self.chunks, strict=True)
        ]
        self.scene = Scene(meshes, path=self._data.path)

    def at(self, time_s: float) -> list[tuple[NDArray[np.float32], NDArray[np.float32]]]:
        """The pose at a time, s, held before the first and after the last keyframe: [(vertices, normals)] per chunk.

        Both (V, 3) float32, scene frame; the normals unit, or 0 where a vertex has none.
        """
        transforms = [dict(each) for each in self._initial]
        weights = {}
        for (node, path), track in self._tracks.items():
            value = track.at(time_s)
            if path == "weights":
                weights[node] = value
            else:
                transforms[node].pop("matrix", None)
                transforms[node][path] = value
        matrices = global_matrices(transforms, self._order, self._parent)
        return [self._posed(part, matrices, weights.get(part.node, part.weights)) for part in self.chunks]

    def frame(self, time_s: float) -> Scene:
        """The pose at a time as a Scene: the faces and colours of `scene`."""
        chunks = [
            Mesh(vertices, normals, part.faces, part.colors_srgb)
            for (vertices, normals), part in zip(self.at(time_s), self.chunks, strict=True)
        ]
        return Scene(chunks, path=self._data.path)

    def _posed(
        self, part: "AnimatedPart", matrices: NDArray[np.float64], weights: NDArray[np.float64]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        vertices = morphed(part.vertices, part.vertex_targets, weights)
        if part.normals is None:
            normals = face_normals(vertices, part.faces)
        else:
            normals = morphed(part.normals, part.normal_targets, weights)
        if part.skin is None or part.joints is None or part.joint_weights is None:
            return moved(vertices, normals, matrices[part.node] @ part.node_from_part)
        joints, inverse_bind = self._skins[part.skin]
        return skinned(vertices, normals, part.joints, part.joint_weights, matrices[joints] @ inverse_bind)

    def _can_move(self, part: "AnimatedPart") -> bool:
        changed = {node for node, path in self._tracks if path != "weights"}
        if (part.node, "weights") in self._tracks:
            return True
        drivers = [part.node] if part.skin is None else self._skins[part.skin][0].tolist()
        for node in drivers:
            while node >= 0:
                if node in changed:
                    return True
                node = self._parent[node]
        return False

    def _read_tracks(self, animation: Any) -> dict[tuple[int, str], Track]:
        """(node, path) -> Track."""
        tracks = {}
        for channel in animation.channels:
            node, path = channel.target.node, channel.target.path
            if node is None or path not in (*PATHS, "weights"):
                continue  # an extension animates something else, such as a camera or a material
            what = f"the {path} of node {node}"
            entry(self._initial, node)
            sampler = entry(animation.samplers, channel.sampler)
            interpolation = sampler.interpolation or "LINEAR"
            times = self._data.array(sampler.input, what)
            values = np.asarray(self._data.array(sampler.output, what), np.float64)
            per_key = 3 if interpolation == "CUBICSPLINE" else 1
            width = PATHS.get(path) or values.size // max(len(times) * per_key, 1)
            shape = (len(times), 3, width) if per_key == 3 else (len(times), width)
            if not width or values.size != np.prod(shape):
                raise InputError(f"{self._data.path}: {what} has {values.shape} values for {len(times)} times")
            try:
                tracks[node, path] = Track(times, values.reshape(shape), interpolation, path == "rotation")
            except InputError as error:
                raise InputError(f"{self._data.path}: {what}: {error}") from None
            if "matrix" in self._initial[node] and path != "weights":
                raise InputError(f"{self._data.path}: node {node} is animated and has a matrix, which glTF rules out")
        return tracks

    def _read_skin(self, skin: Any, number: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Nodes of the joints (J,) and their inverse bind matrices (J, 4, 4)."""
        joints = np.array(skin.joints, np.int64)
        if joints.ndim != 1 or not len(joints) or joints.min() < 0 or joints.max() >= len(self._initial):
            raise InputError(f"{self._data.path}: skin {number} names joints beyond the {len(self._initial)} nodes")
        inverse = np.tile(np.eye(4), (len(joints), 1, 1))
        if skin.inverseBindMatrices is not None:
            flat = self._data.vectors(skin.inverseBindMatrices, len(joints), 16, f"skin {number}")
            inverse = flat.reshape(-1, 4, 4).transpose(0, 2, 1).astype(np.float64)
        return joints, inverse

    def _read_parts(self) -> "list[AnimatedPart]":
        found = [(self._read_part(each), each.copies) for each in primitives(self._data)]
        return [replace(part, node_from_part=copy) for part, copies in found for copy in copies]

    def _read_part(self, each: Primitive) -> "AnimatedPart":
        node, what = self._data.document.nodes[each.node], f"the mesh of node {each.node}"
        mesh, targets, count = self._data.document.meshes[node.mesh], each.source.targets or [], len(each.points)
        vertex_targets = self._targets(targets, "POSITION", count, what)
        normal_targets = self._targets(targets, "NORMAL", count, what)
        weights = np.array(node.weights or mesh.weights or [0.0] * len(targets), np.float64)
        joints, joint_weights = None, None
        if node.skin is not None:
            joints, joint_weights = self._influences(each.source.attributes, node, count, what)
        skin = None if joints is None else node.skin
        colors = bytes_from_unit(srgb_from_linear(painted(each, self._textures)))
        vertices, normals = each.points.astype(np.float32), each.held.get("NORMAL")
        morphs = vertex_targets, normal_targets, weights
        return AnimatedPart(each.node, vertices, normals, each.faces, colors, *morphs, skin, joints, joint_weights)

    def _targets(self, targets: list[Any], name: str, count: int, what: str) -> NDArray[np.float32]:
        """(M, V, 3) float32 differences of every morph target, 0 where one has none."""
        result = np.zeros((len(targets), count, 3), np.float32)
        for number, target in enumerate(targets):
            accessor = target.get(name) if isinstance(target, dict) else getattr(target, name, None)
            if accessor is not None:
                result[number] = self._data.vectors(accessor, count, 3, what)
        return result

    def _influences(
        self, attributes: Any, node: Any, count: int, what: str
    ) -> tuple[NDArray[np.int64], NDArray[np.float32]] | tuple[None, None]:
        """Joints (V, J) int64 and weights (V, J) float32 that sum to 1; None twice for a mesh that names no joints."""
        named: list[NDArray[Any]] = []
        shares: list[NDArray[Any]] = []
        number = 0
        while getattr(attributes, f"JOINTS_{number}", None) is not None:
            named.append(self._data.array(getattr(attributes, f"JOINTS_{number}"), what))
            shares.append(self._data.vectors(getattr(attributes, f"WEIGHTS_{number}"), count, 4, what))
            number += 1
        if not named:
            return None, None
        joints, weights = np.concatenate(named, axis=1).astype(np.int64), np.concatenate(shares, axis=1)
        known = len(entry(self._skins, node.skin)[0])
        used = joints[weights != 0] if joints.shape == weights.shape else np.array([-1])
        if (used >= known).any() or (used < 0).any():
            raise InputError(f"{self._data.path}: {what} names joints beyond the {known} of its skin")
        total = weights.sum(axis=1, keepdims=True)
        loose = total[:, 0] <= 0
        warn_skipped(self._data.path, int(loose.sum()), "vertices without a joint: they follow the first one")
        weights = np.divide(weights, total, out=np.zeros_like(weights), where=total > 0)
        weights[loose, 0] = 1.0
        joints[weights == 0] = 0
        return joints, np.ascontiguousarray(weights, np.float32)


@dataclass(frozen=True)
class AnimatedPart:
    """A mesh primitive at a node.

    vertices: (V, 3) float32, before morphing and skinning. normals: the same, or None. faces: (F, 3) int32.
    colors_srgb: (V, 3) uint8. vertex_targets, normal_targets: (M, V, 3) float32. weights: (M,) of the first pose.
    skin: number, or None. joints, joint_weights: (V, J). node_from_part: (4, 4), of a copy.
    """

    node: int
    vertices: NDArray[np.float32]
    normals: NDArray[np.float32] | None
    faces: Faces
    colors_srgb: ColorsSrgb
    vertex_targets: NDArray[np.float32]
    normal_targets: NDArray[np.float32]
    weights: NDArray[np.float64]
    skin: int | None
    joints: NDArray[np.int64] | None
    joint_weights: NDArray[np.float32] | None
    node_from_part: NDArray[np.float64] = field(default_factory=lambda: np.eye(4))


def face_normals(
    vertices: Points,  # (V, 3)
    faces: Integers,  # (F, 3)
) -> NDArray[np.float32]:
    """Unit normals of vertices, (V, 3) float32: those of `vertex_normals`, smooth over seams."""
    places, place = np.unique(vertices, axis=0, return_inverse=True)
    return vertex_normals(places, place.reshape(-1)[faces])[place.reshape(-1)]


def _chosen(path: Path, names: list[str], animation: str | int | None) -> int:
    if not names:
        raise InputError(f"{path}: holds no animation; relight it as a still mesh")
    if animation is None:
        return 0
    if isinstance(animation, str) and animation in names:
        return names.index(animation)
    number = int(animation) if str(animation).isdecimal() else -1
    if not 0 <= number < len(names):
        raise InputError(f"{path}: has no animation {animation!r}; expected one of {', '.join(names)}")
    return number
