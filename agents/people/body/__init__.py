"""The body of a person: SMPL-X skeleton, skin, masses, collision shapes and the URDF made of them."""
