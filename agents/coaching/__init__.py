"""A coach for exercises of the upper body: what to show, and whether a person follows."""
