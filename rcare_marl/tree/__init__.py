"""Trees of joints, compiled: where parts are, what moves and what carries them, least squares over them.

One description (`joint_tree.Tree`) serves a robot's arm and a person with a pelvis that walks.
"""
