"""What pages of this computer share: who may talk to them, and how what they say is read."""
