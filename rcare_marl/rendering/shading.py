"""The GLSL of the renderer: a studio with a warm key light, a cool fill, a sky and a wooden floor.

Lighting is in linear colour with a GGX highlight (Walter et al. 2007, with the visibility term of
Karis 2013) and a filmic curve (Narkowicz 2015). Human skin gets wrapped diffuse light, redder
towards the shadow (after d'Eon and Luebke, GPU Gems 3, ch. 14). Ambient occlusion is in screen
space, with the estimator of McGuire et al. 2012. Shadows are percentage-closer filtered; the kernel
widens with the distance to what casts them.
"""

HORIZON = (0.83, 0.85, 0.87)  # sRGB
ZENITH = (0.60, 0.68, 0.77)

HEAD = "#version 330\n"  # of every program

# Colours leave the vertex stage in linear light, by a gamma of 2, which is near sRGB and cheap.
# Each slot of `transforms` holds three matrix rows.
_PLACED = """
uniform mat4 view_projection;
uniform sampler2D transforms;
in vec3 in_position;
in uint in_slot;

vec4 row(int i) { return texelFetch(transforms, ivec2(i, int(in_slot)), 0); }
vec3 turned(vec3 v) { return vec3(dot(row(0).xyz, v), dot(row(1).xyz, v), dot(row(2).xyz, v)); }
vec4 placed() {
    vec4 local = vec4(in_position, 1.0);
    return vec4(dot(row(0), local), dot(row(1), local), dot(row(2), local), 1.0);
}
"""

_VERTEX = (
    _PLACED
    + """
uniform mat4 light_matrix;
uniform float shadow_texel;
in vec3 in_normal;
in vec4 in_rgba;
in int in_label;
flat out int label;
out vec3 normal;
out vec3 position;
out vec4 albedo;
out vec3 in_light;

void main() {
    vec3 world = placed().xyz;
    normal = turned(in_normal);
    position = world;
    label = in_label;
    albedo = vec4(in_rgba.rgb * in_rgba.rgb, in_rgba.a);
    // Looking up a little outside of the surface keeps it from shadowing itself.
    in_light = (light_matrix * vec4(world + normal * shadow_texel * 1.6, 1.0)).xyz * 0.5 + 0.5;
    gl_Position = view_projection * vec4(world, 1.0);
}
"""
)

DEPTH_VERTEX = (
    _PLACED
    + """
out float height;
void main() {
    height = placed().z;
    gl_Position = view_projection * placed();
}
"""
)

DEPTH_FRAGMENT = """
uniform float lid;
in float height;
void main() { if (height > lid) discard; }
"""

# What is where: normal in the optical frame with the depth, and the label plus one; zero is nothing.
SURVEY_VERTEX = (
    _PLACED
    + """
uniform mat3 optical;
in vec3 in_normal;
in int in_label;
out vec3 normal;
out float depth;
flat out int label;
void main() {
    normal = optical * turned(in_normal);
    label = in_label;
    gl_Position = view_projection * placed();
    depth = gl_Position.w;
}
"""
)

SURVEY_FRAGMENT = """
in vec3 normal;
in float depth;
flat in int label;
layout(location = 0) out vec4 shape;
layout(location = 1) out float thing;
void main() {
    shape = vec4(normalize(gl_FrontFacing ? normal : -normal), depth);
    thing = float(label + 1);
}
"""

# Where there is a second and a third attachment, they take what the survey does.
_FRAGMENT = """
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
    SURFACE
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
    FADE
    color = vec4(seen, alpha);
}
"""

_PLASTIC = "shine = 1.0 + 0.5 * (1.0 - alpha);"

# The colour of a vertex tells skin (red over green over blue) from cloth.
_SKIN = """
    float warm = clamp((base.r - base.b) / (base.r + 1e-3) * 2.2 - 0.35, 0.0, 1.0)
        * step(base.b, base.g * 1.25);
    wrap = warm * vec3(0.42, 0.20, 0.12);
    roughness = mix(0.85, 0.52, warm);
    shine = mix(0.5, 0.8, warm);
"""

# Thin tubes: hardly darker in the shade, since their colour is what they are there for.
_LINE = "wrap = vec3(1.0); shine = 0.4; base *= 1.25;"

# Planks of light oak, 14 cm by 1.6 m, each with its own tone; lines and grain fade where too fine.
_FLOOR = """
    vec2 at = position.xy / vec2(1.6, 0.14);
    float row = floor(at.y);
    at.x += fract(sin(row * 12.9898) * 43758.5453);
    vec2 cell = vec2(floor(at.x), row);
    float tone = fract(sin(dot(cell, vec2(127.1, 311.7))) * 43758.5453);
    vec2 inside = fract(at);
    vec2 fine = fwidth(position.xy / vec2(1.6, 0.14));
    float grain = sin(position.y * 260.0 + 2.6 * sin(position.x * 2.3 + tone * 40.0) + tone * 90.0)
        * sin(position.y * 97.0 + 1.7 * sin(position.x * 4.1 + tone * 17.0));
    grain *= clamp(1.0 - fine.y * 9.0, 0.0, 1.0);
    vec2 gap = min(inside, 1.0 - inside) * vec2(1.6, 0.14);
    vec2 pixel = fine * vec2(1.6, 0.14);
    float seam = max(1.0 - smoothstep(0.0008, 0.0008 + pixel.y, gap.y),
                     1.0 - smoothstep(0.0008, 0.0008 + pixel.x, gap.x));
    seam *= clamp(0.0035 / (pixel.y + 0.0012), 0.0, 1.0);
    base *= (0.93 + 0.14 * tone + 0.022 * grain) * (1.0 - 0.35 * seam);
    roughness = 0.48 + 0.05 * tone;
    shine = 0.8;
"""

_FLOOR_FADE = """
    float away = length(position.xy - middle.xy);
    seen = mix(seen, horizon, smoothstep(FADE_NEAR, FADE_FAR, away));
"""

SCREEN_VERTEX = """
out vec2 uv;
void main() {
    uv = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0;
    gl_Position = vec4(uv * 2.0 - 1.0, 1.0, 1.0);
}
"""

BACKGROUND_FRAGMENT = """
uniform mat4 from_clip;
uniform vec3 horizon;
uniform vec3 zenith;
in vec2 uv;
out vec4 color;
void main() {
    vec4 far = from_clip * vec4(uv * 2.0 - 1.0, 1.0, 1.0);
    vec4 near = from_clip * vec4(uv * 2.0 - 1.0, -1.0, 1.0);
    vec3 ray = normalize(far.xyz / far.w - near.xyz / near.w);
    color = vec4(mix(horizon, zenith, smoothstep(0.0, 0.75, ray.z)), 1.0);
}
"""

# Writes (occlusion, distance) at half size. `projection` is (P00, P11, P02, P12) of the camera.
OCCLUSION_FRAGMENT = """
uniform DEPTH_SAMPLER depth;
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
"""

# The noise of the taps has a period of four pixels: a box of four by four removes it.
BLUR_FRAGMENT = """
uniform sampler2D raw;
in vec2 uv;
out float result;
void main() {
    ivec2 here = ivec2(gl_FragCoord.xy), last = textureSize(raw, 0) - 1;
    float z = texelFetch(raw, here, 0).g, sharp = 1.0 / (0.03 * z);
    vec2 sum = vec2(0.0);
    for (int i = 0; i < 16; ++i) {
        ivec2 at = clamp(here + ivec2(i & 3, i >> 2) - 2, ivec2(0), last);
        vec2 s = texelFetch(raw, at, 0).rg;
        float w = max(0.02, 1.0 - abs(s.g - z) * sharp);
        sum += vec2(s.r * w, w);
    }
    result = sum.x / sum.y;
}
"""

# Row 0 of a picture is its top, row 0 of a texture its bottom: the last pass turns it over.
FINAL_FRAGMENT = """
uniform sampler2D picture;
uniform sampler2D occlusion;
uniform float strength;
in vec2 uv;
out vec4 color;
void main() {
    vec2 at = vec2(uv.x, 1.0 - uv.y);
    ivec2 size = textureSize(picture, 0), pixel = ivec2(gl_FragCoord.xy);
    vec3 c = texelFetch(picture, ivec2(pixel.x, size.y - 1 - pixel.y), 0).rgb;
    if (strength > 0.0) {
        float open = mix(1.0, texture(occlusion, at).r, strength);
        c *= mix(vec3(open), vec3(1.0), 0.45 * c);  // light that bounces takes on the colour
    }
    color = vec4(c, 1.0);
}
"""


def surface_program(kind: str) -> tuple[str, str]:
    """Return the vertex and fragment source of a surface: `plastic`, `skin`, `line` or `floor`."""
    surface = {"plastic": _PLASTIC, "skin": _SKIN, "line": _LINE, "floor": _FLOOR}[kind]
    body = _FRAGMENT.replace("SURFACE", surface)
    body = body.replace("    FADE\n", _FLOOR_FADE if kind == "floor" else "")
    return _VERTEX, body


def occlusion_program(*, multisampled: bool) -> tuple[str, str]:
    """Return the vertex and fragment source of the ambient occlusion pass."""
    sampler = "sampler2DMS" if multisampled else "sampler2D"
    defines = f"#define DEPTH_SAMPLER {sampler}\n#define TAPS 8\n#define RADIUS 0.25\n"
    return SCREEN_VERTEX, defines + OCCLUSION_FRAGMENT
