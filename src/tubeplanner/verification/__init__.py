"""The judge: shares no code with what makes the motions that it judges."""
