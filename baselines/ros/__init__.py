"""Robots over ROS 2: environments served as robots, and policies that play on the topics of a robot."""
