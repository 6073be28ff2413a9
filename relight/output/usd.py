"""A relit scene as USD: splats, their proxy mesh, and the light as a dome.

Source: OpenUSD 26.03 and later, usdVol ParticleField3DGaussianSplat, usdLux DomeLight.
"""

import os
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError
from splat2mesh.base.extras import needed
from splat2mesh.base.outputs import staged_file
from splat2mesh.splats.placing import placed
from splat2mesh.splats.splats import REACH, Splats

from .images import write_exr
from .lamps_glb import ShownLight
from .splat_glb import showable

if TYPE_CHECKING:
    from splat2mesh.scene.scene import Scene


MODULES = "Gf", "Sdf", "Tf", "Usd", "UsdGeom", "UsdLux", "UsdShade", "UsdVol", "Vt"
"""Of usd-core."""

FILE, LIGHT = "relit_splat.usdc", "light.exr"

COLOR_SPACE = "srgb_rec709_scene"
"""Colour space of the harmonics, in usd-core's names: sRGB, in which splats are trained and blended."""


_LARGEST_HALF = np.float32(np.finfo(np.float16).max)


def write_usd(
    folder: Path,
    looks: Mapping[str, Splats],  # by name, the first one shown: as read, in their own frame, rows alike
    scene: "Scene",
    albedo: NDArray[np.float32],  # (V, 3) linear, shown on the proxy
    lit: ShownLight,
    roughness: NDArray[np.float32] | None = None,  # (V,) of the proxy; no material without
) -> list[str]:
    """Write FILE, and LIGHT beside it, which FILE refers to. Returns their names.

    /World/Splat is a ParticleField3DGaussianSplat in the scene frame, y up; of several looks a variant set `look`
    chooses. /World/Proxy is the mesh of the scene with the purpose `proxy`, which renderers leave out unless asked.
    Where something is glossy /World/Gloss is its material, of the primvars displayColor and roughness.
    /World/Light is a DomeLight whose intensity is the exposure: the sky that the splats were lit by, and for a renderer
    that lights the look `albedo` the light itself. Raises InputError without usd-core of 26.03 or later.
    """
    pxr, light = library(), lit.light
    first = next(iter(looks.values()))
    rows = showable(first)
    shown = {name: placed(splats.take(rows), scene.scene_from_splat) for name, splats in looks.items()}
    with staged_file(folder / FILE) as staging:
        named = staging.with_suffix(".usdc")  # USD infers the kind of a file from its suffix
        stage = pxr.Usd.Stage.CreateNew(str(named))
        pxr.UsdGeom.SetStageUpAxis(stage, pxr.UsdGeom.Tokens.y)
        pxr.UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        world = pxr.UsdGeom.Xform.Define(stage, "/World")
        stage.SetDefaultPrim(world.GetPrim())
        _define_splats(pxr, stage, shown)
        _define_proxy(pxr, stage, scene, albedo)
        if roughness is not None:
            _define_gloss(pxr, stage, roughness)
        dome = pxr.UsdLux.DomeLight.Define(stage, "/World/Light")
        dome.CreateIntensityAttr(float(lit.exposure))
        dome.CreateTextureFileAttr(pxr.Sdf.AssetPath(f"./{LIGHT}"))
        dome.CreateTextureFormatAttr(pxr.UsdLux.Tokens.latlong)  # OpenEXR's layout, as ours: the centre looks at +z
        dome.AddRotateYOp().Set(float(light.rotation_deg))
        stage.GetRootLayer().Save()
        if named != staging:
            os.replace(named, staging)
    write_exr(folder / LIGHT, {"RGB": np.minimum(light.radiance, _LARGEST_HALF).astype(np.float16)})
    return [FILE, LIGHT]


def library() -> Any:
    """The modules of usd-core. Raises InputError where they lack or are too old."""
    needed("pxr", "USD")
    pxr: Any = import_module("pxr")
    for name in MODULES:
        import_module(f"pxr.{name}")
    if not hasattr(pxr.UsdVol, "ParticleField3DGaussianSplat"):
        found = ".".join(map(str, pxr.Usd.GetVersion()[1:]))
        raise InputError(f"USD knows splats from 26.03 on, found usd-core {found}: pip install --upgrade usd-core")
    return pxr


def _define_splats(pxr: Any, stage: Any, looks: Mapping[str, Splats]) -> None:
    field = pxr.UsdVol.ParticleField3DGaussianSplat.Define(stage, "/World/Splat")
    prim, first = field.GetPrim(), next(iter(looks.values()))
    vt = pxr.Vt
    field.CreatePositionsAttr(vt.Vec3fArray.FromNumpy(first.means))
    # From xyzw in memory, as numpy sees a quaternion of USD.
    field.CreateOrientationsAttr(vt.QuatfArray.FromNumpy(np.ascontiguousarray(first.quats_wxyz[:, [1, 2, 3, 0]])))
    field.CreateScalesAttr(vt.Vec3fArray.FromNumpy(first.scales))
    reach = REACH * first.scales.max(axis=1, keepdims=True)
    low, high = (first.means - reach).min(axis=0), (first.means + reach).max(axis=0)
    field.CreateExtentAttr(vt.Vec3fArray.FromNumpy(np.stack([low, high])))
    field.CreateSortingModeHintAttr("cameraDistance")
    pxr.Usd.ColorSpaceAPI.Apply(prim).CreateColorSpaceNameAttr(COLOR_SPACE)
    if len(looks) == 1:
        _define_colors(pxr, field, first)
        return
    variants = prim.GetVariantSets().AddVariantSet("look")
    for name, splats in looks.items():
        variants.AddVariant(name)
        variants.SetVariantSelection(name)
        with variants.GetVariantEditContext():
            _define_colors(pxr, field, splats)
    variants.SetVariantSelection(next(iter(looks)))


def _define_colors(pxr: Any, field: Any, splats: Splats) -> None:
    """Opacities and harmonics: particle after particle, by degree and order, with the signs of 3DGS."""
    field.CreateOpacitiesAttr(pxr.Vt.FloatArray.FromNumpy(splats.opacities))
    field.CreateRadianceSphericalHarmonicsDegreeAttr(splats.degree)
    values = np.ascontiguousarray(splats.sh.reshape(-1, 3))
    coefficients = field.CreateRadianceSphericalHarmonicsCoefficientsAttr(pxr.Vt.Vec3fArray.FromNumpy(values))
    coefficients.SetMetadata("elementSize", splats.sh.shape[1])
    coefficients.SetMetadata("interpolation", pxr.UsdGeom.Tokens.vertex)


def _define_proxy(pxr: Any, stage: Any, scene: "Scene", albedo: NDArray) -> None:
    mesh, vt = pxr.UsdGeom.Mesh.Define(stage, "/World/Proxy"), pxr.Vt
    mesh.CreatePointsAttr(vt.Vec3fArray.FromNumpy(np.ascontiguousarray(scene.vertices)))
    mesh.CreateFaceVertexCountsAttr(vt.IntArray.FromNumpy(np.full(len(scene.faces), 3, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(vt.IntArray.FromNumpy(np.ascontiguousarray(scene.faces.ravel())))
    mesh.CreateNormalsAttr(vt.Vec3fArray.FromNumpy(np.ascontiguousarray(scene.normals)))
    mesh.SetNormalsInterpolation(pxr.UsdGeom.Tokens.vertex)
    mesh.CreateSubdivisionSchemeAttr(pxr.UsdGeom.Tokens.none)
    mesh.CreateDoubleSidedAttr(True)
    mesh.CreateExtentAttr(vt.Vec3fArray.FromNumpy(scene.bounds.astype(np.float32)))
    mesh.CreatePurposeAttr(pxr.UsdGeom.Tokens.proxy)
    colors = mesh.CreateDisplayColorPrimvar(pxr.UsdGeom.Tokens.vertex)
    colors.Set(vt.Vec3fArray.FromNumpy(np.clip(np.asarray(albedo, np.float32), 0.0, 1.0)))


def _define_gloss(pxr: Any, stage: Any, roughness: NDArray[np.float32]) -> None:
    """The proxy's material: its vertex attributes, read by UsdPreviewSurface."""
    mesh, shade, types = pxr.UsdGeom.Mesh.Get(stage, "/World/Proxy"), pxr.UsdShade, pxr.Sdf.ValueTypeNames
    primvars = pxr.UsdGeom.PrimvarsAPI(mesh)
    primvar = primvars.CreatePrimvar("roughness", types.FloatArray, pxr.UsdGeom.Tokens.vertex)
    primvar.Set(pxr.Vt.FloatArray.FromNumpy(np.ascontiguousarray(roughness, np.float32)))
    material = shade.Material.Define(stage, "/World/Gloss")
    surface = shade.Shader.Define(stage, "/World/Gloss/Surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    inputs = {
        "diffuseColor": ("displayColor", "float3", types.Color3f, types.Float3),
        "roughness": ("roughness", "float", types.Float, types.Float),
    }
    for name, (primvar, kind, asked, given) in inputs.items():
        reader = shade.Shader.Define(stage, f"/World/Gloss/{name}")
        reader.CreateIdAttr(f"UsdPrimvarReader_{kind}")
        reader.CreateInput("varname", types.String).Set(primvar)
        output = reader.CreateOutput("result", given)
        surface.CreateInput(name, asked).ConnectToSource(output)
    material.CreateSurfaceOutput().ConnectToSource(surface.ConnectableAPI(), "surface")
    shade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
