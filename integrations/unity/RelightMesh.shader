// Live light on a mesh, for the built-in pipeline and, as it takes part in no lighting pass, for URP and HDRP as well.
Shader "Relight/Mesh"
{
    SubShader
    {
        Tags { "RenderType" = "Opaque" }
        Cull Off
        Pass
        {
            HLSLPROGRAM
            #pragma vertex vert
            #pragma fragment frag
            #include "UnityCG.cginc"
            #include "RelightMesh.hlsl"

            float4 _RelightLight[9];
            float _RelightExposure;

            struct Vertex
            {
                float4 position : POSITION;
                float4 transfer0 : TEXCOORD0;
                float4 transfer1 : TEXCOORD1;
                float4 transfer2 : TEXCOORD2;
                float4 albedo : TEXCOORD3;
            };

            struct Shown
            {
                float4 position : SV_POSITION;
                float3 radiance : TEXCOORD0;
            };

            Shown vert(Vertex vertex)
            {
                float3 light[9];
                for (int i = 0; i < 9; i++) light[i] = _RelightLight[i].xyz;
                Shown shown;
                shown.position = UnityObjectToClipPos(vertex.position);
                shown.radiance = RelightRadiance(
                    vertex.albedo.xyz, vertex.transfer0, vertex.transfer1, vertex.transfer2, light);
                return shown;
            }

            float4 frag(Shown shown) : SV_Target
            {
                float3 color = RelightShown(shown.radiance * _RelightExposure);
                #ifdef UNITY_COLORSPACE_GAMMA
                color = LinearToGammaSpace(color);
                #endif
                return float4(color, 1.0);
            }
            ENDHLSL
        }
    }
}
