// Vertex colours as linear radiance, exposed: what RelightSkinned writes. For every pipeline, as Relight/Mesh.
Shader "Relight/Color"
{
    SubShader
    {
        Tags { "RenderType" = "Opaque" }
        Pass
        {
            HLSLPROGRAM
            #pragma vertex vert
            #pragma fragment frag
            #include "UnityCG.cginc"
            #include "RelightMesh.hlsl"

            struct Vertex
            {
                float4 position : POSITION;
                float4 color : COLOR;
            };

            struct Shown
            {
                float4 position : SV_POSITION;
                float3 radiance : TEXCOORD0;
            };

            Shown vert(Vertex vertex)
            {
                Shown shown;
                shown.position = UnityObjectToClipPos(vertex.position);
                shown.radiance = vertex.color.xyz;
                return shown;
            }

            float4 frag(Shown shown) : SV_Target
            {
                float3 color = RelightShown(shown.radiance);
                #ifdef UNITY_COLORSPACE_GAMMA
                color = LinearToGammaSpace(color);
                #endif
                return float4(color, 1.0);
            }
            ENDHLSL
        }
    }
}
