    // Planks of light oak, 14 cm by 1.6 m, each with its own tone; lines and grain fade where too fine.
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
