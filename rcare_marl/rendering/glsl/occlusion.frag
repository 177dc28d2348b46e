// Writes (occlusion, distance) at half size. `projection` is (P00, P11, P02, P12) of the camera.
#define TAPS 8
#define RADIUS 0.25
#include "DEPTH"
uniform vec4 projection;
uniform vec2 planes;
uniform ivec2 size;
in vec2 uv;
out vec2 result;

vec3 place(ivec2 pixel) {
    pixel = clamp(pixel, ivec2(0), size - 1);
    float z = texelFetch(depth, pixel, 0).r * 2.0 - 1.0;
    float d = 2.0 * planes.x * planes.y / (planes.y + planes.x - z * (planes.y - planes.x));
    vec2 clip = (vec2(pixel) + 0.5) / vec2(size) * 2.0 - 1.0;
    return vec3((clip + projection.zw) / projection.xy * d, -d);
}

void main() {
    ivec2 here = ivec2(gl_FragCoord.xy) * 2;
    vec3 p = place(here);
    if (-p.z > planes.y * 0.6) { result = vec2(1.0, -p.z); return; }
    vec3 left = p - place(here - ivec2(2, 0)), right = place(here + ivec2(2, 0)) - p;
    vec3 down = p - place(here - ivec2(0, 2)), up = place(here + ivec2(0, 2)) - p;
    vec3 dx = abs(left.z) < abs(right.z) ? left : right;
    vec3 dy = abs(down.z) < abs(up.z) ? down : up;
    vec3 n = normalize(cross(dx, dy));
    float reach = min(float(size.y) * 0.5 * RADIUS * projection.y / -p.z, float(size.y) * 0.2);
    // Bayer's order of four by four: all sixteen turns are met within one tile.
    ivec2 tile = ivec2(gl_FragCoord.xy) & 3;
    int mixed = tile.x ^ tile.y;
    int rank = (mixed & 1) * 8 + (tile.y & 1) * 4 + (mixed & 2) + (tile.y >> 1);
    float turn = float(rank) * 0.3927, shift = (float((rank * 5) & 15) + 0.5) / 16.0;
    float sum = 0.0;
    for (int i = 0; i < TAPS; ++i) {
        float t = (float(i) + shift) / float(TAPS);
        float angle = float(i) * 2.3999 + turn;
        vec3 d = place(here + ivec2(vec2(cos(angle), sin(angle)) * max(reach * t, 1.5))) - p;
        float dd = dot(d, d);
        float f = max(RADIUS * RADIUS - dd, 0.0);
        sum += f * f * f * max((dot(d, n) - 0.004 * -p.z) / (dd + 1e-4), 0.0);
    }
    float r6 = RADIUS * RADIUS * RADIUS * RADIUS * RADIUS * RADIUS;
    result = vec2(max(0.0, 1.0 - sum * RADIUS * 1.6 / (r6 * float(TAPS))), -p.z);
}
