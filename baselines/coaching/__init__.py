"""How well the coach recognises: synthetic people, their sensors, and counts over both."""
