// What is where: normal in the optical frame with the depth, and the label plus one; zero is nothing.
in vec3 normal;
in float depth;
flat in int label;
layout(location = 0) out vec4 shape;
layout(location = 1) out float thing;
void main() {
    shape = vec4(normalize(gl_FrontFacing ? normal : -normal), depth);
    thing = float(label + 1);
}
