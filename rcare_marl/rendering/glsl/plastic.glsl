    shine = 1.0 + 0.5 * (1.0 - alpha);
