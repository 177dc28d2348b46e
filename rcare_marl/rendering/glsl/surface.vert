// Colours leave this stage in linear light, by a gamma of 2, which is near sRGB and cheap.
#include "placed.glsl"
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
