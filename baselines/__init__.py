"""Controllers to compare with: scripted ones, and in time trained ones."""
