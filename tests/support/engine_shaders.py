"""Shaders of engines without the engines: compiled by glslang, and their kernels run as C++.

The kernels of RelightMesh.hlsl and relight_mesh.gdshader are written in what HLSL, GLSL and C++ have in common.
"""

import re
import shutil
import subprocess

import numpy as np
import pytest

from relight.light.tonemap import compress_highlights

CASES = 40

VECTORS = """
#include <algorithm>
#include <cstdio>
using std::max;
struct float3 { float x, y, z; float3() {} float3(float a, float b, float c) : x(a), y(b), z(c) {} };
struct float4 { float x, y, z, w; float3 yzw; float3 xyz; };
float3 operator*(float a, float3 b) { return float3(a * b.x, a * b.y, a * b.z); }
float3 operator*(float3 b, float a) { return a * b; }
float3 operator*(float3 a, float3 b) { return float3(a.x * b.x, a.y * b.y, a.z * b.z); }
float3 operator+(float3 a, float3 b) { return float3(a.x + b.x, a.y + b.y, a.z + b.z); }
float3& operator+=(float3& a, float3 b) { return a = a + b; }
float3 max(float3 a, float3 b) { return float3(max(a.x, b.x), max(a.y, b.y), max(a.z, b.z)); }
float max(float a, double b) { return max(a, float(b)); }
float3 lerp(float3 a, float3 b, float t) { return (1 - t) * a + t * b; }
#define mix lerp
#define vec3 float3
#define vec4 float4
float4 four(const float* v) { return {v[0], v[1], v[2], v[3], float3(v[1], v[2], v[3]), float3(v[0], v[1], v[2])}; }
"""

MAIN = """
int main() {
    float row[15 + 27];
    while (true) {
        for (float& value : row) if (scanf("%f", &value) != 1) return 0;
        READ
        float3 sent = RADIANCE;
        float3 shown = SHOWN(sent);
        printf("%.9g %.9g %.9g %.9g %.9g %.9g\\n", sent.x, sent.y, sent.z, shown.x, shown.y, shown.z);
    }
}
"""


def kernel_values(folder, source, prefix):
    """What a shader's kernel computes of random vertices and lights, (N, 6): radiance and shown; and what Python does.

    source: its text up to the first function that is not of the kernel. prefix: "Relight" for HLSL, whose light is an
    argument, "relight" for a gdshader, whose light is a uniform.
    """
    if shutil.which("g++") is None:
        pytest.skip("g++ is not installed")
    rng = np.random.default_rng(5)
    albedo, transfer = rng.uniform(0, 1, (CASES, 3)), rng.uniform(-0.3, 0.6, (CASES, 12))
    transfer[:, 9:] = rng.uniform(0, 1, (CASES, 3))
    light = rng.normal(size=(CASES, 9, 3)) + np.r_[3.0, np.zeros(8)][:, None]
    hlsl = prefix == "Relight"
    names = ("RelightRadiance", "RelightShown") if hlsl else ("relight_radiance", "relight_shown")
    vectors = "float3(row[0], row[1], row[2]), four(row + 3), four(row + 7), four(row + 11)"
    place = "float3 light[9];" if hlsl else ""
    fill = "for (int j = 0; j < 9; j++) light[j] = float3(row[15 + 3 * j], row[16 + 3 * j], row[17 + 3 * j]);"
    call = f"{names[0]}({vectors}{', light' if hlsl else ''})"
    main = MAIN.replace("READ", place + fill).replace("RADIANCE", call).replace("SHOWN", names[1])
    (folder / "kernel.cpp").write_text(VECTORS + ("" if hlsl else "float3 light[9];\n") + source + main)
    subprocess.run(["g++", "-O0", "-o", folder / "kernel", folder / "kernel.cpp"], check=True)
    given = np.hstack([albedo, transfer, light.reshape(CASES, -1)])
    text = "\n".join(" ".join(map(repr, row.tolist())) for row in given)
    done = subprocess.run([folder / "kernel"], input=text, capture_output=True, text=True, check=True)
    sent = albedo * transfer[:, 9:] * np.maximum(np.einsum("nj,njc->nc", transfer[:, :9], light), 0.0)
    return np.array(done.stdout.split(), float).reshape(-1, 6), np.hstack([sent, compress_highlights(sent)])


def glslang(path, *options):
    """Compile a shader; skips without the compiler."""
    if shutil.which("glslangValidator") is None:
        pytest.skip("glslangValidator is not installed (glslang-tools)")
    done = subprocess.run(["glslangValidator", *options, str(path)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def compiled_hlsl(folder, unity, name):
    """Compile both stages of a .shader, with stand-ins for what Unity includes."""
    text = (unity / name).read_text(encoding="utf-8")
    program = re.search(r"HLSLPROGRAM(.*?)ENDHLSL", text, re.DOTALL)[1]
    program = program.replace(
        '#include "UnityCG.cginc"', "float4x4 MVP; float4 UnityObjectToClipPos(float4 p) { return mul(MVP, p); }"
    )
    program = program.replace('#include "RelightMesh.hlsl"', (unity / "RelightMesh.hlsl").read_text(encoding="utf-8"))
    (folder / "mesh.hlsl").write_text(program)
    for stage, entry in (("vert", "vert"), ("frag", "frag")):
        glslang(folder / "mesh.hlsl", "-D", "-V", "-S", stage, "-e", entry, "-o", folder / f"{stage}.spv")


def compiled_gdshader(folder, path):
    """Compile both stages of a gdshader as GLSL, with stand-ins for what Godot declares."""
    text = path.read_text(encoding="utf-8")
    body = re.sub(r"^(shader_type|render_mode).*$", "", text, flags=re.MULTILINE)
    body = re.sub(r"uniform (\w+) (\w+) = .*;", r"uniform \1 \2;", body)
    vertex = "\n".join(f"in vec4 CUSTOM{i};" for i in range(4)) + body.replace("varying", "out")
    vertex = re.sub(
        r"void fragment\(\) \{.*?\n\}", "void main() { vertex(); gl_Position = vec4(0.0); }", vertex, flags=re.DOTALL
    )
    fragment = "out vec3 ALBEDO;\n" + body.replace("varying", "in")
    fragment = re.sub(r"void vertex\(\) \{.*?\n\}", "", fragment, flags=re.DOTALL) + "\nvoid main() { fragment(); }\n"
    for stage, source in (("vert", vertex), ("frag", fragment)):
        (folder / f"mesh.{stage}").write_text("#version 450 core\n" + source)
        glslang(folder / f"mesh.{stage}", "-S", stage)
