    float away = length(position.xy - middle.xy);
    seen = mix(seen, horizon, smoothstep(FADE_NEAR, FADE_FAR, away));
