"""What social coaching needs beside the scene: the coach's actions, a learner, a chair to exercise in."""
