#include "placed.glsl"
out float height;
void main() {
    height = placed().z;
    gl_Position = view_projection * placed();
}
