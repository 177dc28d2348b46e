    // Thin tubes: hardly darker in the shade, since their colour is what they are there for.
    wrap = vec3(1.0); shine = 0.4; base *= 1.25;
