// As much of Unity, gsplat-unity and the Inference Engine as the loaders name, to compile and run their kernels without
// them. Signatures follow the published ones; nothing here draws.

using System;
using System.Collections.Generic;

namespace UnityEngine
{
    public class Object
    {
        public static implicit operator bool(Object thing) => thing != null;
        public static T Instantiate<T>(T original) where T : Object => (T)original.MemberwiseClone();
    }
    public class Transform
    {
        public Quaternion rotation = new Quaternion { w = 1 };
        public Vector3 InverseTransformPoint(Vector3 world) => world;
    }
    public struct Quaternion { public float x, y, z, w; }
    public struct Color { public float r, g, b, a; public Color(float r, float g, float b, float a) { this.r = r; this.g = g; this.b = b; this.a = a; } }
    public class Component : Object
    {
        public Transform transform = new Transform();
        public T GetComponent<T>() where T : class, new() => new T();
    }
    public struct Bounds { public Vector3 center; }
    public class Renderer : Component
    {
        public Bounds bounds;
        public Rendering.LightProbeUsage lightProbeUsage;
        public MaterialPropertyBlock Block = new MaterialPropertyBlock();
        public void GetPropertyBlock(MaterialPropertyBlock block) { block.Light = Block.Light; }
        public void SetPropertyBlock(MaterialPropertyBlock block) { Block = block; }
    }
    public class MaterialPropertyBlock
    {
        public Rendering.SphericalHarmonicsL2[] Light;
        public void CopySHCoefficientArraysFrom(Rendering.SphericalHarmonicsL2[] light) { Light = (Rendering.SphericalHarmonicsL2[])light.Clone(); }
    }
    public class LightProbes : Object { public Rendering.SphericalHarmonicsL2[] bakedProbes; public Vector3[] positions; }
    public static class LightmapSettings { public static LightProbes lightProbes; }
    public class MonoBehaviour : Component { public bool enabled; }
    public class Shader : Object { }
    public class Material : Object
    {
        public Material(Shader shader) { }
        public void SetVectorArray(string name, Vector4[] values) { }
        public void SetFloat(string name, float value) { }
    }
    public class MeshFilter : Component { public Mesh sharedMesh; }
    public class MeshRenderer : Renderer { public Material sharedMaterial; }
    public class SkinnedMeshRenderer : Renderer
    {
        // One mesh and one pose, whatever component asks for them.
        public static Mesh Rest = new Mesh(), Pose = new Mesh();
        public Mesh sharedMesh = Rest;
        public void BakeMesh(Mesh mesh)
        {
            mesh.Vertices = Pose.Vertices;
            mesh.Normals = Pose.Normals;
        }
    }
    public class Mesh : Object
    {
        public static Mesh Latest;
        public List<Vector3> Normals;
        public Color[] colors = new Color[0];
        public void GetVertices(List<Vector3> values) { values.Clear(); values.AddRange(Vertices); }
        public void GetNormals(List<Vector3> values) { values.Clear(); values.AddRange(Normals); }
        public void SetColors(Color[] values) { colors = values; }
        public Rendering.IndexFormat indexFormat;
        public List<Vector3> Vertices;
        public int[] Triangles;
        public Dictionary<int, List<Vector4>> Uvs = new Dictionary<int, List<Vector4>>();
        public Mesh() { Latest = this; }
        public void SetVertices(List<Vector3> values) { Vertices = values; }
        public void SetNormals(List<Vector3> values) { Normals = values; }
        public void SetUVs(int channel, List<Vector4> values) { Uvs[channel] = values; }
        public void SetTriangles(List<int> values, int submesh) { Triangles = values.ToArray(); }
        public void RecalculateBounds() { }
    }
    public struct Vector3 { public float x, y, z; public Vector3(float x, float y, float z) { this.x = x; this.y = y; this.z = z; } }
    public struct Vector4
    {
        public float x, y, z, w;
        public Vector4(float x, float y, float z, float w) { this.x = x; this.y = y; this.z = z; this.w = w; }
        public float this[int i] => i == 0 ? x : i == 1 ? y : i == 2 ? z : w;
    }
    public static class Mathf
    {
        public static int Clamp(int value, int low, int high) => Math.Max(low, Math.Min(high, value));
        public static float Min(float a, float b) => Math.Min(a, b);
        public static float Pow(float a, float b) => (float)Math.Pow(a, b);
    }
    public static class Application { public static string streamingAssetsPath = "."; }
    public static class Debug
    {
        public static string Said;
        public static void LogError(string text, Object context) { Said = text; }
    }
    public class GraphicsBuffer
    {
        public Array Data;
        public void SetData(Array data) { Data = (Array)data.Clone(); }
    }
    public class TooltipAttribute : Attribute { public TooltipAttribute(string text) { } }
    public class ContextMenu : Attribute { public ContextMenu(string text) { } }
    public class RangeAttribute : Attribute { public RangeAttribute(float low, float high) { } }
    public class RequireComponentAttribute : Attribute
    {
        public RequireComponentAttribute(Type one) { }
        public RequireComponentAttribute(Type one, Type two) { }
    }
}

namespace UnityEngine.Rendering
{
    public enum IndexFormat { UInt16, UInt32 }
    public enum LightProbeUsage { Off, BlendProbes, UseProxyVolume, CustomProvided = 4 }
    public struct SphericalHarmonicsL2
    {
        float[] values;  // red, then green, then blue
        public float this[int rgb, int i]
        {
            get => values == null ? 0 : values[9 * rgb + i];
            set { values = values == null ? new float[27] : (float[])values.Clone(); values[9 * rgb + i] = value; }
        }
        static SphericalHarmonicsL2 Each(Func<int, int, float> value)
        {
            var made = new SphericalHarmonicsL2();
            for (int c = 0; c < 3; c++) for (int i = 0; i < 9; i++) made[c, i] = value(c, i);
            return made;
        }
        public static SphericalHarmonicsL2 operator +(SphericalHarmonicsL2 a, SphericalHarmonicsL2 b) => Each((c, i) => a[c, i] + b[c, i]);
        public static SphericalHarmonicsL2 operator *(SphericalHarmonicsL2 a, float f) => Each((c, i) => a[c, i] * f);
        public static SphericalHarmonicsL2 operator *(float f, SphericalHarmonicsL2 a) => a * f;
    }
}

namespace Gsplat
{
    using UnityEngine;
    public abstract class GsplatAsset : UnityEngine.Object { public uint SplatCount; }
    public class GsplatAssetUncompressed : GsplatAsset { public Vector4[] Colors; public Vector3[] SHs; }
    public abstract class GsplatResource { public uint UploadedCount; }
    public class GsplatResourceUncompressed : GsplatResource
    {
        public GraphicsBuffer ColorBuffer = new GraphicsBuffer(), SHBuffer;
    }
    public class GsplatRenderer : MonoBehaviour
    {
        // One renderer, whatever component asks for it.
        public static GsplatAsset Asset;
        public static GsplatResourceUncompressed Resource = new GsplatResourceUncompressed();
        public GsplatAsset GsplatAsset => Asset;
        public GsplatResource GsplatResource => Resource;
    }
}

namespace Unity.InferenceEngine
{
    public class ModelAsset { }
    public class Model { }
    public enum BackendType { CPU, GPUCompute, GPUPixel }
    public static class ModelLoader { public static Model Load(ModelAsset asset) => new Model(); }
    public struct TensorShape
    {
        public TensorShape(int a) { }
        public TensorShape(int a, int b) { }
        public TensorShape(int a, int b, int c) { }
    }
    public abstract class Tensor : IDisposable { public void Dispose() { } }
    public class Tensor<T> : Tensor
    {
        public Tensor(TensorShape shape, T[] data) { }
        public T[] DownloadToArray() => null;
    }
    public class Worker : IDisposable
    {
        public Worker(Model model, BackendType backend) { }
        public void SetInput(string name, Tensor tensor) { }
        public void Schedule() { }
        public Tensor PeekOutput(string name) => null;
        public void Dispose() { }
    }
}
