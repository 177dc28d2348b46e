"""Where frames of a person come from: head and hands, joints, landmarks, marker bands in pictures."""
