// Live light on splats shown by gsplat-unity (github.com/wuyize25/gsplat-unity, 1.3 or later). Import splat.ply of a bundle
// with the compression mode Uncompressed, keep the bundle's folder in StreamingAssets, put this beside the GsplatRenderer.

using System;
using System.IO;
using Gsplat;
using UnityEngine;

namespace Relight
{
    [RequireComponent(typeof(GsplatRenderer))]
    public sealed class RelightSplat : MonoBehaviour
    {
        [Tooltip("Folder of the bundle below StreamingAssets")] public string Folder = "live";
        [Range(0, 360), Tooltip("Light turned about the vertical, degrees")] public float Angle;
        [Tooltip("Which light of the bundle")] public int Number;
        [Tooltip("Stops brighter than the bundle says")] public float Exposure;
        [Tooltip("How much of the captured light is beside it; below 0 as the bundle says")] public float Captured = -1;
        [Tooltip("Stops brighter, lamp by lamp, in the order of the bundle; -100 is off")] public float[] Lamps = new float[0];

        Bundle bundle;
        GsplatAssetUncompressed asset;
        Vector4[] colors;
        Vector3[] harmonics;
        (float, int, float, float) shown = (float.NaN, -1, 0, 0);
        float[] lampsShown = new float[0];

        void OnEnable()
        {
            try
            {
                bundle = new Bundle(Path.Combine(Application.streamingAssetsPath, Folder));
                asset = GetComponent<GsplatRenderer>().GsplatAsset as GsplatAssetUncompressed;
                if (asset == null) throw new InvalidDataException("import the splat with the mode Uncompressed");
                if (asset.SplatCount != bundle.Count)
                    throw new InvalidDataException("the splat has another count than the bundle: import its splat.ply again");
                colors = (Vector4[])asset.Colors.Clone();
                harmonics = asset.SHs == null ? null : (Vector3[])asset.SHs.Clone();
                shown = (float.NaN, -1, 0, 0);
            }
            catch (Exception error)
            {
                Debug.LogError($"Relight: {error.Message}", this);
                enabled = false;
            }
        }

        void LateUpdate()
        {
            var renderer = GetComponent<GsplatRenderer>();
            if (!(renderer.GsplatResource is GsplatResourceUncompressed resource)) return;
            if (resource.UploadedCount != bundle.Count || Same()) return;
            shown = (Angle, Number, Exposure, Captured);
            lampsShown = (float[])Lamps.Clone();
            Light();
            resource.ColorBuffer.SetData(colors);
            if (harmonics != null && resource.SHBuffer != null) resource.SHBuffer.SetData(harmonics);
        }

        bool Same()
        {
            if (!shown.Equals((Angle, Number, Exposure, Captured)) || lampsShown.Length != Lamps.Length) return false;
            for (int i = 0; i < Lamps.Length; i++) if (lampsShown[i] != Lamps[i]) return false;
            return true;
        }

        void OnDisable()
        {
            if (asset != null && GetComponent<GsplatRenderer>().GsplatResource is GsplatResourceUncompressed resource)
            {
                resource.ColorBuffer.SetData(asset.Colors);
                if (asset.SHs != null && resource.SHBuffer != null) resource.SHBuffer.SetData(asset.SHs);
            }
        }

        void Light()
        {
            const float C0 = 0.28209479f;
            var light = bundle.Lights[Mathf.Clamp(Number, 0, bundle.Lights.Count - 1)];
            float exposure = light.Exposure * Mathf.Pow(2, Exposure), captured = Captured < 0 ? light.Captured : Captured;
            var vector = bundle.Vector(light, Angle, exposure);
            int lamp = 0;
            var strengths = bundle.Terms.ConvertAll(term => term.Strength(
                light, exposure, captured, term.IsCaptured ? 0 : lamp++ < Lamps.Length ? Lamps[lamp - 1] : 0));
            float[] table = bundle.Table(vector), most = bundle.MeanGain(vector, strengths), beside = bundle.Beside(strengths), k = new float[3], gain = new float[3];
            int rest = harmonics == null ? 0 : harmonics.Length / bundle.Count;
            for (int n = 0; n < bundle.Count; n++)
            {
                if (bundle.Kinds[n] != 1) continue;  // far background and damaged splats stay as captured
                bundle.Change(table, n, k, beside);
                var from = asset.Colors[n];
                for (int i = 0; i < 3; i++) gain[i] = Bundle.Gain(from[i] * C0 + 0.5f, k[i]);
                colors[n] = new Vector4(Bundle.Coefficient(from.x, gain[0]), Bundle.Coefficient(from.y, gain[1]),
                    Bundle.Coefficient(from.z, gain[2]), from.w);
                for (int j = n * rest; j < (n + 1) * rest; j++)
                {
                    var value = asset.SHs[j];
                    harmonics[j] = new Vector3(value.x * Mathf.Min(gain[0], most[0]), value.y * Mathf.Min(gain[1], most[1]),
                        value.z * Mathf.Min(gain[2], most[2]));
                }
            }
        }
    }
}
