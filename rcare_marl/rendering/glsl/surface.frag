// Where there is a second and a third attachment, they take what the survey does.
const float EXPOSURE = 0.51, ROUGHNESS = 0.42, SOFTNESS = 40.0, FADE_NEAR = 2.5, FADE_FAR = 8.0;
uniform vec3 eye;
uniform mat3 optical;
uniform vec3 key;
uniform vec3 powers;  // of the key, of what comes from everywhere, of that from below
uniform vec3 horizon;
uniform vec3 middle;
uniform float shadow_texel_uv;
uniform sampler2DShadow shadow;
uniform sampler2D shadow_depth;
in vec3 normal;
in vec3 position;
in vec4 albedo;
in vec3 in_light;
flat in int label;
layout(location = 0) out vec4 color;
layout(location = 1) out vec4 shape;
layout(location = 2) out float thing;

float lit(vec3 at) {
    vec2 edge = abs(at.xy - 0.5);
    if (max(edge.x, edge.y) > 0.49 || at.z > 1.0) return 1.0;
    vec2 reach = vec2(2.5, 1.0) * shadow_texel_uv;
    float nearest = min(
        min(texture(shadow_depth, at.xy + reach).r, texture(shadow_depth, at.xy - reach).r),
        min(texture(shadow_depth, at.xy + reach.yx * vec2(1.0, -1.0)).r,
            texture(shadow_depth, at.xy + reach.yx * vec2(-1.0, 1.0)).r));
    float gap = at.z - nearest;
    float wide = shadow_texel_uv * clamp(1.0 + gap * SOFTNESS, 1.0, 2.1);
    float sum = 2.0 * texture(shadow, at)
        + texture(shadow, vec3(at.xy + vec2(-0.9, -1.5) * wide, at.z))
        + texture(shadow, vec3(at.xy + vec2(1.5, -0.9) * wide, at.z))
        + texture(shadow, vec3(at.xy + vec2(0.9, 1.5) * wide, at.z))
        + texture(shadow, vec3(at.xy + vec2(-1.5, 0.9) * wide, at.z));
    if (sum <= 0.0 || sum >= 6.0) return sum / 6.0;
    sum += texture(shadow, vec3(at.xy + vec2(-2.3, 1.0) * wide, at.z))
        + texture(shadow, vec3(at.xy + vec2(1.0, 2.3) * wide, at.z))
        + texture(shadow, vec3(at.xy + vec2(2.3, -1.0) * wide, at.z))
        + texture(shadow, vec3(at.xy + vec2(-1.0, -2.3) * wide, at.z));
    return smoothstep(0.0, 1.0, sum * 0.1);
}

vec3 filmic(vec3 x) {
    x *= EXPOSURE;
    return sqrt(clamp(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 0.0, 1.0));
}

vec3 sky(float up) {
    vec3 below = mix(vec3(0.36, 0.33, 0.30), vec3(1.08, 1.02, 0.92), powers.z);
    vec3 above = mix(vec3(0.80, 0.86, 0.95), vec3(0.93, 0.89, 0.82), powers.z);
    return powers.y * mix(below, above, up * 0.5 + 0.5);
}

void main() {
    vec3 n = normalize(gl_FrontFacing ? normal : -normal);
    shape = vec4(optical * n, 1.0 / gl_FragCoord.w);
    thing = float(label + 1);
    vec3 v = normalize(eye - position);
    vec3 base = albedo.rgb;
    float alpha = albedo.a;
    float roughness = ROUGHNESS;
    vec3 wrap = vec3(0.0);
    float shine = 1.0;
#include "SURFACE"
    float facing = dot(n, key);
    float shade = facing > -0.35 ? lit(in_light) : 0.0;
    vec3 diffuse = clamp((vec3(facing) + wrap) / ((1.0 + wrap) * (1.0 + wrap)), 0.0, 1.0);
    vec3 h = normalize(key + v);
    float nl = max(facing, 0.0), nh = max(dot(n, h), 0.0), nv = max(dot(n, v), 1e-3);
    float a2 = roughness * roughness;
    a2 *= a2;
    float spread = nh * nh * (a2 - 1.0) + 1.0;
    float k = (roughness + 1.0) * (roughness + 1.0) * 0.125;
    float gloss = a2 / (12.566 * spread * spread * (nl * (1.0 - k) + k) * (nv * (1.0 - k) + k));
    float rim = 1.0 - nv;
    rim = rim * rim * rim * rim * rim;
    float fresnel = 0.04 + (1.0 - roughness) * 0.6 * rim;
    vec3 sun = powers.x * vec3(3.05, 2.88, 2.62);
    vec3 light = sky(n.z) * 0.80
        + sun * diffuse * mix(wrap * 0.25, vec3(1.0), shade)
        + powers.y * vec3(0.20, 0.25, 0.33) * max(dot(n, vec3(-0.76, 0.57, 0.31)), 0.0);
    vec3 mirrored = reflect(-v, n);
    vec3 out_light = base * light * 0.62
        + shine * (sun * 0.04 * gloss * nl * shade
                   + sky(mirrored.z) * fresnel * (1.0 - 0.6 * roughness));
    vec3 seen = filmic(out_light);
#include "FADE"
    color = vec4(seen, alpha);
}
