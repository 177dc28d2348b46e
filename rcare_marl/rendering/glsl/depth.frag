uniform float lid;
in float height;
void main() { if (height > lid) discard; }
