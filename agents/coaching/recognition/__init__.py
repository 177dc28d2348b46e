"""Recognition of exercises: repetitions found in a stream of frames, and judged."""
