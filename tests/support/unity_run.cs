// Runs the loaders on a bundle and a live.glb and prints numbers. Arguments: folder, light, angle, exposure, harmonics a
// splat, and stops of lamps; or
// "mesh", folder, file, angle; or "probes", folder, file, exposure, x, y, z of a renderer; or "motors", points and normals
// as text; or "turned", axis, angle, and 27 numbers; or "skinned", folder, poses as text, quaternion x y z w, axis, angle,
// exposure, albedo.

using System;
using System.Globalization;
using System.Linq;
using System.Reflection;
using Gsplat;
using Relight;
using UnityEngine;

public static class Run
{
    static object Call(object thing, string name) =>
        thing.GetType().GetMethod(name, BindingFlags.NonPublic | BindingFlags.Instance).Invoke(thing, null);

    static void Print(System.Collections.Generic.IEnumerable<double> values) =>
        Console.WriteLine(string.Join(" ", values.Select(each => each.ToString("R", CultureInfo.InvariantCulture))));

    static double Number(string text) => double.Parse(text, CultureInfo.InvariantCulture);

    public static int Main(string[] arguments)
    {
        if (arguments[0] == "mesh") return Mesh(arguments);
        if (arguments[0] == "probes") return Probes(arguments);
        if (arguments[0] == "motors") return Motors(arguments);
        if (arguments[0] == "turned") return Turned(arguments);
        if (arguments[0] == "skinned") return Skinned(arguments);
        Application.streamingAssetsPath = arguments[0];
        try
        {
            var bundle = new Bundle(arguments[0]);
            int rest = int.Parse(arguments[4]);
            var asset = new GsplatAssetUncompressed { SplatCount = (uint)bundle.Count };
            asset.Colors = Enumerable.Range(0, bundle.Count).Select(i => new Vector4(0.01f * i, -0.01f * i, 0.5f, 0.25f)).ToArray();
            asset.SHs = Enumerable.Range(0, rest * bundle.Count).Select(i => new Vector3(0.1f, 0.2f, 0.3f)).ToArray();
            GsplatRenderer.Asset = asset;
            GsplatRenderer.Resource.UploadedCount = (uint)bundle.Count;
            GsplatRenderer.Resource.SHBuffer = new GraphicsBuffer();
            var shown = new RelightSplat { Folder = "", Number = int.Parse(arguments[1]), Angle = (float)Number(arguments[2]) };
            shown.Exposure = (float)Number(arguments[3]);
            shown.Lamps = arguments.Skip(5).Select(each => (float)Number(each)).ToArray();
            Call(shown, "OnEnable");
            if (Debug.Said != null) { Console.Error.WriteLine(Debug.Said); return 2; }
            Call(shown, "LateUpdate");
            Print(((Vector4[])GsplatRenderer.Resource.ColorBuffer.Data).SelectMany(c => new double[] { c.x, c.y, c.z, c.w }));
            Print(((Vector3[])GsplatRenderer.Resource.SHBuffer.Data).SelectMany(c => new double[] { c.x, c.y, c.z }));
            return 0;
        }
        catch (System.IO.InvalidDataException error)
        {
            Console.Error.WriteLine(error.Message);
            return 2;
        }
    }

    static int Probes(string[] arguments)
    {
        Application.streamingAssetsPath = arguments[1];
        var at = arguments.Skip(4).Select(each => (float)Number(each)).ToArray();
        var lit = new Renderer { bounds = new Bounds { center = new Vector3(at[0], at[1], at[2]) } };
        var probes = new RelightProbes { File = arguments[2], Exposure = (float)Number(arguments[3]), Lit = new[] { lit } };
        Call(probes, "OnEnable");
        if (Debug.Said != null) { Console.Error.WriteLine(Debug.Said); return 2; }
        Call(probes, "LateUpdate");
        LightmapSettings.lightProbes = new LightProbes
        {
            bakedProbes = new UnityEngine.Rendering.SphericalHarmonicsL2[1], positions = new[] { lit.bounds.center },
        };
        probes.FillBaked();
        foreach (var light in new[] { lit.Block.Light[0], LightmapSettings.lightProbes.bakedProbes[0] })
            Print(Enumerable.Range(0, 27).Select(i => (double)light[i / 9, i % 9]));
        return (int)lit.lightProbeUsage == 4 ? 0 : 1;
    }

    static float[] Floats(string path) =>
        System.IO.File.ReadAllText(path).Split((char[])null, StringSplitOptions.RemoveEmptyEntries).Select(each => (float)Number(each)).ToArray();

    static int Motors(string[] arguments)
    {
        float[] points = Floats(arguments[1]), normals = Floats(arguments[2]);
        Print(Gash.Motors(points, normals, GashFrame.Of(points)).Select(each => (double)each));
        return 0;
    }

    static int Turned(string[] arguments)
    {
        var given = arguments.Skip(1).Select(Number).ToArray();
        var sh = Enumerable.Range(0, 9).Select(j => given.Skip(4 + 3 * j).Take(3).ToArray()).ToArray();
        Print(Rotor.About(given[0], given[1], given[2], given[3]).Turned(sh).SelectMany(row => row));
        return 0;
    }

    // The rest pose and the pose of the frame, each as six numbers a vertex: position and normal.
    static int Skinned(string[] arguments)
    {
        Application.streamingAssetsPath = arguments[1];
        var values = Floats(arguments[2]);
        var given = arguments.Skip(3).Select(each => (float)Number(each)).ToArray();
        var vectors = Enumerable.Range(0, values.Length / 3).Select(i => new Vector3(values[3 * i], values[3 * i + 1], values[3 * i + 2])).ToArray();
        var poses = new[] { vectors.Take(vectors.Length / 2), vectors.Skip(vectors.Length / 2) };
        var skinned = new RelightSkinned
        {
            Axis = new Vector3(given[4], given[5], given[6]), Angle = given[7], Exposure = given[8],
            Albedo = new Color(given[9], given[10], given[11], 1),
        };
        skinned.transform.rotation = new Quaternion { x = given[0], y = given[1], z = given[2], w = given[3] };
        foreach (var name in new[] { "OnEnable", "LateUpdate" })
        {
            var pose = poses[name == "OnEnable" ? 0 : 1].ToList();
            SkinnedMeshRenderer.Pose.SetVertices(pose.Where((_, i) => i % 2 == 0).ToList());
            SkinnedMeshRenderer.Pose.SetNormals(pose.Where((_, i) => i % 2 == 1).ToList());
            Call(skinned, name);
            if (Debug.Said != null) { Console.Error.WriteLine(Debug.Said); return 2; }
        }
        skinned.Angle += 360;
        Call(skinned, "LateUpdate");
        var renderer = (SkinnedMeshRenderer)typeof(RelightSkinned).GetField("skin", BindingFlags.NonPublic | BindingFlags.Instance).GetValue(skinned);
        Print(renderer.sharedMesh.colors.SelectMany(c => new double[] { c.r, c.g, c.b }));
        Call(skinned, "OnDisable");
        return renderer.sharedMesh == SkinnedMeshRenderer.Rest && SkinnedMeshRenderer.Rest.colors.Length == 0 ? 0 : 1;
    }

    static int Mesh(string[] arguments)
    {
        Application.streamingAssetsPath = arguments[1];
        var mesh = new RelightMesh { File = arguments[2] };
        Call(mesh, "OnEnable");
        if (Debug.Said != null) { Console.Error.WriteLine(Debug.Said); return 2; }
        var made = UnityEngine.Mesh.Latest;
        Print(made.Vertices.SelectMany(v => new double[] { v.x, v.y, v.z }));
        Print(made.Triangles.Select(i => (double)i));
        for (int i = 0; i < 4; i++) Print(made.Uvs[i].SelectMany(v => new double[] { v.x, v.y, v.z, v.w }));
        var sh = (double[][])typeof(RelightMesh).GetField("sh", BindingFlags.NonPublic | BindingFlags.Instance).GetValue(mesh);
        Print(RelightMesh.Turned(sh, Number(arguments[3])).SelectMany(row => row));
        return 0;
    }
}
