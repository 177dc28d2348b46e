"""What the PhyRC challenge tasks are made of: their scenes, and the published scoring."""
