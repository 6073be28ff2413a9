// Light probes of a captured place: reads probes.json of `relight SCENE --format probe --probes 4x2x4` (docs/insert.md) and
// lights renderers by it, wherever they move. Put it on the object that holds relit.glb, or on an empty one at its place.

using System;
using System.Collections.Generic;
using System.IO;
using UnityEngine;
using UnityEngine.Rendering;

namespace Relight
{
    // The probes of a file, in Unity's axes: x is mirrored, as Unity's importers of glTF do.
    public sealed class ProbeSet
    {
        public const string Format = "relight-probes";
        public const int Version = 1;
        const int Near = 8;

        // SphericalHarmonicsL2 keeps the constants of the basis in the coefficients. Odd in x: mirrored.
        static readonly double[] Basis =
        {
            0.28209479, 0.48860251, 0.48860251, -0.48860251, -1.09254843, 1.09254843, 0.31539157, -1.09254843, 0.54627422,
        };

        public readonly List<Vector3> Positions = new List<Vector3>();
        public readonly List<SphericalHarmonicsL2> Light = new List<SphericalHarmonicsL2>();

        public ProbeSet(string text)
        {
            if (!(Json.Parse(text) is Dictionary<string, object> meta) || !meta.TryGetValue("format", out var format)
                || (format as string) != Format)
                throw new InvalidDataException("not a file of light probes");
            if ((double)meta["version"] > Version)
                throw new InvalidDataException($"version {meta["version"]}, this loader reads {Version}");
            foreach (Dictionary<string, object> each in (List<object>)meta["probes"])
            {
                var at = Json.Row(each["position"]);
                Positions.Add(new Vector3(-(float)at[0], (float)at[1], (float)at[2]));
                var rows = Json.Rows(each["sh"]);
                var light = new SphericalHarmonicsL2();
                for (int j = 0; j < 9; j++) for (int c = 0; c < 3; c++) light[c, j] = (float)(Basis[j] * rows[j][c]);
                Light.Add(light);
            }
        }

        // The light at a place between the probes: of the eight nearest, each by the square of (1 / distance - 1 / that of
        // the ninth), so nothing jumps (Franke and Little's weights).
        public SphericalHarmonicsL2 At(Vector3 place)
        {
            var away = new double[Positions.Count];
            var order = new int[Positions.Count];
            for (int i = 0; i < away.Length; i++)
            {
                double x = Positions[i].x - place.x, y = Positions[i].y - place.y, z = Positions[i].z - place.z;
                away[i] = Math.Max(Math.Sqrt(x * x + y * y + z * z), 1e-6);
                order[i] = i;
            }
            var sorted = (double[])away.Clone();
            Array.Sort(sorted, order);
            double reach = sorted.Length > Near ? 1 / sorted[Near] : 0, whole = 0;
            var result = new SphericalHarmonicsL2();
            for (int k = 0; k < Math.Min(Near, sorted.Length); k++)
            {
                double weight = Math.Pow(1 / sorted[k] - reach, 2) + (k == 0 ? 1e-12 : 0);
                whole += weight;
                result += Light[order[k]] * (float)weight;
            }
            return result * (float)(1 / whole);
        }
    }

    public sealed class RelightProbes : MonoBehaviour
    {
        [Tooltip("File below StreamingAssets")] public string File = "probes.json";
        [Tooltip("Factor on the light")] public float Exposure = 1;
        [Tooltip("What the probes light")] public Renderer[] Lit = new Renderer[0];

        ProbeSet probes;
        readonly SphericalHarmonicsL2[] one = new SphericalHarmonicsL2[1];

        void OnEnable()
        {
            try
            {
                probes = new ProbeSet(System.IO.File.ReadAllText(Path.Combine(Application.streamingAssetsPath, File)));
            }
            catch (Exception error)
            {
                Debug.LogError($"Relight: {File}: {error.Message}", this);
                enabled = false;
            }
        }

        // The light at a place of the world.
        public SphericalHarmonicsL2 At(Vector3 world) => probes.At(transform.InverseTransformPoint(world)) * Exposure;

        void LateUpdate()
        {
            foreach (var each in Lit)
            {
                if (!each) continue;
                var block = new MaterialPropertyBlock();
                each.GetPropertyBlock(block);
                one[0] = At(each.bounds.center);
                block.CopySHCoefficientArraysFrom(one);
                each.lightProbeUsage = LightProbeUsage.CustomProvided;
                each.SetPropertyBlock(block);
            }
        }

        // Gives the light to probes that the scene has already (a Light Probe Group, baked once), which light all that moves.
        [ContextMenu("Fill the baked light probes")]
        public void FillBaked()
        {
            if (probes == null) OnEnable();
            var baked = LightmapSettings.lightProbes;
            if (probes == null || !baked) return;
            var light = baked.bakedProbes;
            var places = baked.positions;
            for (int i = 0; i < light.Length; i++) light[i] = At(places[i]);
            baked.bakedProbes = light;
        }
    }
}
