// RelightSkinned by Unity's Inference Engine (com.unity.ai.inference 2.2 or later): give it neural-gash.onnx of
// relight/models. Leave this file out without that package.

using Unity.InferenceEngine;
using UnityEngine;

namespace Relight
{
    public sealed class RelightSkinnedInference : RelightSkinned
    {
        [Tooltip("neural-gash.onnx of relight/models")] public ModelAsset Model;
        [Tooltip("CPU runs it by Burst, without waiting for the graphics card")] public BackendType Backend = BackendType.GPUCompute;

        protected override IGashNetwork Open() => new GashInference(Model, Backend);
    }

    public sealed class GashInference : IGashNetwork
    {
        readonly Worker worker;

        public GashInference(ModelAsset model, BackendType backend)
        {
            worker = new Worker(ModelLoader.Load(model), backend);
        }

        public float[] Run(float[] motors, int count)
        {
            using (var input = new Tensor<float>(new TensorShape(count, Gash.Numbers), motors))
            {
                worker.SetInput("motor", input);
                worker.Schedule();
                return ((Tensor<float>)worker.PeekOutput("coefficients")).DownloadToArray();
            }
        }

        public void Dispose() => worker.Dispose();
    }
}
