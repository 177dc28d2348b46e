"""A scene as data, of which a Bullet world, an MJCF or URDF files are made."""
