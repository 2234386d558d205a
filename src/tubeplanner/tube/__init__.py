"""Where the hand may be, and how it may be turned: pure geometry."""
