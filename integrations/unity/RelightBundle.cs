// The bundle of `relight SCENE --format live` (docs/live.md): read, checked, and turned into colours. Plain C#, no Unity, so
// that it can be tested and used anywhere. Suns are kept in the harmonics: their shadows are soft.

using System;
using System.Collections.Generic;
using System.Globalization;
using System.IO;
using System.Security.Cryptography;
using System.Text;
using System.Text.RegularExpressions;

namespace Relight
{
    public sealed class Light
    {
        public string Name;
        public float Exposure, Lamps, Captured, Unit = 1;
        public double[][] Rest, Whole, SunDirections, SunWeights;
    }

    // Light beside the environment: what was captured, or a placed lamp. Without runs it is 1 everywhere.
    public sealed class Term
    {
        public string Name;
        public bool IsCaptured;
        public double[] Color, Mean;
        internal uint[] Runs;
        internal byte[] Rows;
        internal float[][] Values;

        // How strong it is under a light: lamps so many stops brighter than they were asked for, captured light by a factor.
        public double[] Strength(Light light, float exposure, float captured, float stops)
        {
            double unit = light.Unit * exposure / light.Exposure * (IsCaptured ? captured : Math.Pow(2, stops));
            return Array.ConvertAll(Color, each => each * unit);
        }
    }

    public sealed class Bundle
    {
        public const string Format = "relight-live";
        public const int Version = 2;
        const double C0 = 0.28209479177387814;

        public readonly int Count, Clusters, Weights, Direct, Spread, Numbers, Directions;
        public readonly List<Light> Lights = new List<Light>();
        public readonly List<Term> Terms = new List<Term>();
        public readonly byte[] Rows, Kinds;
        readonly float[] basis, directions;
        readonly double[][] mean;

        // Reads a folder and refuses, in one line, a splat that is not of it. The splat is the one that the engine shows.
        public Bundle(string folder, string splat = "splat.ply")
        {
            var meta = (Dictionary<string, object>)Json.Parse(File.ReadAllText(Path.Combine(folder, "live.json")));
            if (!meta.TryGetValue("format", out var format) || (string)format != Format)
                throw new InvalidDataException($"{folder}: not a bundle of live light");
            if ((double)meta["version"] > Version)
                throw new InvalidDataException($"{folder}: version {meta["version"]}, this loader reads {Version}");
            var sizes = (Dictionary<string, object>)meta["basis"];
            Count = (int)(double)meta["count"];
            Clusters = (int)(double)sizes["clusters"];
            Weights = (int)(double)sizes["weights"];
            Direct = (int)(double)sizes["direct"];
            Spread = (int)(double)sizes["spread"];
            Numbers = Direct + Spread + (int)(double)sizes["lamps"];
            Directions = (int)(double)sizes["directions"];
            Check(Path.Combine(folder, splat), splat, (List<object>)meta["splats"]);
            Rows = File.ReadAllBytes(Path.Combine(folder, "transfer.bin"));
            var surface = File.ReadAllBytes(Path.Combine(folder, "surface.bin"));
            if (Rows.Length != Count * (2 + Weights) || surface.Length != 8 * Count)
                throw new InvalidDataException($"{folder}: the bundle is cut short");
            Kinds = new byte[Count];
            for (int i = 0; i < Count; i++) Kinds[i] = (byte)(surface[8 * i + 7] & 3);
            var data = File.ReadAllBytes(Path.Combine(folder, "basis.bin"));
            long start = (1L + Directions) * (4 + 6 * Numbers), parts = Clusters * (1L + Weights);
            if (data.Length != start + 4 * parts + (long)Directions * Clusters * (2 + Weights))
                throw new InvalidDataException("basis.bin is cut short");
            directions = ReadDirections(data);
            basis = ReadBasis(data, (int)start);
            mean = Json.Rows(meta["mean"]);
            if (meta.TryGetValue("terms", out var terms)) ReadTerms((List<object>)terms, Path.Combine(folder, "terms.bin"));
            foreach (Dictionary<string, object> each in (List<object>)meta["lights"])
            {
                var suns = (List<object>)each["suns"];
                Lights.Add(new Light
                {
                    Name = (string)each["name"],
                    Exposure = (float)(double)each["exposure"],
                    Lamps = (float)(double)each["lamps"],
                    Captured = each.TryGetValue("captured", out var captured) ? (float)(double)captured : 0,
                    Unit = each.TryGetValue("unit", out var unit) ? (float)(double)unit : 1,
                    Rest = Json.Rows(each["rest"]),
                    Whole = Json.Rows(each["whole"]),
                    SunDirections = suns.ConvertAll(s => Json.Row(((Dictionary<string, object>)s)["direction"])).ToArray(),
                    SunWeights = suns.ConvertAll(s => Json.Row(((Dictionary<string, object>)s)["weight"])).ToArray(),
                });
            }
        }

        void Check(string path, string name, List<object> splats)
        {
            foreach (Dictionary<string, object> entry in splats)
            {
                if ((string)entry["file"] != name) continue;
                var bytes = File.ReadAllBytes(path);
                string found;
                using (var sha = SHA256.Create())
                    found = BitConverter.ToString(sha.ComputeHash(bytes)).Replace("-", "").ToLowerInvariant();
                var header = Encoding.ASCII.GetString(bytes, 0, Math.Min(bytes.Length, 4096));
                var rows = Regex.Match(header, @"element vertex (\d+)").Groups[1].Value;
                if (found == (string)entry["sha256"] && rows == Count.ToString() && (double)entry["count"] == Count) return;
                throw new InvalidDataException(
                    $"{name} is not the splat of this bundle (its SHA-256 or count differs): export it again");
            }
            throw new InvalidDataException($"{name}: the bundle does not name this splat");
        }

        void ReadTerms(List<object> entries, string path)
        {
            byte[] data = entries.Count > 0 ? File.ReadAllBytes(path) : new byte[0];
            int at = 0;
            foreach (Dictionary<string, object> each in entries)
            {
                var term = new Term { Name = (string)each["name"], IsCaptured = (string)each["kind"] == "captured" };
                term.Color = Json.Row(each["color"]);
                term.Mean = Json.Row(each["mean"]);
                Terms.Add(term);
                if (each["runs"] == null) continue;
                long runs = (long)(double)each["runs"], rows = (long)(double)each["rows"];
                if (at + 8 * runs + 3 * rows > data.Length) throw new InvalidDataException("terms.bin is cut short");
                term.Runs = new uint[2 * runs];
                term.Rows = new byte[3 * rows];
                Buffer.BlockCopy(data, at, term.Runs, 0, (int)(8 * runs));
                Buffer.BlockCopy(data, at + (int)(8 * runs), term.Rows, 0, (int)(3 * rows));
                at += (int)(8 * runs + 3 * rows);
                double steps = (double)each["steps"];
                term.Values = Array.ConvertAll(Json.Row(each["peak"]), peak =>
                {
                    var table = new float[256];
                    for (int i = 1; i < 256; i++) table[i] = (float)(peak * Math.Pow(2, (i - 255) / steps));
                    return table;
                });
            }
        }

        // What terms add to the change of light, 3 numbers a splat, by the strength (3) of each; null where there are none.
        public float[] Beside(IList<double[]> strengths)
        {
            if (Terms.Count == 0) return null;
            var result = new float[3 * Count];
            for (int t = 0; t < Terms.Count; t++)
            {
                var term = Terms[t];
                if (term.Runs == null)
                    for (int i = 0; i < result.Length; i++) result[i] += (float)strengths[t][i % 3];
                else
                    for (int run = 0, at = 0; run < term.Runs.Length; run += 2)
                        for (long i = 3L * term.Runs[run], end = i + 3L * term.Runs[run + 1]; i < end; i++, at++)
                            result[i] += (float)strengths[t][i % 3] * term.Values[i % 3][term.Rows[at]];
            }
            return result;
        }

        // The mean of all responses and the directions in which they differ, colours last.
        float[] ReadDirections(byte[] data)
        {
            var result = new float[(1 + Directions) * 3 * Numbers];
            for (int i = 0; i < result.Length; i++)
                result[i] = BitConverter.ToSingle(data, 4 * (i / (3 * Numbers)))
                    * BitConverter.ToInt16(data, 4 * (1 + Directions) + 2 * i);
            return result;
        }

        // The mean and the components of every cluster along those directions.
        float[] ReadBasis(byte[] data, int start)
        {
            int numbers = Directions, parts = Clusters * (1 + Weights);
            var result = new float[parts * numbers];
            int means = start + 4 * parts, components = means + 2 * Clusters * numbers;
            for (int part = 0; part < parts; part++)
            {
                float scale = BitConverter.ToSingle(data, start + 4 * part);
                int c = part / (1 + Weights), w = part % (1 + Weights);
                for (int i = 0; i < numbers; i++)
                    result[part * numbers + i] = scale * (w == 0
                        ? BitConverter.ToInt16(data, means + 2 * (c * numbers + i))
                        : (sbyte)data[components + (c * Weights + w - 1) * numbers + i]);
            }
            return result;
        }

        // Direct and spread coefficients of a light, turned about the vertical and exposed, and what lamps are multiplied
        // by; colours last.
        public float[] Vector(Light light, float degrees, float exposure)
        {
            var straight = new double[Direct, 3];
            for (int j = 0; j < Direct; j++) for (int i = 0; i < 3; i++) straight[j, i] = light.Rest[j][i];
            for (int s = 0; s < light.SunDirections.Length; s++)
            {
                var values = Harmonics(light.SunDirections[s], (int)Math.Round(Math.Sqrt(Direct)));
                for (int j = 0; j < Direct; j++)
                    for (int i = 0; i < 3; i++) straight[j, i] += values[j] * light.SunWeights[s][i];
            }
            var vector = new float[3 * Numbers];
            for (int j = 0; j < Direct + Spread; j++)
            {
                int k = j < Direct ? j : j - Direct, l = (int)Math.Sqrt(k), m = k - l * (l + 1);
                double angle = m * degrees * Math.PI / 180, cos = Math.Cos(angle), sin = Math.Sin(angle);
                for (int i = 0; i < 3; i++)
                    vector[3 * j + i] = (float)(exposure * (j < Direct
                        ? cos * straight[k, i] - sin * straight[k - 2 * m, i]
                        : cos * light.Whole[k][i] - sin * light.Whole[k - 2 * m][i]));
            }
            for (int j = 3 * (Direct + Spread); j < vector.Length; j++) vector[j] = light.Lamps * exposure / light.Exposure;
            return vector;
        }

        // Harmonics about +y up to a band in a direction of the scene frame.
        public static double[] Harmonics(double[] direction, int bands)
        {
            double x = direction[0], y = direction[1], z = direction[2], length = Math.Sqrt(x * x + y * y + z * z);
            double longitude = Math.Atan2(x, z), up = y / length, flat = Math.Sqrt(Math.Max(0, 1 - up * up)), diagonal = 1;
            var values = new double[bands * bands];
            for (int m = 0; m < bands; m++)
            {
                if (m > 0) diagonal *= (2 * m - 1) * flat;
                double before = 0, now = diagonal;
                for (int l = m; l < bands; l++)
                {
                    if (l > m)
                    {
                        double next = ((2 * l - 1) * up * now - (l + m - 1) * before) / (l - m);
                        before = now;
                        now = next;
                    }
                    double ratio = (2 * l + 1) / (4 * Math.PI);
                    for (int k = l - m + 1; k <= l + m; k++) ratio /= k;
                    double value = Math.Sqrt(m > 0 ? 2 * ratio : ratio) * now;
                    values[l * (l + 1) + m] = value * Math.Cos(m * longitude);
                    if (m > 0) values[l * (l + 1) - m] = value * Math.Sin(m * longitude);
                }
            }
            return values;
        }

        // The table that every splat looks up: 1 + weights colours for each cluster.
        public float[] Table(float[] vector)
        {
            var colors = new float[3 * (1 + Directions)];
            for (int d = 0, at = 0; d <= Directions; d++)
                for (int j = 0; j < vector.Length; j++, at++) colors[3 * d + j % 3] += directions[at] * vector[j];
            var table = new float[3 * Clusters * (1 + Weights)];
            for (int part = 0, at = 0; part < table.Length; part += 3)
            {
                if (part / 3 % (1 + Weights) == 0) Array.Copy(colors, 0, table, part, 3);
                for (int d = 1; d <= Directions; d++, at++)
                    for (int i = 0; i < 3; i++) table[part + i] += basis[at] * colors[3 * d + i];
            }
            return table;
        }

        // The change of light of one splat, linear: three numbers into `change`. beside: of `Beside`.
        public void Change(float[] table, int splat, float[] change, float[] beside = null)
        {
            int row = splat * (2 + Weights), first = 3 * (1 + Weights) * (Rows[row] | Rows[row + 1] << 8);
            for (int i = 0; i < 3; i++) change[i] = table[first + i] + (beside == null ? 0 : beside[3 * splat + i]);
            for (int w = 0; w < Weights; w++)
                for (int i = 0; i < 3; i++) change[i] += (sbyte)Rows[row + 2 + w] * table[first + 3 * (1 + w) + i];
        }

        // The gain on display colours of a change k, for a captured display value: colour' = g (colour + .055) - .055.
        public static float Gain(float color, float k)
        {
            double dark = Math.Max(color, 0), linear = color <= 0.04045 ? dark / 12.92 : Math.Pow((color + 0.055) / 1.055, 2.4);
            double start = Math.Max(0.8, linear), room = Math.Max(1 - start, 1e-3), shown = k * linear;
            if (shown > start) shown = start + room * (1 - Math.Exp(-(shown - start) / room));
            double ratio = linear > 1e-4 ? shown / linear : k;
            return (float)Math.Pow(Math.Min(Math.Max(ratio, 1e-4), 1e4), 1 / 2.4);
        }

        // A constant coefficient of a splat (f_dc of a PLY) under a gain.
        public static float Coefficient(float dc, float gain)
        {
            return (float)((gain * (dc * C0 + 0.555) - 0.555) / C0);
        }

        // The largest gain of what depends on the view: that of the scene as a whole, and at least 1.
        public float[] MeanGain(float[] vector, IList<double[]> strengths = null)
        {
            var k = new double[3];
            for (int t = 0; t < Terms.Count && strengths != null; t++)
                for (int i = 0; i < 3; i++) k[i] += Terms[t].Mean[i] * strengths[t][i];
            for (int j = 0; j < mean.Length; j++) for (int i = 0; i < 3; i++) k[i] += mean[j][i] * vector[3 * (Direct + j) + i];
            return Array.ConvertAll(k, each => (float)Math.Pow(Math.Max(each, 1), 1 / 2.4));
        }
    }

    // As much of JSON as live.json needs: objects are dictionaries, arrays lists, numbers doubles.
    public static class Json
    {
        static readonly Regex Token = new Regex("\\s*(?:([\\[\\]{},:])|\"((?:[^\"\\\\]|\\\\.)*)\"|([-+.\\w]+))");

        const int Deepest = 64;  // the stack of a player is small, and running out of it ends the player

        public static object Parse(string text)
        {
            int at = 0;
            return Value(text, ref at);
        }

        public static double[] Row(object list) => ((List<object>)list).ConvertAll(each => (double)each).ToArray();

        public static double[][] Rows(object list) => ((List<object>)list).ConvertAll(Row).ToArray();

        static object Value(string text, ref int at, int depth = 0)
        {
            if (depth > Deepest) throw new InvalidDataException($"nested more than {Deepest} deep at character {at}");
            var token = Next(text, ref at);
            if (token.Groups[2].Success) return Regex.Unescape(token.Groups[2].Value);
            var word = token.Groups[3].Value;
            if (word == "null") return null;
            if (word == "true" || word == "false") return word == "true";
            if (word != "") return double.Parse(word, CultureInfo.InvariantCulture);
            bool isObject = token.Groups[1].Value == "{";
            var list = new List<object>();
            var map = new Dictionary<string, object>();
            while (true)
            {
                int before = at;
                var next = Next(text, ref at).Groups[1].Value;
                if (next == "]" || next == "}") return isObject ? map : (object)list;
                if (next != ",") at = before;
                if (!isObject) { list.Add(Value(text, ref at, depth + 1)); continue; }
                var name = (string)Value(text, ref at, depth + 1);
                Next(text, ref at);
                map[name] = Value(text, ref at, depth + 1);
            }
        }

        static Match Next(string text, ref int at)
        {
            var match = Token.Match(text, at);
            if (!match.Success || match.Index != at) throw new InvalidDataException($"not JSON at character {at}");
            at += match.Length;
            return match;
        }
    }
}
