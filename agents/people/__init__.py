"""People: avatars, bodies, muscles, motion, behaviour, physiology."""
