"""What the scenes of tasks are made of: where things start, and what is measured on people and doors."""
