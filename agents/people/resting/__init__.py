"""What bears a resting person, with what pressure on which skin, and for how long that can go on."""
