"""What a simulated person does, beside what was published about people."""
