#include "placed.glsl"
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
