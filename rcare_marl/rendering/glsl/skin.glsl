    // The colour of a vertex tells skin (red over green over blue) from cloth.
    float warm = clamp((base.r - base.b) / (base.r + 1e-3) * 2.2 - 0.35, 0.0, 1.0)
        * step(base.b, base.g * 1.25);
    wrap = warm * vec3(0.42, 0.20, 0.12);
    roughness = mix(0.85, 0.52, warm);
    shine = mix(0.5, 0.8, warm);
