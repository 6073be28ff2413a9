// Live light on a mesh: reads live.glb of `relight SCENE --format glb --live` from StreamingAssets and lights it by the shader
// Relight/Mesh. Unity's glTF importers drop or reorder the transfer, so the file is read here.

using System;
using System.Collections.Generic;
using System.IO;
using System.Text;
using UnityEngine;
using UnityEngine.Rendering;

namespace Relight
{
    [RequireComponent(typeof(MeshFilter), typeof(MeshRenderer))]
    public sealed class RelightMesh : MonoBehaviour
    {
        const string Key = "relight_live";
        const int Version = 1;

        [Tooltip("File below StreamingAssets")] public string File = "live.glb";
        [Tooltip("The shader Relight/Mesh")] public Shader Shader;
        [Range(0, 360), Tooltip("Light turned about the vertical, degrees")] public float Angle;
        [Tooltip("Display value per unit of radiance")] public float Exposure = 1;

        double[][] sh;
        Material material;

        void OnEnable()
        {
            try
            {
                Load(System.IO.File.ReadAllBytes(Path.Combine(Application.streamingAssetsPath, File)));
            }
            catch (Exception error)
            {
                Debug.LogError($"Relight: {File}: {error.Message}", this);
                enabled = false;
            }
        }

        void Update()
        {
            var turned = Turned(sh, Angle);
            var light = new Vector4[9];
            for (int j = 0; j < 9; j++) light[j] = new Vector4((float)turned[j][0], (float)turned[j][1], (float)turned[j][2], 0);
            material.SetVectorArray("_RelightLight", light);
            material.SetFloat("_RelightExposure", Exposure);
        }

        void Load(byte[] data)
        {
            var live = Live(data, out var gltf, out int binary);
            sh = Sh(live);
            Angle = AngleOf(live);
            Exposure = (float)(double)live["exposure"];

            var positions = new List<Vector3>();
            var normals = new List<Vector3>();
            var channels = new[] { new List<Vector4>(), new List<Vector4>(), new List<Vector4>(), new List<Vector4>() };
            var faces = new List<int>();
            foreach (var mesh in (List<object>)gltf["meshes"])
            foreach (var each in (List<object>)Map(mesh)["primitives"])
            {
                var named = Map(Map(each)["attributes"]);
                int first = positions.Count;
                // glTF is right-handed: x is mirrored, as Unity's importers do, and so are the faces.
                foreach (var v in Read(gltf, data, binary, named["POSITION"])) positions.Add(new Vector3(-v[0], v[1], v[2]));
                foreach (var v in Read(gltf, data, binary, named["NORMAL"])) normals.Add(new Vector3(-v[0], v[1], v[2]));
                for (int i = 0; i < 3; i++)
                    foreach (var v in Read(gltf, data, binary, named[$"_TRANSFER_{i}"]))
                        channels[i].Add(new Vector4(v[0], v[1], v[2], v[3]));
                foreach (var v in Read(gltf, data, binary, named["COLOR_0"])) channels[3].Add(new Vector4(v[0], v[1], v[2], 1));
                var corners = new List<int>();
                foreach (var v in Read(gltf, data, binary, Map(each)["indices"])) corners.Add(first + (int)v[0]);
                for (int i = 0; i < corners.Count; i += 3) faces.AddRange(new[] { corners[i], corners[i + 2], corners[i + 1] });
            }
            var made = new Mesh { indexFormat = IndexFormat.UInt32 };
            made.SetVertices(positions);
            made.SetNormals(normals);
            for (int i = 0; i < 4; i++) made.SetUVs(i, channels[i]);
            made.SetTriangles(faces, 0);
            made.RecalculateBounds();
            GetComponent<MeshFilter>().sharedMesh = made;
            GetComponent<MeshRenderer>().sharedMaterial = material = new Material(Shader);
        }

        // What live.glb says of its light, its whole JSON, and where its numbers begin.
        internal static Dictionary<string, object> Live(byte[] data, out Dictionary<string, object> gltf, out int binary)
        {
            if (data.Length < 20 || BitConverter.ToUInt32(data, 0) != 0x46546c67) throw new InvalidDataException("not a binary glTF");
            int length = BitConverter.ToInt32(data, 12);
            gltf = (Dictionary<string, object>)Json.Parse(Encoding.UTF8.GetString(data, 20, length));
            binary = 28 + length;
            var scene = Map(((List<object>)gltf["scenes"])[0]);
            if (!scene.TryGetValue("extras", out var extras) || !Map(extras).TryGetValue(Key, out var said))
                throw new InvalidDataException("has no live light; write it with relight SCENE --format glb --live");
            var live = Map(said);
            if ((double)live["version"] > Version || (double)live["coefficients"] != 9)
                throw new InvalidDataException($"live light of version {live["version"]}, this loader reads {Version}");
            return live;
        }

        internal static double[][] Sh(Dictionary<string, object> live) => Json.Rows(Map(live["light"])["sh"]);

        internal static float AngleOf(Dictionary<string, object> live) => (float)(double)Map(live["light"])["angle_deg"];

        static Dictionary<string, object> Map(object value) => (Dictionary<string, object>)value;

        // The rows of an accessor: floats, normalised 16-bit integers, or indices of 16 or 32 bits.
        static List<float[]> Read(Dictionary<string, object> gltf, byte[] data, int binary, object index)
        {
            var accessor = Map(((List<object>)gltf["accessors"])[(int)(double)index]);
            var view = Map(((List<object>)gltf["bufferViews"])[(int)(double)accessor["bufferView"]]);
            int at = binary + Offset(view) + Offset(accessor);
            int kind = (int)(double)accessor["componentType"], size = kind == 5126 || kind == 5125 ? 4 : 2;
            int width = new Dictionary<string, int> { ["SCALAR"] = 1, ["VEC3"] = 3, ["VEC4"] = 4 }[(string)accessor["type"]];
            var rows = new List<float[]>();
            for (int row = 0; row < (int)(double)accessor["count"]; row++)
            {
                var values = new float[width];
                for (int i = 0; i < width; i++, at += size)
                    values[i] = kind == 5126 ? BitConverter.ToSingle(data, at)
                        : kind == 5125 ? BitConverter.ToUInt32(data, at)
                        : kind == 5123 ? BitConverter.ToUInt16(data, at)
                        : Math.Max(BitConverter.ToInt16(data, at) / 32767f, -1f);
                rows.Add(values);
            }
            return rows;
        }

        static int Offset(Dictionary<string, object> of) => of.ContainsKey("byteOffset") ? (int)(double)of["byteOffset"] : 0;

        // Nine radiance coefficients of light turned about +y, counter-clockwise from above in glTF's frame. Band 2 is
        // rewritten about y first: the polar axis of the basis is z.
        public static double[][] Turned(double[][] sh, double degrees)
        {
            double a = degrees * Math.PI / 180, h = Math.Sqrt(3) / 2;
            double c = Math.Cos(a), s = Math.Sin(a), c2 = Math.Cos(2 * a), s2 = Math.Sin(2 * a);
            var result = Array.ConvertAll(sh, row => (double[])row.Clone());
            for (int i = 0; i < 3; i++)
            {
                double around = h * sh[6][i] - 0.5 * sh[8][i], along = -0.5 * sh[6][i] - h * sh[8][i];
                double now = around * c2 - sh[7][i] * s2;
                result[2][i] = sh[2][i] * c - sh[3][i] * s;
                result[3][i] = sh[3][i] * c + sh[2][i] * s;
                result[4][i] = sh[4][i] * c + sh[5][i] * s;
                result[5][i] = sh[5][i] * c - sh[4][i] * s;
                result[6][i] = h * now - 0.5 * along;
                result[7][i] = sh[7][i] * c2 + around * s2;
                result[8][i] = -0.5 * now - h * along;
            }
            return result;
        }
    }
}
