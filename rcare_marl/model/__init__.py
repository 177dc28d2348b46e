"""Models of linked bodies as data: shapes, meshes and inertias; URDFs read and written."""
