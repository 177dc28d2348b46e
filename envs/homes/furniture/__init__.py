"""What stands in the rooms; each module registers its makers."""
