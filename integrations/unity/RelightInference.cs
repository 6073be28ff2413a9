// The kernel of RelightSplat on the GPU, by Unity's Inference Engine (com.unity.ai.inference 2.2 or later): give it
// relight_splat.onnx. One million splats and a light: a table of some thousand numbers goes up, colours come back.

using System;
using Unity.InferenceEngine;

namespace Relight
{
    public sealed class RelightInference : IDisposable
    {
        readonly Worker worker;
        readonly Tensor<int> cluster;
        readonly Tensor<float> weights, dc;
        readonly Bundle bundle;

        // dc: constant coefficients of the splats as captured, (N, 3), f_dc of the bundle's splat.ply.
        public RelightInference(ModelAsset model, Bundle bundle, float[] dc, BackendType backend = BackendType.GPUCompute)
        {
            if (bundle.Terms.Count > 0)
                throw new NotSupportedException("this model shows no placed lamps and no captured light: use RelightSplat");
            this.bundle = bundle;
            int size = 2 + bundle.Weights;
            var clusters = new int[bundle.Count];
            var factors = new float[bundle.Count * bundle.Weights];
            for (int n = 0; n < bundle.Count; n++)
            {
                clusters[n] = bundle.Rows[n * size] | bundle.Rows[n * size + 1] << 8;
                for (int w = 0; w < bundle.Weights; w++)
                    factors[n * bundle.Weights + w] = (sbyte)bundle.Rows[n * size + 2 + w];
            }
            worker = new Worker(ModelLoader.Load(model), backend);
            cluster = new Tensor<int>(new TensorShape(bundle.Count), clusters);
            weights = new Tensor<float>(new TensorShape(bundle.Count, bundle.Weights), factors);
            this.dc = new Tensor<float>(new TensorShape(bundle.Count, 3), dc);
        }

        // The coefficients under a light: (N, 3). Splats of another kind than 1 are for the caller to leave as they were.
        public float[] Relit(Light light, float degrees, float exposure)
        {
            var values = bundle.Table(bundle.Vector(light, degrees, exposure));
            using (var table = new Tensor<float>(new TensorShape(bundle.Clusters, 1 + bundle.Weights, 3), values))
            {
                worker.SetInput("cluster", cluster);
                worker.SetInput("weights", weights);
                worker.SetInput("table", table);
                worker.SetInput("dc", dc);
                worker.Schedule();
                return ((Tensor<float>)worker.PeekOutput("relit")).DownloadToArray();
            }
        }

        public void Dispose()
        {
            worker.Dispose();
            cluster.Dispose();
            weights.Dispose();
            dc.Dispose();
        }
    }
}
