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
