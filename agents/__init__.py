"""Who acts: robots and people, how they are driven and who decides for them."""
