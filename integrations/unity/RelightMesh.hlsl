// Live light on a mesh: the kernel. Twelve numbers a vertex against nine radiance coefficients of the light.
float3 RelightRadiance(float3 albedo, float4 transfer0, float4 transfer1, float4 transfer2, float3 light[9])
{
    float3 sum = transfer0.x * light[0] + transfer0.y * light[1] + transfer0.z * light[2] + transfer0.w * light[3];
    sum += transfer1.x * light[4] + transfer1.y * light[5] + transfer1.z * light[6] + transfer1.w * light[7];
    sum += transfer2.x * light[8];
    return albedo * transfer2.yzw * max(sum, float3(0.0, 0.0, 0.0));
}

// Exposed radiance as preview.png shows it, linear: Khronos PBR Neutral without its mirror reflection.
float3 RelightShown(float3 color)
{
    float peak = max(color.x, max(color.y, color.z));
    float over = max(peak, 0.8);
    float top = 1.0 - 0.04 / (over - 0.6);
    float saturation = 1.0 / (0.15 * (over - top) + 1.0);
    float3 white = float3(top, top, top);
    return peak > 0.8 ? lerp(white, color * (top / over), saturation) : color;
}
