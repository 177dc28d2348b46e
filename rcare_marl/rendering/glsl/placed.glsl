// Each slot of `transforms` holds three matrix rows.
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
