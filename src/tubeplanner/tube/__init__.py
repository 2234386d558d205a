"""Where the tool may be, and how it may be turned: pure geometry."""
