"""How a person moves from here to there: trajectories, clips, walking, and helping with the hands."""
