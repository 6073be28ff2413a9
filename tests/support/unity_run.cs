// Runs the loaders on a bundle and a live.glb and prints numbers. Arguments: folder, light, angle, exposure, harmonics a
// splat, and stops of lamps; or
// "mesh", folder, file, angle; or "probes", folder, file, exposure, x, y, z of a renderer.

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
