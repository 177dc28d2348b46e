"""Makes dressed bodies of a stature, mass and looks out of the shape basis that ships."""
