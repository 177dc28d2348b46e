"""Soft matter that we own: XPBD bodies that press on the rigid bodies of a world and are pressed by them."""
