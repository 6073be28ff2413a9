// The network of the Neural-GASh paper on a skinned mesh: every frame its vertices as posed become motors, the network
// predicts their transfer, and its product with the light goes into the vertex colours (linear; shader Relight/Color). This
// component runs the network in plain C#, for small meshes; RelightSkinnedInference by the Inference Engine, for all others.

using System;
using System.Collections.Generic;
using System.IO;
using UnityEngine;

namespace Relight
{
    [RequireComponent(typeof(SkinnedMeshRenderer))]
    public class RelightSkinned : MonoBehaviour
    {
        [Tooltip("live.glb below StreamingAssets: its light")] public string Light = "live.glb";
        [Tooltip("The network below StreamingAssets")] public string Network = "neural-gash.bin";
        [Tooltip("Light turned further, degrees about the axis, counter-clockwise where that points at you")] public float Angle;
        [Tooltip("Axis of the world")] public Vector3 Axis = new Vector3(0, 1, 0);
        [Tooltip("Stops brighter than the file says")] public float Exposure;
        [Tooltip("Linear colour of the surface, times the vertex colours that the mesh came with")] public Color Albedo = new Color(1, 1, 1, 1);

        SkinnedMeshRenderer skin;
        Mesh posed, shown, original;
        Color[] own;
        IGashNetwork network;
        GashFrame frame;
        double[][] sh;
        float exposure;
        float[] outputs, lastPoints, lastNormals;
        readonly List<Vector3> vectors = new List<Vector3>();

        protected virtual IGashNetwork Open() =>
            new GashNetwork(File.ReadAllBytes(Path.Combine(Application.streamingAssetsPath, Network)));

        protected void OnEnable()
        {
            var reading = Light;
            try
            {
                var live = RelightMesh.Live(File.ReadAllBytes(Path.Combine(Application.streamingAssetsPath, Light)), out _, out _);
                sh = Rotor.About(0, 1, 0, RelightMesh.AngleOf(live)).Turned(RelightMesh.Sh(live));
                exposure = (float)(double)live["exposure"];
                reading = Network;
                network = Open();
            }
            catch (Exception error)
            {
                Debug.LogError($"Relight: {reading}: {error.Message}", this);
                enabled = false;
                return;
            }
            skin = GetComponent<SkinnedMeshRenderer>();
            original = skin.sharedMesh;
            own = original.colors;
            shown = skin.sharedMesh = Instantiate(original);
            posed = new Mesh();
            skin.BakeMesh(posed);
            posed.GetVertices(vectors);
            frame = GashFrame.Of(Mirrored());
        }

        protected void LateUpdate()
        {
            // Scaled but neither moved nor turned: the light turns the other way instead, 27 numbers rather than a mesh.
            skin.BakeMesh(posed);
            posed.GetVertices(vectors);
            var points = Mirrored();
            posed.GetNormals(vectors);
            var normals = Mirrored();
            if (outputs == null || !Same(points, lastPoints) || !Same(normals, lastNormals))
                outputs = network.Run(Gash.Motors(points, normals, frame), vectors.Count);
            (lastPoints, lastNormals) = (points, normals);  // a mesh at rest needs the network no more, however the light turns
            var place = transform.rotation;
            var turn = Rotor.OfUnity(place.x, place.y, place.z, place.w).Reversed.After(Rotor.About(-Axis.x, Axis.y, Axis.z, Angle));
            var radiance = Gash.Radiance(outputs, turn.Turned(sh));
            var colors = new Color[vectors.Count];
            float factor = exposure * Mathf.Pow(2, Exposure);
            for (int v = 0; v < colors.Length; v++)
            {
                var albedo = own.Length == colors.Length ? own[v] : new Color(1, 1, 1, 1);
                colors[v] = new Color(
                    factor * Albedo.r * albedo.r * radiance[3 * v],
                    factor * Albedo.g * albedo.g * radiance[3 * v + 1],
                    factor * Albedo.b * albedo.b * radiance[3 * v + 2], albedo.a);
            }
            shown.SetColors(colors);  // as floats: highlights are for the shader to compress
        }

        static bool Same(float[] a, float[] b)
        {
            if (a.Length != b.Length) return false;
            for (int i = 0; i < a.Length; i++) if (a[i] != b[i]) return false;
            return true;
        }

        protected void OnDisable()
        {
            if (skin) skin.sharedMesh = original;
            network?.Dispose();
            network = null;
            outputs = null;
        }

        // Vectors of Unity in the frame of the network, three numbers each.
        float[] Mirrored()
        {
            var result = new float[3 * vectors.Count];
            for (int v = 0; v < vectors.Count; v++)
            {
                result[3 * v] = -vectors[v].x;
                result[3 * v + 1] = vectors[v].y;
                result[3 * v + 2] = vectors[v].z;
            }
            return result;
        }
    }
}
