"""People in the scene: a page for each role that a person plays."""
