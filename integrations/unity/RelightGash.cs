// The network of the Neural-GASh paper (docs/networks.md) on vertices that move: motors, light turned by rotors, radiance.
// Plain C#, no Unity, so that it can be tested and used anywhere. Everything is in the frame of relight, right-handed with y
// up; x of Unity's left-handed axes is its negative, as by Unity's importers of glTF.

using System;
using System.IO;

namespace Relight
{
    // From motors, count rows of 32 numbers, 27 coefficients of transfer each, harmonic after harmonic, colours last.
    public interface IGashNetwork : IDisposable
    {
        float[] Run(float[] motors, int count);
    }

    // A rotation as 1, e12, e13, e23: relight/sh/rotors.py.
    public struct Rotor
    {
        public double S, E12, E13, E23;

        public Rotor(double s, double e12, double e13, double e23)
        {
            S = s;
            E12 = e12;
            E13 = e13;
            E23 = e23;
        }

        // About an axis of any length but 0, right-handed.
        public static Rotor About(double x, double y, double z, double degrees)
        {
            double half = degrees * Math.PI / 360, sine = Math.Sin(half) / Math.Sqrt(x * x + y * y + z * z);
            return new Rotor(Math.Cos(half), -z * sine, y * sine, -x * sine);
        }

        // What a unit quaternion of Unity does, in our frame: the mirror of x keeps x of the axis and turns y and z around.
        public static Rotor OfUnity(double x, double y, double z, double w) => new Rotor(w, z, -y, -x);

        public Rotor Reversed => new Rotor(S, -E12, -E13, -E23);

        // a, then this: the geometric product this a.
        public Rotor After(Rotor a) => new Rotor(
            S * a.S - E12 * a.E12 - E13 * a.E13 - E23 * a.E23,
            S * a.E12 + E12 * a.S - E13 * a.E23 + E23 * a.E13,
            S * a.E13 + E13 * a.S + E12 * a.E23 - E23 * a.E12,
            S * a.E23 + E23 * a.S - E12 * a.E13 + E13 * a.E12);

        // R e_k ~R of the three axes, as the columns of a matrix.
        double[,] Axes()
        {
            double x = -E23, y = E13, z = -E12, n = 2 / (S * S + x * x + y * y + z * z);
            return new[,]
            {
                { 1 - n * (y * y + z * z), n * (x * y - S * z), n * (x * z + S * y) },
                { n * (x * y + S * z), 1 - n * (x * x + z * z), n * (y * z - S * x) },
                { n * (x * z - S * y), n * (y * z + S * x), 1 - n * (x * x + y * y) },
            };
        }

        // Nine radiance coefficients of light turned by it: band 1 is a vector, band 2 a symmetric form, and both turn with the axes.
        public double[][] Turned(double[][] sh)
        {
            const double Mixed = 1.0925484305920792, Zonal = 0.31539156525252005, Square = 0.54627421529603959;
            var axes = Axes();
            var result = new double[9][];
            for (int j = 0; j < 9; j++) result[j] = (double[])sh[j].Clone();
            for (int c = 0; c < 3; c++)
            {
                double[] v = { sh[3][c], sh[1][c], sh[2][c] };
                double even = Zonal * sh[6][c], odd = Square * sh[8][c];
                double xy = Mixed * sh[4][c] / 2, yz = Mixed * sh[5][c] / 2, xz = Mixed * sh[7][c] / 2;
                double[,] form = { { odd - even, xy, xz }, { xy, -odd - even, yz }, { xz, yz, 2 * even } }, turned = new double[3, 3];
                for (int i = 0; i < 3; i++)
                {
                    result[i == 0 ? 3 : i][c] = axes[i, 0] * v[0] + axes[i, 1] * v[1] + axes[i, 2] * v[2];
                    for (int j = 0; j < 3; j++)
                        for (int k = 0; k < 9; k++) turned[i, j] += axes[i, k / 3] * form[k / 3, k % 3] * axes[j, k % 3];
                }
                result[4][c] = 2 * turned[0, 1] / Mixed;
                result[5][c] = 2 * turned[1, 2] / Mixed;
                result[6][c] = turned[2, 2] / (2 * Zonal);
                result[7][c] = 2 * turned[0, 2] / Mixed;
                result[8][c] = (turned[0, 0] - turned[1, 1]) / (2 * Square);
            }
            return result;
        }
    }

    // The network's frame: the middle of a bounding box goes to 0, half of its diagonal becomes 1.
    public struct GashFrame
    {
        public double X, Y, Z, Half;

        // points: three numbers a vertex. It is that of the pose at rest, so that no motion changes what rests.
        public static GashFrame Of(float[] points)
        {
            double[] low = { double.MaxValue, double.MaxValue, double.MaxValue }, high = { double.MinValue, double.MinValue, double.MinValue };
            for (int i = 0; i < points.Length; i++)
            {
                low[i % 3] = Math.Min(low[i % 3], points[i]);
                high[i % 3] = Math.Max(high[i % 3], points[i]);
            }
            if (points.Length == 0) return new GashFrame { Half = 1 };
            double x = (high[0] - low[0]) / 2, y = (high[1] - low[1]) / 2, z = (high[2] - low[2]) / 2, half = Math.Sqrt(x * x + y * y + z * z);
            return new GashFrame
            {
                X = low[0] + x, Y = low[1] + y, Z = low[2] + z, Half = half > 0 ? half : 1,
            };
        }
    }

    public static class Gash
    {
        public const int Numbers = 32, Coefficients = 27;
        const double Degenerate = 1e-6;  // a normal shorter than this has no direction

        // The motors T R of vertices, 32 numbers each: R takes +y to the normal, T the origin to the point (relight/sh/cga.py).
        // points, normals: three numbers a vertex; normals of any length, +y where they have none.
        public static float[] Motors(float[] points, float[] normals, GashFrame frame)
        {
            var motors = new float[points.Length / 3 * Numbers];
            for (int v = 0, row = 0; v < points.Length; v += 3, row += Numbers)
            {
                double x = (points[v] - frame.X) / frame.Half, y = (points[v + 1] - frame.Y) / frame.Half, z = (points[v + 2] - frame.Z) / frame.Half;
                double nx = normals[v], ny = normals[v + 1], nz = normals[v + 2], length = Math.Sqrt(nx * nx + ny * ny + nz * nz);
                bool known = length > Degenerate && !double.IsInfinity(length);
                nx = known ? (float)(nx / length) : 0;
                ny = known ? (float)(ny / length) : 1;
                nz = known ? (float)(nz / length) : 0;
                double lean = Math.Sqrt(nx * nx + nz * nz), unit = Math.Sqrt(nx * nx + nz * nz + ny * ny), s = 0, e12 = 0, e23 = -1;
                if (ny >= 0)
                {
                    s = unit + ny;
                    e12 = nx;
                    e23 = -nz;
                }
                else if (lean > 0)
                {
                    // Below the horizon 1 + y cancels, so all is scaled by (1 - y) / lean.
                    double steep = (unit - ny) / lean;
                    s = lean;
                    e12 = steep * nx;
                    e23 = -steep * nz;
                }
                double scale = 1 / Math.Sqrt(s * s + e12 * e12 + e23 * e23);
                s *= scale;
                e12 *= scale;
                e23 *= scale;
                motors[row] = (float)s;
                motors[row + 6] = (float)e12;
                motors[row + 10] = (float)e23;
                motors[row + 8] = motors[row + 9] = (float)(-0.5 * (x * s - y * e12));
                motors[row + 11] = motors[row + 12] = (float)(-0.5 * (y * s + x * e12 - z * e23));
                motors[row + 13] = motors[row + 14] = (float)(-0.5 * (z * s + y * e23));
                motors[row + 26] = motors[row + 27] = (float)(-0.5 * (x * e23 + z * e12));
            }
            return motors;
        }

        // Linear radiance of white vertices, three numbers each. outputs: of the network; the transfer is the mean of its colours, with
        // the visible fraction of the sky cut to 0 and 1. sh: nine radiance coefficients.
        public static float[] Radiance(float[] outputs, double[][] sh)
        {
            float most = (float)Math.Sqrt(0.25 / Math.PI);
            var result = new float[outputs.Length / 9];
            for (int row = 0, at = 0; row < outputs.Length; row += Coefficients, at += 3)
            {
                double red = 0, green = 0, blue = 0;
                for (int j = 0; j < 9; j++)
                {
                    float transfer = (outputs[row + 3 * j] + outputs[row + 3 * j + 1] + outputs[row + 3 * j + 2]) / 3;
                    if (j == 0) transfer = Math.Max(0, Math.Min(most, transfer));
                    red += transfer * sh[j][0];
                    green += transfer * sh[j][1];
                    blue += transfer * sh[j][2];
                }
                result[at] = (float)Math.Max(red, 0);
                result[at + 1] = (float)Math.Max(green, 0);
                result[at + 2] = (float)Math.Max(blue, 0);
            }
            return result;
        }
    }

    // The network on the processor, without any package, from neural-gash.bin of integrations/web/make_gash.py. For small
    // meshes: 100 vertices take 130 ms under Mono. RelightSkinnedInference has Unity's own kernels.
    public sealed class GashNetwork : IGashNetwork
    {
        const uint Magic = 0x48534147;
        const int Version = 1;

        readonly int[] sizes;
        readonly float[][] weights, biases;

        public GashNetwork(byte[] file)
        {
            if (file.Length < 12 || BitConverter.ToUInt32(file, 0) != Magic) throw new InvalidDataException("not neural-gash.bin");
            uint version = BitConverter.ToUInt32(file, 4), layers = BitConverter.ToUInt32(file, 8);
            if (version > Version) throw new InvalidDataException($"version {version}, this loader reads {Version}");
            long at = 16 + 4L * layers, length = at;
            if (length > file.Length) throw new InvalidDataException("cut short");
            sizes = new int[layers + 1];
            for (int i = 0; i <= layers; i++) sizes[i] = BitConverter.ToInt32(file, 12 + 4 * i);
            for (int i = 0; i < layers; i++) length += sizes[i + 1] * (8L + 2L * sizes[i]);
            if (length != file.Length) throw new InvalidDataException("cut short");
            if (sizes[0] != Gash.Numbers || sizes[layers] != Gash.Coefficients) throw new InvalidDataException("not a network of motors");
            weights = new float[layers][];
            biases = new float[layers][];
            for (int k = 0; k < layers; k++)
            {
                int inputs = sizes[k], outputs = sizes[k + 1];
                var scales = new float[outputs];
                biases[k] = new float[outputs];
                weights[k] = new float[inputs * outputs];
                Buffer.BlockCopy(file, (int)at, scales, 0, 4 * outputs);
                Buffer.BlockCopy(file, (int)at + 4 * outputs, biases[k], 0, 4 * outputs);
                at += 8 * outputs;
                for (int i = 0; i < weights[k].Length; i++, at += 2)
                    weights[k][i] = scales[i / inputs] * BitConverter.ToInt16(file, (int)at);
            }
        }

        public float[] Run(float[] motors, int count)
        {
            var values = motors;
            for (int k = 0; k < weights.Length; k++) values = Layer(values, count, k, k + 1 < weights.Length);
            return values;
        }

        float[] Layer(float[] values, int count, int k, bool bends)
        {
            int inputs = sizes[k], outputs = sizes[k + 1];
            var weight = weights[k];
            var bias = biases[k];
            var result = new float[count * outputs];
            // Four vertices at once, which share a weight that is read; the last ones are computed again where they are fewer.
            for (int v = 0; v < count; v += 4)
            {
                int r1 = Math.Min(v + 1, count - 1), r2 = Math.Min(v + 2, count - 1), r3 = Math.Min(v + 3, count - 1);
                for (int o = 0; o < outputs; o++)
                {
                    float s0 = bias[o], s1 = s0, s2 = s0, s3 = s0;
                    int x0 = v * inputs, x1 = r1 * inputs, x2 = r2 * inputs, x3 = r3 * inputs;
                    for (int row = o * inputs, end = row + inputs; row < end; row++)
                    {
                        float w = weight[row];
                        s0 += w * values[x0++];
                        s1 += w * values[x1++];
                        s2 += w * values[x2++];
                        s3 += w * values[x3++];
                    }
                    result[v * outputs + o] = bends ? Bent(s0) : s0;
                    result[r1 * outputs + o] = bends ? Bent(s1) : s1;
                    result[r2 * outputs + o] = bends ? Bent(s2) : s2;
                    result[r3 * outputs + o] = bends ? Bent(s3) : s3;
                }
            }
            return result;
        }

        static float Bent(float x) => (float)(x / (1 + Math.Exp(-x)));

        public void Dispose() { }
    }
}
