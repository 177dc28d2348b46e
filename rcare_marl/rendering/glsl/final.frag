// Row 0 of a picture is its top, row 0 of a texture its bottom: the last pass turns it over.
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
